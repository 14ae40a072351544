"""Every reason to refuse, each triggered by what it is there for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from retrue.correspondences import Card, Correspondences
from retrue.geometry.transform import RigidTransform
from retrue.recalibration import reasons
from retrue.recalibration.options import RecalibrateOptions, VerifyOptions
from retrue.recalibration.recalibrate import recalibrate
from retrue.recalibration.result import Accepted, Refused, unattended
from retrue.recalibration.verify import verify
from retrue.rig import Rig
from tests.recalibration.scenes import CAMERA, POSE, PROJECTOR, RIG, SIDE_WALL, SPHERE, WALL, Scene, bumped, capture

PATCH = (0.45, 0.65, 0.45, 0.65)
WITH_SPHERE = Scene(spheres=[SPHERE])
CORNER = Scene(planes=[WALL, SIDE_WALL], spheres=[SPHERE])
Case = tuple[Rig, list[Correspondences]] | tuple[Rig, list[Correspondences], RecalibrateOptions]


def few_points() -> Case:
    return RIG, [capture(Scene()).select(np.array([0, 100, 500]))]


def one_line() -> Case:
    line = np.stack([np.linspace(100, 900, 50), np.linspace(100, 700, 50)], axis=1)
    return RIG, [Correspondences(line, line)]


def four_points() -> Case:
    return RIG, [capture(Scene(), area=PATCH, grid=(2, 2))], RecalibrateOptions(min_points=4)


def small_wall_after_a_large_move() -> Case:
    return bumped(RIG, [0, 30, 0], [0, 0, 60]), [capture(Scene(), area=PATCH)]


def prior_between_the_twins() -> Case:
    points = capture(Scene(), area=PATCH)
    first, second = (c.projector_from_camera for c in recalibrate(RIG, [points]).evidence.candidates[:2])
    return Rig(CAMERA, PROJECTOR, RigidTransform(POSE.R, first.t + second.t), "m"), [points]


def tiny_patch() -> Case:
    return RIG, [capture(Scene(), area=(0.35, 0.45, 0.35, 0.45), grid=(5, 5))]


def along_the_normal() -> Case:
    return RIG, [capture(Scene(planes=[(POSE.R.T @ POSE.t, 0.3)]), noise=0.01)]


def mostly_wrong() -> Case:
    return RIG, [capture(WITH_SPHERE, outliers=0.75)]


def captures_of_two_poses() -> Case:
    return RIG, [capture(WITH_SPHERE), capture(Scene(), rig=bumped(RIG, [0, 2, 0], [0, 0, 2]), grid=(20, 16))]


def two_poses_in_one_capture() -> Case:
    one, other = capture(CORNER), capture(CORNER, rig=bumped(RIG, [3, 5, 0], [0, 0, 5]), seed=1)
    both = (one, other)
    return RIG, [
        Correspondences(
            np.concatenate([part.camera_px for part in both]), np.concatenate([part.projector_px for part in both])
        )
    ]


def zoomed(factor: float, scene: Scene, **settings: Any) -> Case:
    camera = replace(CAMERA, K=CAMERA.K * [[factor, 1, 1], [1, factor, 1], [1, 1, 1]])
    return RIG, [capture(scene, rig=replace(RIG, camera=camera), **settings)]


def exchanged() -> Case:
    points = capture(WITH_SPHERE)
    return RIG, [Correspondences(points.projector_px, points.camera_px)]


def upside_down() -> Case:
    points = capture(CORNER)
    return RIG, [Correspondences(np.array(CAMERA.size) - 1.0 - points.camera_px, points.projector_px)]


def rows_and_columns() -> Case:
    points = capture(CORNER, area=(0.1, 0.7, 0.1, 0.7))
    return RIG, [Correspondences(points.camera_px[:, ::-1], points.projector_px[:, ::-1])]


def camera_from_projector() -> Case:
    return replace(RIG, projector_from_camera=POSE.inverse()), [capture(Scene(), area=(0.4, 0.7, 0.4, 0.7))]


def refocused() -> Case:
    return zoomed(1.03, CORNER)


CASES: dict[Callable[[], Case], type[reasons.Reason]] = {
    few_points: reasons.TooFewPoints,
    one_line: reasons.PointsNotSpread,
    four_points: reasons.PoseUndetermined,
    small_wall_after_a_large_move: reasons.RivalUnbeaten,
    prior_between_the_twins: reasons.RivalUnbeaten,
    tiny_patch: reasons.Imprecise,
    along_the_normal: reasons.Imprecise,
    mostly_wrong: reasons.PointsDisagree,
    captures_of_two_poses: reasons.CapturesDiffer,
    two_poses_in_one_capture: reasons.PartsContradict,
    refocused: reasons.LensChanged,
    exchanged: reasons.DevicesExchanged,
    upside_down: reasons.PictureTurned,
    rows_and_columns: reasons.AxesExchanged,
    camera_from_projector: reasons.PoseInverted,
}
UNATTENDED = reasons.LensUnchecked
OF_VERIFY = (reasons.OneCoordinate, reasons.PoseDrifted, reasons.PoseContradicted, reasons.RaysMiss)
ADVICE = {
    reasons.TooFewPoints: "light more of the scene",
    reasons.PointsNotSpread: "must be spread out",
    reasons.PoseUndetermined: "show more of a scene",
    reasons.RivalUnbeaten: "put an object or a second plane in view",
    reasons.Imprecise: "light more of the scene",
    reasons.PointsDisagree: "is it another rig's picture?",
    reasons.CapturesDiffer: "recalibrate on each by itself",
    reasons.PartsContradict: "did the rig move during the capture",
    reasons.LensChanged: "--lens refit",
    reasons.DevicesExchanged: "are camera pixels first",
    reasons.PictureTurned: "take it as for the calibration",
    reasons.AxesExchanged: "x counts columns and comes first",
    reasons.PoseInverted: "hand in the inverse",
    reasons.LensUnchecked: "--lens fixed",
}


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.__name__)
def test_each_reason_is_given_for_its_fault(case: Callable[[], Case]) -> None:
    result = recalibrate(*case())
    assert isinstance(result, Refused), result.reason
    assert type(result.cause) is CASES[case], result.reason
    assert result.reason == str(result.cause)
    assert "\n" not in result.reason
    assert ADVICE[type(result.cause)] in result.reason


def test_what_nobody_vouches_for_is_not_written_over_a_rig() -> None:
    """A wall and a sphere do not check the lenses: people are told so, and what asks nobody gets no rig."""
    old, points = bumped(RIG, [3, -4, 2], [4, -6, 5]), [capture(WITH_SPHERE)]
    told = recalibrate(old, points)
    assert isinstance(told, Accepted), told.reason
    assert told.evidence.lens == "unchecked"
    refused = unattended(told)
    assert isinstance(refused, Refused)
    assert type(refused.cause) is UNATTENDED
    assert refused.reason == str(refused.cause)
    assert ADVICE[UNATTENDED] in refused.reason
    assert refused.evidence is told.evidence
    vouched = recalibrate(old, points, RecalibrateOptions(lens="fixed"))
    assert unattended(vouched) is vouched


def test_no_reason_is_without_a_case() -> None:
    types = {value for value in vars(reasons).values() if isinstance(value, type)}
    assert {kind for kind in types if issubclass(kind, reasons.Reason)} - {reasons.Reason} == {
        *CASES.values(),
        UNATTENDED,
        *OF_VERIFY,
    }


def test_the_decoder_says_why_there_are_few_points() -> None:
    card = Card("blocks", 900, 3, {}, 0.4, ("not a colour picture",))
    few = replace(capture(Scene()).select(np.array([0, 100, 500])), card=card)
    for answer in (recalibrate(RIG, [few]), verify(RIG, [few])):
        assert isinstance(answer.cause, reasons.TooFewPoints)
        assert answer.reason.endswith("found 3; not a colour picture")


def test_what_contradicts_a_rig_forbids_to_measure_with_it() -> None:
    moved = verify(bumped(RIG, [0, 1, 0], [0, 0, 0]), [capture(CORNER)])
    hardly = verify(bumped(RIG, [0, 1, 0], [0, 0, 0]), [capture(CORNER)], VerifyOptions(improvable=0.5))
    lost = verify(RIG, mostly_wrong()[1])
    few = verify(RIG, few_points()[1])
    assert [type(answer.cause) for answer in (moved, hardly)] == [reasons.PoseDrifted] * 2
    assert (moved.band, hardly.band) == ("recalibrate", "improvable")
    assert [answer.forbids_measuring for answer in (moved, hardly, lost, few)] == [True, False, True, False]
    contradicted = str(reasons.PoseContradicted(9.5, reasons.Imprecise(1.0, 2.0, 0.05, 0.03)))
    assert contradicted.startswith("the points contradict the rig's pose by 9.5 sigma, though the points know")
    assert "no correspondences agree" in str(reasons.PointsDisagree(0.0, 0.35, 2.1, 2.0))


def test_a_lens_that_no_single_number_tells_of_is_not_given_one() -> None:
    """Numbers that only matter together are none of them the cause."""
    clear, mixed = (str(reasons.LensChanged("projector", "k1", amount, 0.02, 40.0)) for amount in (-0.08, -0.03))
    assert "a k1 of the projector that is -0.08 off (sigma 0.02)" in clear
    assert "which number of the camera's or the projector's is off, they do not tell" in mixed
    assert "--lens refit" in clear
    assert "--lens refit" in mixed


def test_how_far_a_rig_moved_is_said_also_where_no_rays_meet() -> None:
    assert reasons.drift_text(1, 2, 3.0, 40.0, "mm").endswith(", 3 mm for points at 40 mm")
    assert reasons.drift_text(180, 2, float("inf"), 40.0, "mm").endswith(", so far that no rays meet at 40 mm")
    assert reasons.drift_text(180, 2, float("inf"), None, "mm").endswith("in the direction of t")
    assert reasons.drift_text(1, 2, None, 40.0, "mm").endswith("in the direction of t")
