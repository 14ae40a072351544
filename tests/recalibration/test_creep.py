"""The filter over many frames, on poses whose noise is known."""

from __future__ import annotations

import numpy as np
import pytest

from retrue.geometry.transform import RigidTransform
from retrue.geometry.two_view import tangent_basis
from retrue.recalibration.creep import Creep, after_frame, creep_is_due, jump
from retrue.recalibration.result import PoseSigma, Verification
from retrue.recalibration.streak import CreepOptions

POSE = RigidTransform.from_rotation_vector([0.05, -0.2, 0.02], [0.35, -0.04, 0.06])
SIGMA_DEG = 0.05
OPTIONS = CreepOptions()


def frame(rng: np.random.Generator, off_deg: float, verdict: str = "good") -> Verification:
    """What a capture says of a rig that is turned so far, with noise of one sigma in all."""
    noise = rng.normal(0, np.radians(SIGMA_DEG) / np.sqrt(3), (2, 3))
    turn = RigidTransform.from_rotation_vector(np.radians([off_deg, 0, 0]) + noise[0], np.zeros(3))
    moved = turn @ POSE
    seen = RigidTransform(moved.R, moved.t + np.cross(noise[1], moved.t))
    return Verification(verdict, "", 0.1, 400, sigma=PoseSigma(SIGMA_DEG, SIGMA_DEG), supported_pose=seen)


def followed(offs: np.ndarray, seed: int, start_deg: float = 0.0) -> tuple[Creep, int | None]:
    """The filter at the end, and the first frame after which a recalibration is due."""
    rng, creep, due = np.random.default_rng(seed), None, None
    for number, off in enumerate(offs):
        creep = after_frame(creep, POSE, frame(rng, start_deg + off), OPTIONS)
        if due is None and creep_is_due(creep, OPTIONS):
            due = number
    return creep, due


@pytest.mark.parametrize("start_deg", [0.0, 0.04])
def test_a_rig_that_holds_is_left_alone(start_deg):
    """Also where it was off from the beginning, as a rig is that was recalibrated from a few frames."""
    assert [followed(np.zeros(300), seed, start_deg)[1] for seed in range(3)] == [None] * 3


def test_creep_is_followed_within_sigma_and_found_before_a_frame_alone_would():
    offs = np.concatenate([np.zeros(60), np.linspace(0, 0.15, 300)])
    for seed in range(2):
        creep, due = followed(offs, seed)
        assert due is not None
        assert offs[due] < 0.1
        assert abs(np.degrees(creep.added[0]) - 0.15) < SIGMA_DEG


def test_a_bump_is_no_creep():
    rng = np.random.default_rng(3)
    creep, _ = followed(np.zeros(60), 3)
    bumped = frame(rng, 1.0, "drifted")
    assert jump(creep, POSE, bumped, OPTIONS) > OPTIONS.creep_sigmas
    after = after_frame(creep, POSE, bumped, OPTIONS)
    assert np.array_equal(after.offset, creep.offset)
    assert jump(creep, POSE, frame(rng, 0.05), OPTIONS) < OPTIONS.creep_sigmas


def test_another_scene_begins_anew_and_is_no_creep():
    """All that a scene adds, it adds at once; the filter is not stuck at the one before."""
    rng = np.random.default_rng(5)
    creep, _ = followed(np.zeros(60), 5)
    for _ in range(3 * OPTIONS.creep_memory):
        creep = after_frame(creep, POSE, frame(rng, 0.5), OPTIONS)
        assert not creep_is_due(creep, OPTIONS)
    assert np.degrees(creep.offset[0]) == pytest.approx(0.5, abs=SIGMA_DEG)
    assert creep.bumps == 1


@pytest.mark.parametrize("rate_deg", [0.0002, 0.02])
def test_a_creep_of_any_rate_is_followed_without_delay(rate_deg):
    """0.01 and 1 deg an hour, with a frame a minute."""
    offs = rate_deg * np.arange(400)
    creep, _ = followed(offs, 4)
    assert creep.bumps == 0
    assert abs(np.degrees(creep.offset[0]) - offs[-1]) < SIGMA_DEG / 2


def test_what_frames_know_of_each_axis_counts():
    """A frame that knows one axis ten times worse leaves that one open, and no other."""
    rng, creep = np.random.default_rng(2), None
    deviations = np.radians([0.01, 0.1, 0.01, 0.05, 0.02])
    for _ in range(200):
        error = rng.normal(0, deviations)
        turn = RigidTransform.from_rotation_vector(error[:3], np.zeros(3))
        direction = POSE.t / np.linalg.norm(POSE.t) + tangent_basis(POSE.t / np.linalg.norm(POSE.t)) @ error[3:]
        seen = RigidTransform(turn.R @ POSE.R, direction)
        said = Verification(
            "good", "", 0.1, 400, sigma=PoseSigma(0.1, 0.05), supported_pose=seen,
            statistical_covariance=np.diag(deviations**2),
        )  # fmt: skip
        creep = after_frame(creep, POSE, said, OPTIONS)
    known = np.sqrt(np.diag(creep.covariance)[:5])
    assert np.allclose(known / deviations, known[0] / deviations[0], rtol=0.2)
    assert (np.abs(creep.offset) < 4 * known).all()
    assert creep.scatter == pytest.approx(1, abs=0.3)


def test_a_frame_that_cannot_tell_changes_nothing():
    creep, _ = followed(np.zeros(10), 1)
    assert after_frame(creep, POSE, Verification("unknown", "", None, 0), OPTIONS) is creep
    assert after_frame(None, POSE, Verification("unknown", "", None, 0), OPTIONS) is None
    assert not creep_is_due(None, OPTIONS)
