"""Shading from normals that noise and rims leave unsure."""

import numpy as np

from retrue.reconstruction.normals import bent_gradients
from retrue.reconstruction.shading import log_cosines
from retrue.reconstruction.surface_grid import surface_grid
from tests.acceptance.simulated import RIG

SIGMA = 0.2


def plate(rows, columns, noise, seed=0):
    """Points 4 mm apart on a tilted plate, with noise along their rays, and the log of its cosines."""
    cells = np.argwhere(np.ones((rows, columns), bool))
    y, x = 4.0 * (cells - [rows / 2, columns / 2]).T
    flat = np.column_stack([x, y, 600.0 + 0.4 * x - 0.2 * y])
    way = RIG.projector_from_camera.inverse().t - flat
    normal = np.array([0.4, -0.2, -1.0])
    truth = np.log(way @ normal / np.linalg.norm(normal) / np.linalg.norm(way, axis=1))
    along = 1 + noise * np.random.default_rng(seed).normal(size=len(flat)) / np.linalg.norm(flat, axis=1)
    return flat * along[:, None], cells, truth


def test_slopes_err_as_their_covariance_says():
    X, cells, _ = plate(40, 40, SIGMA)
    slopes, covariance, left = bent_gradients(X, surface_grid(X, cells))
    w, truth = 1 / X[:, 2], np.array([-0.4, 0.2]) / 600.0  # Z = 600 + 0.4 X - 0.2 Y, so w = (1 - 0.4 x + 0.2 y) / 600
    noise = SIGMA * w / np.linalg.norm(X, axis=1)
    z = (slopes - truth) / np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)) / noise[:, None]
    assert 0.6 < np.sqrt(np.mean(z**2)) < 1.1  # outer neighbours, which tell most, weigh less
    assert 0.8 < np.median(np.sqrt(left) / noise) < 1.2


def test_neighbours_even_out_what_noise_does_to_normals():
    X, cells, truth = plate(40, 40, SIGMA)
    for sigma in (np.full(len(X), SIGMA), None):
        found, doubt = log_cosines(RIG, X, sigma, surface_grid(X, cells))
        assert np.sqrt(np.mean((found - truth) ** 2)) < 0.5 * np.sqrt(np.mean(doubt**2))


def test_where_no_normal_is_told_the_neighbours_shading_is():
    X, cells, truth = plate(16, 20, 0.0)
    kept = (cells[:, 1] < 16) | (cells[:, 0] == 8)  # the rest is one row wide
    X, cells, truth = X[kept], cells[kept], truth[kept]
    found, doubt = log_cosines(RIG, X, None, surface_grid(X, cells))
    tail = cells[:, 1] >= 18
    assert np.isinf(doubt[tail]).all()
    assert np.abs(found - truth)[tail].max() < 0.05
    assert np.abs(found - truth)[~tail].max() < 0.02


def test_points_without_neighbours_have_no_shading():
    X, cells, _ = plate(3, 3, 0.0)
    alone = np.array([0, 2, 6, 8])
    found, doubt = log_cosines(RIG, X[alone], None, surface_grid(X[alone], cells[alone]))
    assert np.isnan(found).all()
    assert np.isinf(doubt).all()
