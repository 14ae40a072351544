"""Smoothing evens out noise, says how much is left, and carries nothing over an edge."""

import numpy as np
import pytest

from retrue.correspondences import Correspondences
from retrue.errors import InputError
from retrue.reconstruction.cloud import Cloud
from retrue.reconstruction.options import ReconstructOptions
from retrue.reconstruction.reconstruct import reconstruct
from retrue.reconstruction.smooth import smoothed
from tests.reconstruction.scenes import CAMERA, RIG, scene


def seen(X: np.ndarray, cells: np.ndarray | None, noise: float, seed: int = 1, missing: float = 0.0) -> Correspondences:
    rng = np.random.default_rng(seed)
    projector_px = RIG.projector.project(RIG.projector_from_camera.apply(X))
    projector_px = projector_px + rng.normal(0, noise, projector_px.shape)
    kept = rng.random(len(X)) >= missing
    sigma = np.full(int(kept.sum()), noise)
    own = None if cells is None else cells[kept]
    return Correspondences(CAMERA.project(X[kept]), projector_px[kept], projector_sigma_px=sigma, cells=own)


def along_rays(cloud: Cloud, X: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Errors (N,) of the cloud's points along the camera's rays."""
    assert cloud.cells is not None
    row = np.empty(cells.max(axis=0) + 1, np.int64)
    row[tuple(cells.T)] = np.arange(len(cells))
    truth = X[row[tuple(cloud.cells.T)]]
    return ((cloud.points - truth) * truth).sum(axis=1) / np.linalg.norm(truth, axis=1)


@pytest.mark.parametrize(("noise", "missing"), [(0.1, 0.0), (0.4, 0.002)])
def test_noise_is_evened_out_and_sigma_says_what_is_left(noise, missing):
    X, _, cells, _ = scene(1)
    points = seen(X, cells, noise, missing=missing)
    plain, smooth = reconstruct(RIG, points), reconstruct(RIG, points, ReconstructOptions(smooth=True))
    before, after = along_rays(plain, X, cells), along_rays(smooth, X, cells)
    assert np.median(np.abs(after)) < np.median(np.abs(before)) / 4
    within = [np.mean(np.abs(after) < k * smooth.sigma) for k in (1, 2, 3)]
    assert within == pytest.approx([0.683, 0.954, 0.997], abs=0.03)
    assert smooth.card["sigma"] == pytest.approx(float(np.median(smooth.sigma)))
    assert smooth.card["smoothed"] > 0.9 * len(smooth)
    np.testing.assert_allclose(smooth.uncertainty.along_rays(smooth.points), smooth.sigma, rtol=0.05, equal_nan=False)


@pytest.mark.parametrize("noise", [0.02, 0.1, 0.4])
def test_nothing_is_carried_over_an_edge(noise):
    X, _, cells, _ = scene(1)
    plain = reconstruct(RIG, seen(X, cells, noise, missing=0.005))
    smooth = smoothed(plain)
    moved = np.linalg.norm(smooth.points - plain.points, axis=1)
    assert (moved <= 6 * plain.sigma).all()  # the plate stands out by hundreds of sigmas, the ball by more
    assert (np.abs(along_rays(smooth, X, cells)) <= 6 * plain.sigma).all()


def test_a_crease_stays_one():
    v, u = np.mgrid[0:200, 0:300]
    pixels = np.stack([u, v], axis=-1).reshape(-1, 2).astype(float)
    cells = np.stack([v, u], axis=-1).reshape(-1, 2)
    rays = np.column_stack([CAMERA.unproject(pixels), np.ones(len(pixels))])
    roof = np.minimum(rays @ [0.4, 0.0, 0.7], rays @ [-0.4, 0.0, 0.7]) / 1000
    plain = reconstruct(RIG, seen(rays / roof[:, None], cells, 0.1))
    smooth = smoothed(plain)
    error = np.abs(along_rays(smooth, rays / roof[:, None], cells))
    beside = np.abs(smooth.points[:, 0] / smooth.points[:, 2]) < 8 / 350
    assert np.median(error[beside]) < np.median(np.abs(along_rays(plain, rays / roof[:, None], cells))[beside]) * 0.7
    for near in (beside, np.abs(smooth.points[:, 0] / smooth.points[:, 2]) < 2 / 350):
        within = [np.mean(error[near] < k * smooth.sigma[near]) for k in (1, 2, 3)]
        assert within == pytest.approx([0.683, 0.954, 0.997], abs=0.05)


def test_neighbours_that_err_alike_are_not_taken_for_independent():
    X, _, cells, _ = scene(1)
    noise = np.random.default_rng(3).normal(0, 0.1, (60, 80)).repeat(4, axis=0).repeat(4, axis=1).reshape(-1, 1)
    points = seen(X, cells, 1e-6)
    alike = Correspondences(
        points.camera_px,
        points.projector_px + np.hstack([noise, 0 * noise]),
        projector_sigma_px=np.full(len(X), 0.1),
        cells=cells,
    )
    smooth = reconstruct(RIG, alike, ReconstructOptions(smooth=True, outlier_sigmas=100.0))
    error = np.abs(along_rays(smooth, X, cells))
    assert np.mean(error < 2 * smooth.sigma) > 0.8  # .3 were they taken so


def test_without_a_grid_there_is_nothing_to_smooth_over():
    X, _, _, _ = scene(8)
    with pytest.raises(InputError, match="smooth: expected points of a capture with a grid"):
        reconstruct(RIG, seen(X, None, 0.1), ReconstructOptions(smooth=True))


@pytest.mark.parametrize("count", [1, 2, 5])
def test_a_few_points_stay_where_they_are(count):
    X, _, cells, _ = scene(1)
    few = (cells < count).all(axis=1)
    options = ReconstructOptions(keep_strays=True)
    plain = reconstruct(RIG, seen(X[few], cells[few], 0.1), options)
    assert smoothed(plain).points == pytest.approx(plain.points, rel=2e-3)
