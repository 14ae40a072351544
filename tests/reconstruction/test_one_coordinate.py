"""Columns or rows alone place the same points; a pose is not asked of them."""

from __future__ import annotations

import numpy as np
import pytest

import retrue
from retrue.errors import CaptureError
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform

CAMERA = Camera((1280, 960), [[1500, 0, 640], [0, 1490, 470], [0, 0, 1]], [-0.1, 0.05, 1e-3, -1e-3, 0])
PROJECTOR = Camera((1024, 768), [[1400, 2, 520], [0, 1410, 700], [0, 0, 1]], [-0.08, 0.02, 5e-4, 1e-3, 0])


def scene(axis: int) -> tuple[retrue.Rig, retrue.Correspondences, np.ndarray]:
    """A bowed surface, and a rig whose baseline suits that axis."""
    t = [-200.0, -30.0, 20.0] if axis == 0 else [30.0, -200.0, 20.0]
    pose = RigidTransform.from_rotation_vector([0.15, -0.2, 0.05], t)
    rig = retrue.Rig(CAMERA, PROJECTOR, pose, "mm")
    x, y = np.meshgrid(np.linspace(-150, 150, 20), np.linspace(-100, 100, 15))
    points = np.stack([x.ravel(), y.ravel(), 900 + 1e-3 * (x * x + y * y).ravel()], axis=1)
    projector_px = PROJECTOR.project(pose.apply(points))
    inside = PROJECTOR.contains(projector_px)
    assert inside.sum() > 100
    return rig, retrue.Correspondences(CAMERA.project(points)[inside], projector_px[inside]), points[inside]


def only(points: retrue.Correspondences, axis: int) -> retrue.Correspondences:
    projector_px = points.projector_px.copy()
    projector_px[:, 1 - axis] = np.nan
    return retrue.Correspondences(points.camera_px, projector_px)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_ray_meets_the_plane_of_a_column_or_row(axis: int) -> None:
    rig, points, truth = scene(axis)
    cloud = retrue.reconstruct(rig, only(points, axis))
    assert len(cloud) == len(points)
    assert np.abs(cloud.points - truth).max() < 1e-4
    assert cloud.card["epipolar_rms_px"] is None


def test_what_lies_beyond_the_projector_is_left_out() -> None:
    rig, points, _ = scene(0)
    columns = only(points, 0)
    moved = columns.projector_px.copy()
    moved[:10, 0] = 5000.0
    cloud = retrue.reconstruct(rig, retrue.Correspondences(columns.camera_px, moved))
    assert len(cloud) == len(points) - 10


@pytest.mark.parametrize(("axis", "other"), [(0, "row"), (1, "column")])
def test_verify_and_recalibrate_ask_for_the_other_axis(axis: int, other: str) -> None:
    rig, points, _ = scene(axis)
    for job in (retrue.verify, retrue.recalibrate):
        with pytest.raises(CaptureError, match=f"take a few {other} pictures too"):
            job(rig, [only(points, axis)])


def test_only_a_whole_column_may_be_unknown() -> None:
    _, points, _ = scene(0)
    assert points.axes == (0, 1)
    assert only(points, 1).axes == (1,)
    holed = points.projector_px.copy()
    holed[0, 1] = np.nan
    for wrong in (holed, np.full_like(holed, np.nan)):
        with pytest.raises(retrue.InputError, match="projector_px: expected finite numbers"):
            retrue.Correspondences(points.camera_px, wrong)
    assert "y" not in repr(only(points, 0)).split("projector_px")[1]
