"""All jobs answer in one shape: a verdict in a word, a cause where it is not the one hoped for, a sentence."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

import retrue
from retrue.answers import Answer, answer_report
from retrue.calibration import reasons as calibration_reasons
from retrue.recalibration.result import refuted
from tests.recalibration.scenes import RIG, SIDE_WALL, SPHERE, WALL, Scene, bumped, capture
from tests.report.pages import calibration

CORNER = Scene([WALL, SIDE_WALL], [SPHERE])
HOPED_FOR = {"accepted", "unchanged", "good"}
OTHERS = {"refused", "drifted", "unknown"}


@cache
def _points() -> retrue.Correspondences:
    return capture(CORNER)


def _known_well() -> retrue.Rig:
    covariance = (np.radians(0.001) ** 2 * np.eye(5)).tolist()
    return retrue.Rig(RIG.camera, RIG.projector, RIG.projector_from_camera, RIG.unit, {"covariance": covariance})


def _mirrored() -> retrue.Correspondences:
    points = _points()
    width = RIG.projector.size[0]
    return retrue.Correspondences(points.camera_px, [width - 1, 0] + points.projector_px * [-1, 1])


def _lost() -> retrue.Correspondences:
    """No rig sees those."""
    rng = np.random.default_rng(0)
    return retrue.Correspondences(rng.uniform(0, 900, (500, 2)), rng.uniform(0, 700, (500, 2)))


ANSWERS: dict[str, Callable[[], Answer]] = {
    "accepted": lambda: retrue.recalibrate(bumped(RIG, [0, 3, 0], [0, 1, 0]), [_points()]),
    "unchanged": lambda: retrue.recalibrate(_known_well(), [_points()]),
    "refused": lambda: retrue.recalibrate(RIG, [_lost()]),
    "refused, mirrored": lambda: retrue.recalibrate(RIG, [_mirrored()]),
    "good": lambda: retrue.verify(RIG, [_points()]),
    "drifted": lambda: retrue.verify(bumped(RIG, [0, 1, 0], [0, 0, 0]), [_points()]),
    "drifted, contradicted": lambda: refuted(retrue.verify(RIG, [_lost()]), retrue.verify(RIG, [_mirrored()]).cause),
    "unknown": lambda: retrue.verify(RIG, [_points().select(np.arange(5))]),
    "unknown, mirrored": lambda: retrue.verify(RIG, [_mirrored()]),
    "accepted, a calibration": calibration,
    "refused, a calibration": lambda: calibration(5, retrue.CalibrationOptions(largest_error=1e-6)),
}


@pytest.mark.parametrize("name", ANSWERS)
def test_every_answer_has_one_shape(name: str) -> None:
    answer = ANSWERS[name]()
    assert answer.verdict == name.split(",")[0], answer.reason
    assert answer.verdict in HOPED_FOR | OTHERS
    assert (answer.cause is None) == (answer.verdict in HOPED_FOR)
    assert answer.reason
    assert "\n" not in answer.reason
    report = answer_report(answer)
    assert list(report) == ["verdict", "cause", "reason"]
    assert json.loads(json.dumps(report)) == report
    if answer.cause is not None:
        assert isinstance(answer.cause, retrue.Reason)
        assert report["cause"] == type(answer.cause).__name__
        assert answer.reason == str(answer.cause)


@pytest.mark.parametrize("job", [retrue.recalibrate, retrue.verify])
def test_a_mirrored_picture_is_called_mirrored(job) -> None:
    answer = job(RIG, [_mirrored()])
    assert answer.cause.name == "PictureMirrored"
    assert "mirrored" in answer.reason
    plain = job(RIG, [_points()])
    assert plain.cause is None or plain.cause.name != "PictureMirrored"


def test_every_cause_of_a_calibration_is_one_sentence() -> None:
    left_out = (("pose_1", "board not found"),)
    made = [
        calibration_reasons.BoardNotSeen(left_out),
        calibration_reasons.BoardOfAnotherSize((7, 9), (6, 8)),
        calibration_reasons.TooFewPoses(left_out),
        calibration_reasons.RigUndetermined("the boards lie in one plane"),
        calibration_reasons.BoardsParallel(2.0, "tilt it"),
        calibration_reasons.CornersMiss(4.0, 2.0),
        calibration_reasons.PointsUncertain(12.0, 1500.0, "mm", "capture more poses"),
    ]
    kinds = {kind for kind in vars(calibration_reasons).values() if isinstance(kind, type)}
    assert {type(cause) for cause in made} == {
        kind for kind in kinds if issubclass(kind, retrue.Reason) and kind is not retrue.Reason
    }
    assert all(str(cause) and "\n" not in str(cause) for cause in made)
    assert "pose_1: board not found" in str(made[0])
    assert "6x8: check --board" in str(made[1])
