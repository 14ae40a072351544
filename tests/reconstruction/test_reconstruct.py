import numpy as np
import pytest

from retrue.correspondences import Correspondences
from retrue.errors import DegenerateError
from retrue.geometry.transform import RigidTransform
from retrue.reconstruction.options import ReconstructOptions
from retrue.reconstruction.reconstruct import epipolar_residuals, reconstruct
from retrue.rig import Rig

from .scenes import CAMERA, PROJECTOR, RIG, correspondences, scene


def test_points_come_back_through_both_lenses():
    points, camera_px, cells, _ = scene(step=8)
    colors = np.arange(3 * len(points), dtype=np.uint8).reshape(-1, 3)
    cloud = reconstruct(RIG, correspondences(points, colors=colors, cells=cells), ReconstructOptions(keep_strays=True))
    assert np.abs(cloud.points - points).max() < 1e-6
    assert np.abs(cloud.camera_px - camera_px).max() < 1e-6
    assert np.array_equal(cloud.colors, colors)
    assert np.array_equal(cloud.cells, cells)
    assert cloud.unit == "mm"
    assert cloud.card["points"] == len(points)


def test_without_colours_the_cloud_is_grey():
    cloud = reconstruct(RIG, correspondences(scene(step=30)[0]))
    assert (cloud.colors == 128).all()
    assert cloud.colors.dtype == np.uint8


def test_outliers_are_dropped_and_counted():
    points = scene(step=8)[0]
    exact = correspondences(points)
    rng = np.random.default_rng(0)
    projector_px = exact.projector_px + rng.normal(scale=0.1, size=(len(points), 2))
    projector_px[::40, 1] += 30  # across the epipolar lines
    cloud = reconstruct(RIG, Correspondences(exact.camera_px, projector_px))
    assert cloud.card["dropped_epipolar_outliers"] == len(points[::40])
    assert len(cloud) == len(points) - len(points[::40])
    # The camera's share of each pixel is four times the projector's, by their focal lengths.
    assert cloud.card["epipolar_rms_px"] == pytest.approx(0.1 / np.hypot(1, 4), rel=0.1)


def test_more_sigmas_drop_less():
    exact = correspondences(scene(step=8)[0])
    noise = np.random.default_rng(0).normal(scale=0.2, size=exact.projector_px.shape)
    noisy = Correspondences(exact.camera_px, exact.projector_px + noise)
    few, many = (len(reconstruct(RIG, noisy, ReconstructOptions(outlier_sigmas=k))) for k in (1.0, 3.0))
    assert few < 0.75 * len(noisy) < 0.98 * len(noisy) < many


def test_points_behind_are_dropped_and_counted():
    points = scene(step=20)[0]
    exact = correspondences(points)
    projector_px = exact.projector_px.copy()
    epipolar_lines = PROJECTOR.project(RIG.projector_from_camera.apply(points * [[3.0, 3.0, 3.0]]))
    projector_px[:5] += 6 * (epipolar_lines - projector_px)[:5]  # along the lines, beyond infinity
    cloud = reconstruct(RIG, Correspondences(exact.camera_px, projector_px))
    assert cloud.card["dropped_behind_or_at_infinity"] == 5
    assert len(cloud) == len(points) - 5


def test_a_rig_without_a_baseline_sees_no_depth():
    rig = Rig(CAMERA, PROJECTOR, RigidTransform(np.eye(3), np.zeros(3)))
    with pytest.raises(DegenerateError, match="t = 0"):
        reconstruct(rig, correspondences(scene(step=30)[0]))


@pytest.mark.parametrize("count", [0, 3])
def test_nothing_in_front_is_an_error(count):
    backwards = Rig(CAMERA, PROJECTOR, RigidTransform(RIG.projector_from_camera.R, -RIG.projector_from_camera.t))
    points = correspondences(scene(step=30)[0]).select(np.arange(count))
    with pytest.raises(DegenerateError, match=f"none of {count} points"):
        reconstruct(backwards, points)


def test_epipolar_residuals_are_in_pixels():
    exact = correspondences(scene(step=20)[0])
    assert np.abs(epipolar_residuals(RIG, exact)).max() < 1e-6
    shifted = Correspondences(exact.camera_px, exact.projector_px + np.array([0.0, 1.0]))
    residual = np.abs(epipolar_residuals(RIG, shifted))
    # A finer projector shares the pixel unequally: 1400 of its pixels are 350 of the camera's.
    expected = 1 / np.hypot(1, 4)
    assert np.median(residual) == pytest.approx(expected, rel=0.05)
