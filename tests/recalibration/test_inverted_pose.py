"""A rig's pose written the other way round, camera_from_projector, is named; answers stay as they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from retrue.geometry.transform import RigidTransform, direction_angle, rotation_angle
from retrue.recalibration import reasons
from retrue.recalibration.recalibrate import recalibrate
from retrue.recalibration.result import Accepted
from retrue.recalibration.verify import verify
from retrue.rig import Rig
from tests.recalibration.scenes import BALLS, CAMERA, POSE, RIG, SIDE_WALL, SPHERE, WALL, Scene, bumped, capture

SCENES = {
    "corner": Scene(planes=[WALL, SIDE_WALL]),
    "wall and ball": Scene(spheres=[SPHERE]),
    "balls": BALLS,
}
OLD = bumped(RIG, [2, 5, -1], [0, 4, 0])


def inverse(rig: Rig) -> Rig:
    return replace(rig, projector_from_camera=rig.projector_from_camera.inverse())


def degrees_off(pose: RigidTransform) -> tuple[float, float]:
    return float(np.degrees(rotation_angle(pose.R @ POSE.R.T))), float(np.degrees(direction_angle(pose.t, POSE.t)))


@pytest.mark.parametrize("scene", SCENES)
def test_an_answer_that_the_points_give_names_it(scene: str) -> None:
    points = capture(SCENES[scene])
    wrong, right = (recalibrate(rig, [points]) for rig in (inverse(OLD), OLD))
    assert isinstance(wrong, Accepted), wrong.reason
    assert isinstance(right, Accepted)
    assert "camera_from_projector: the rig moved by" in wrong.reason
    assert "camera_from_projector" not in right.reason
    assert np.allclose(degrees_off(wrong.rig.projector_from_camera), 0, atol=(0.1, 0.3))
    held = verify(inverse(RIG), [points])
    assert held.verdict == "drifted"
    assert isinstance(held.cause, reasons.PoseDrifted)
    assert held.cause.inverted is not None
    assert held.cause.inverted.meant_deg < 1
    assert "camera_from_projector" in held.reason


def test_a_wall_that_needs_the_old_pose_is_not_answered() -> None:
    small = capture(Scene(), area=(0.4, 0.7, 0.4, 0.7), grid=(80, 60))
    answer = recalibrate(inverse(OLD), [small])
    assert isinstance(answer.cause, reasons.PoseInverted), answer.reason
    assert answer.cause.meant_deg < 15 < answer.cause.moved_deg
    assert verify(inverse(RIG), [small]).verdict != "good"


def test_of_two_cameras_alike_either_may_be() -> None:
    """Exchanged, their points ask for the inverse of the pose, and lenses that are the same do not object."""
    rig = replace(RIG, projector=CAMERA)
    answer = recalibrate(inverse(rig), [capture(SCENES["wall and ball"], rig=rig)])
    assert isinstance(answer.cause, reasons.DevicesExchanged), answer.reason
    assert answer.cause.inverted is not None
    assert "Or the rig's old pose may be written the other way round" in answer.reason


@pytest.mark.parametrize("degrees", [60.0, 120.0, 175.0])
def test_a_rig_that_moved_far_elsewhere_is_not_told_so(degrees: float) -> None:
    answer = recalibrate(bumped(RIG, [0, 0, degrees], [0, 0, degrees / 3]), [capture(SCENES["corner"])])
    assert "camera_from_projector" not in answer.reason
