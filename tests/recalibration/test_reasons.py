"""Every reason to refuse, each triggered by what it is there for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from retrue.correspondences import Correspondences
from retrue.geometry.transform import RigidTransform, rotation_from_vector
from retrue.recalibration import reasons
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.recalibrate import recalibrate
from retrue.recalibration.result import Refused
from retrue.rig import Rig
from tests.recalibration.scenes import CAMERA, POSE, PROJECTOR, RIG, SPHERE, WALL, Scene, bumped, capture

PATCH = (0.45, 0.65, 0.45, 0.65)
WITH_SPHERE = Scene(spheres=[SPHERE])
Case = tuple[Rig, list[Correspondences]] | tuple[Rig, list[Correspondences], RecalibrateOptions]


def few_points() -> Case:
    return RIG, [capture(Scene()).select(np.array([0, 100, 500]))]


def one_line() -> Case:
    line = np.stack([np.linspace(100, 900, 50), np.linspace(100, 700, 50)], axis=1)
    return RIG, [Correspondences(line, line)]


def no_plane() -> Case:
    rng = np.random.default_rng(0)
    points = np.c_[rng.uniform(-0.4, 0.4, (2000, 2)), rng.uniform(1.2, 2, 2000)]
    return RIG, [Correspondences(CAMERA.project(points), PROJECTOR.project(POSE.apply(points)))]


def four_points() -> Case:
    return RIG, [capture(Scene(), area=PATCH, grid=(2, 2))], RecalibrateOptions(min_points=4)


def prior_between_the_twins() -> Case:
    points = capture(Scene(), area=PATCH)
    first, second = (c.projector_from_camera for c in recalibrate(RIG, [points]).evidence.candidates)
    return Rig(CAMERA, PROJECTOR, RigidTransform(POSE.R, first.t + second.t), "m"), [points]


def behind_the_projector() -> Case:
    """Rays that meet the plane behind the camera are no picture of any rig."""
    rng = np.random.default_rng(1)
    x = np.c_[rng.uniform(-0.35, 0.35, (600, 2)), np.ones(600)]
    n = np.array([2.2, 0.3, 0.55])
    y = x @ POSE.R.T + (x @ n)[:, None] * POSE.t
    return RIG, [Correspondences(CAMERA.project(x), PROJECTOR.project(y / y[:, 2:]))]


def tiny_patch() -> Case:
    return RIG, [capture(Scene(), area=(0.35, 0.45, 0.35, 0.45), grid=(5, 5))]


def mostly_wrong() -> Case:
    return RIG, [capture(WITH_SPHERE, outliers=0.75)]


def another_lens() -> Case:
    return RIG, [capture(WITH_SPHERE, rig=replace(RIG, camera=replace(CAMERA, distortion=[-0.13, 0.05, 0, 0, 0])))]


def captures_of_two_poses() -> Case:
    return RIG, [capture(WITH_SPHERE), capture(Scene(), rig=bumped(RIG, [0, 2, 0], [0, 0, 2]), grid=(20, 16))]


def two_scenes_at_once() -> Case:
    """Neighbouring points lie on the wall and on a screen before it, by turns."""
    far, near = capture(Scene()), capture(Scene(planes=[(WALL[0], 1.45)]))
    count = min(len(far), len(near))
    own = np.random.default_rng(0).random((count, 1)) < 0.5
    return RIG, [
        Correspondences(
            np.where(own, far.camera_px[:count], near.camera_px[:count]),
            np.where(own, far.projector_px[:count], near.projector_px[:count]),
        )
    ]


def zoomed(factor: float, *spheres: tuple[np.ndarray, float]) -> Case:
    camera = replace(CAMERA, K=CAMERA.K * [[factor, 1, 1], [1, factor, 1], [1, 1, 1]])
    return RIG, [capture(Scene(spheres=[SPHERE, *spheres]), rig=replace(RIG, camera=camera))]


def refocused() -> Case:
    return zoomed(1.015)


def zoomed_before_two_objects() -> Case:
    return zoomed(1.01, (np.array([-0.2, -0.1, 1.2]), 0.1))


def zoomed_before_one_object() -> Case:
    return zoomed(0.97)


def turned_round() -> Case:
    return bumped(RIG, [0, 60, 0], [0, 0, 0]), [capture(WITH_SPHERE)]


def large_change_on_a_bare_wall() -> Case:
    return bumped(RIG, [0, 30, 0], [0, 0, 0]), [capture(Scene())]


def along_the_normal() -> Case:
    direction = POSE.R.T @ POSE.t
    facing = rotation_from_vector([0.0, 0.018, 0.0]) @ (direction / np.linalg.norm(direction))
    return RIG, [capture(Scene(planes=[(facing, 0.3)]), noise=0.01)]


CASES: dict[Callable[[], Case], type[reasons.Reason]] = {
    few_points: reasons.TooFewPoints,
    one_line: reasons.PointsNotSpread,
    no_plane: reasons.NoPlane,
    four_points: reasons.PoseUndetermined,
    prior_between_the_twins: reasons.TwinsUnresolved,
    behind_the_projector: reasons.PointsBehind,
    tiny_patch: reasons.Imprecise,
    mostly_wrong: reasons.PointsDisagree,
    another_lens: reasons.ResidualsHaveStructure,
    captures_of_two_poses: reasons.PlaneContradicts,
    two_scenes_at_once: reasons.PlanesInterleave,
    refocused: reasons.FocalLengthChanged,
    zoomed_before_two_objects: reasons.PlaneAndRestContradict,
    zoomed_before_one_object: reasons.SurfaceContradicts,
    turned_round: reasons.ImplausibleChange,
    large_change_on_a_bare_wall: reasons.ImplausibleChange,
    along_the_normal: reasons.NearFold,
}


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.__name__)
def test_each_reason_is_given_for_its_fault(case: Callable[[], Case]) -> None:
    result = recalibrate(*case())
    assert isinstance(result, Refused), result.reason
    assert type(result.cause) is CASES[case], result.reason
    assert result.reason == str(result.cause)
    assert "\n" not in result.reason


def test_no_reason_is_without_a_case() -> None:
    types = {value for value in vars(reasons).values() if isinstance(value, type)}
    assert {kind for kind in types if issubclass(kind, reasons.Reason)} - {reasons.Reason} == set(CASES.values())


def test_a_large_change_is_believed_where_the_points_check_the_intrinsics() -> None:
    for points, believed in ((capture(WITH_SPHERE), True), (capture(Scene(planes=[WALL])), False)):
        result = recalibrate(bumped(RIG, [0, 30, 0], [0, 0, 0]), [points])
        assert isinstance(result, Refused) != believed, result.reason
