"""The projector's light: areas as geometry has them, and the truth preferred to its twin on hostile walls."""

from __future__ import annotations

import numpy as np
import pytest

from retrue.geometry.planar_pose import in_front, planar_pose_candidates
from retrue.geometry.transform import rotation_angle
from retrue.recalibration.light import light_costs, log_irradiance
from tests.recalibration.scenes import CAMERA, POSE, PROJECTOR, WALL, Scene, capture


def test_irradiance_is_one_over_the_area_that_a_pixel_lights() -> None:
    rng = np.random.default_rng(0)
    y = rng.uniform(-0.4, 0.4, (50, 2))
    n = WALL[0] / np.linalg.norm(WALL[0]) / WALL[1]
    in_projector = (POSE.R @ n) / (1 + (POSE.R @ n) @ POSE.t)
    size = 1e-4
    corners = y[:, None] + size * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    rays = np.concatenate([corners, np.ones((50, 4, 1))], axis=2)
    on_plane = rays / (rays @ in_projector)[..., None]
    diagonals = on_plane[:, 2] - on_plane[:, 0], on_plane[:, 3] - on_plane[:, 1]
    expected = -np.log(np.linalg.norm(np.cross(*diagonals), axis=1) / 2)
    found = log_irradiance(y, POSE.R, POSE.t, np.tile(n, (50, 1)))
    np.testing.assert_allclose(found - found.mean(), expected - expected.mean(), atol=1e-6)


def test_a_plane_seen_from_behind_is_not_lit() -> None:
    found = log_irradiance(np.zeros((1, 2)), np.eye(3), np.array([0.0, 0, -4]), np.array([[0.0, 0, 0.5]]))
    assert np.isnan(found).all()


@pytest.mark.parametrize("gamma", [1.0, 0.45])
@pytest.mark.parametrize("paint", [0.0, 0.7])
def test_light_prefers_the_truth_on_a_bare_wall(gamma: float, paint: float) -> None:
    """Print with sharp edges, a camera's curve and a projector a third darker at one side."""
    rng = np.random.default_rng(1)
    points = capture(Scene(), area=(0.4, 0.7, 0.4, 0.7), grid=(30, 24))
    x, y = CAMERA.unproject(points.camera_px), PROJECTOR.unproject(points.projector_px)
    n = WALL[0] / np.linalg.norm(WALL[0]) / WALL[1]
    twins = planar_pose_candidates(POSE.R + np.outer(POSE.t, n), [*x.mean(axis=0), 1.0])
    truth, twin = sorted(twins, key=lambda pose: rotation_angle(pose.R @ POSE.R.T))
    assert in_front(twin, x).all()
    predictions = [
        log_irradiance(y, pose.R, pose.translation_over_distance, np.tile(pose.normal, (len(x), 1)))
        for pose in (truth, twin)
    ]
    raster = 2 * (points.projector_px + 0.5) / np.array(PROJECTOR.size) - 1
    print_ = -paint * ((np.floor(points.camera_px / 60).sum(axis=1) % 2) > 0)
    lamp = np.log(1 - 0.17 * (1 + raster[:, 0]))
    light = np.exp(gamma * (predictions[0] + print_ + lamp) + rng.normal(0, 0.02, len(x)))
    found = light_costs(light, np.zeros(len(x), dtype=np.int64), x, raster, predictions, rng)
    assert found is not None
    assert found[1] - found[0] > 20


def test_where_little_is_lit_the_light_says_nothing() -> None:
    rows = np.full(100, np.nan)
    rows[:10] = 1
    xy = np.random.default_rng(0).uniform(-0.3, 0.3, (100, 2))
    assert light_costs(rows, np.zeros(100, dtype=np.int64), xy, xy, [np.zeros(100)], np.random.default_rng(0)) is None
