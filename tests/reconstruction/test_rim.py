"""Points beside jumps of depth: mixed ones go, the others are as sure as they say."""

import numpy as np
import pytest

from retrue.correspondences import Correspondences
from retrue.reconstruction.noise import _levels
from retrue.reconstruction.options import ReconstructOptions
from retrue.reconstruction.reconstruct import reconstruct
from retrue.reconstruction.rim import find_rim
from retrue.reconstruction.surface_grid import surface_grid
from tests.reconstruction.scenes import RIG

NOISE = 0.03
WIDTH, HEIGHT = 200, 160


def card_before_a_wall():
    """Camera pixels one by one, the depth of what each sees, and whether it lies beside the card's edge."""
    column, row = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    card = (np.abs(column - 100) < 50) & (np.abs(row - 80) < 40)
    edge = (np.abs(np.abs(column - 100) - 50) < 1.5) & (np.abs(row - 80) < 41)
    edge |= (np.abs(np.abs(row - 80) - 40) < 1.5) & (np.abs(column - 100) < 51)
    px = np.stack([column.ravel() + 300.0, row.ravel() + 200.0], axis=1)
    depth = np.where(card, 1900.0, 2000.0).ravel()
    rays = RIG.camera.unproject(px)
    return px, np.column_stack([rays, np.ones(len(rays))]) * depth[:, None], edge.ravel()


def seen(seed, mixed):
    """What a decoder makes of it: at the edge, in part what the other surface shows."""
    rng = np.random.default_rng(seed)
    px, X, edge = card_before_a_wall()
    own = RIG.projector.project(RIG.projector_from_camera.apply(X))
    other = X * (3900.0 - X[:, 2:]) / X[:, 2:]
    share = np.where(edge & (rng.random(len(X)) < mixed), rng.uniform(0, 0.08, len(X)), 0.0)[:, None]
    shown = own + share * (RIG.projector.project(RIG.projector_from_camera.apply(other)) - own)
    cells = np.rint(px[:, ::-1]).astype(int)
    noisy = shown + rng.normal(0, NOISE, shown.shape)
    return Correspondences(px, noisy, projector_sigma_px=np.full(len(X), NOISE), cells=cells), X, edge


def in_sigmas(cloud, points, X):
    rows = np.ravel_multi_index((cloud.camera_px - points.camera_px[0]).astype(int).T[::-1], (HEIGHT, WIDTH))
    ray = X[rows] / np.linalg.norm(X[rows], axis=1, keepdims=True)
    return ((cloud.points - X[rows]) * ray).sum(axis=1) / cloud.sigma, rows


def test_pixels_that_see_two_surfaces_go_and_the_others_are_as_sure_as_they_say():
    points, X, edge = seen(0, 0.5)
    everything, cloud = (reconstruct(RIG, points, ReconstructOptions(keep_strays=keep)) for keep in (True, False))
    before, rows = in_sigmas(everything, points, X)
    assert np.mean(np.abs(before[edge[rows]]) > 3) > 0.15
    assert cloud.card["dropped_at_edges"] > 20
    after, rows = in_sigmas(cloud, points, X)
    assert np.mean(np.abs(after[edge[rows]]) > 3) < 0.05
    inside = after[~edge[rows]]
    np.testing.assert_allclose([np.mean(np.abs(inside) < k) for k in (1, 2, 3)], [0.683, 0.954, 0.997], atol=0.02)


def test_an_edge_without_mixed_pixels_stays():
    points, X, edge = seen(1, 0.0)
    cloud = reconstruct(RIG, points)
    assert cloud.card["dropped_at_edges"] < 0.03 * edge.sum()
    off, rows = in_sigmas(cloud, points, X)
    found = [np.mean(np.abs(off[edge[rows]]) < k) for k in (1, 2, 3)]
    np.testing.assert_allclose(found, [0.683, 0.954, 0.997], atol=0.06)


@pytest.mark.parametrize("sure", [True, False])
def test_of_sparse_cells_their_decoder_is_asked(sure):
    px, X, _ = card_before_a_wall()
    few = np.flatnonzero((px % 8 == 4).all(axis=1) & (X[:, 2] == 2000.0))
    grid = surface_grid(X[few], (px[few, ::-1] // 8).astype(int))
    stated = np.full(len(few), 0.02)
    stated[0] = 0.02 if sure else 0.2
    rim = find_rim(X[few], px[few], stated, np.ones(len(few)), grid)
    assert rim.cut.tolist() == [not sure] + [False] * (len(few) - 1)
    assert (rim.level == 1).all()


def test_a_doubt_that_the_rays_do_not_show_stays():
    rng = np.random.default_rng(8)
    stated = np.where(np.arange(4000) < 3000, 0.01, 0.05) * rng.uniform(0.95, 1.05, 4000)
    z = np.where(stated < 0.03, 0.8, 0.2) * rng.normal(size=4000)
    level = _levels(stated, z, 0.0)
    assert np.abs(level - 0.8).max() < 0.1
