"""Captures of two poses that a pose between them explains, as if neighbours shared an error, are told apart."""

from __future__ import annotations

import numpy as np
import pytest

from retrue.geometry.arrays import FloatArray
from retrue.geometry.transform import RigidTransform
from retrue.recalibration import reasons
from retrue.recalibration.recalibrate import recalibrate
from retrue.recalibration.result import Accepted, Refused
from retrue.rig import Rig
from tests.recalibration.scenes import CAMERA, PROJECTOR, Scene, bumped, capture

POSE = RigidTransform.from_rotation_vector([0.03, -0.1, 0.02], [0.19, -0.02, 0.03])
RIG = Rig(CAMERA, PROJECTOR, POSE, "m")


def bulged(rng: np.random.Generator, distance: float, radius: float) -> Scene:
    """A wall that bulges towards the camera as a ball of that radius does."""
    normal: FloatArray = np.array([*rng.uniform(-0.5, 0.5, 2), 1.0])
    return Scene([], [(normal / np.linalg.norm(normal) * (distance + radius), radius)])


@pytest.mark.parametrize(("turn", "radius", "seed"), [(1.0, 20.0, 2), (1.0, 20.0, 14), (2.0, 8.0, 9)])
def test_two_bulged_walls_of_two_poses_share_none(turn: float, radius: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    first, second = bulged(rng, 1.5, radius), bulged(rng, 1.6, radius)
    other = bumped(RIG, [0.2 * turn, turn, 0.1], [0, turn, turn / 2])
    here = capture(first, rig=RIG, noise=0.05, seed=seed)
    result = recalibrate(RIG, [here, capture(second, rig=other, noise=0.05, seed=seed + 50)])
    assert isinstance(result, Refused)
    assert isinstance(result.cause, reasons.CapturesDiffer), result.reason
    both = recalibrate(RIG, [here, capture(second, rig=RIG, noise=0.05, seed=seed + 50)])
    assert isinstance(both, Accepted), both.reason
