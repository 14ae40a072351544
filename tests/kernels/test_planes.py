"""Planes through stripe edges say the same compiled and as Python, and what least squares say."""

from __future__ import annotations

import numpy as np

from retrue.kernels import bend, planes
from tests.kernels.plain import plain


def test_a_plane_of_moments_is_that_of_least_squares() -> None:
    rng = np.random.default_rng(0)
    shape = (2, 300)  # more than are taken at a time
    x, y, w = (rng.uniform(low, 3, (40, *shape)) for low in (-3, -3, 0.1))
    window, spread = rng.uniform(0.2, 0.8, x.shape), 0.1
    v = 100 + 0.4 * x - 0.2 * y + rng.normal(0, 0.1, x.shape)
    sums = np.stack([(w * own).sum(axis=0) for own in (1, x, x * x, y, y * y, x * y, v, x * v, y * v)])
    squares = np.stack([(window * w * own).sum(axis=0) for own in (1, x, x * x, y, y * y, x * y)])
    found = []
    for kernel in (planes, plain("planes")):
        made = [np.empty((count, *shape), np.float32) for count in (3, 5, 2)]
        kernel.solve(sums.astype(np.float32), squares.astype(np.float32), spread, *made)
        found.append(made)
    for compiled, python in zip(*found, strict=True):
        np.testing.assert_allclose(compiled, python, rtol=2e-3, atol=2e-3)
    fitted, moments, loose = found[0]
    for place in ((0, 0), (1, 299)):
        at = (slice(None), *place)
        design = np.stack([np.ones(40), x[at], y[at]], axis=1)
        normal = design.T @ (w[at][:, None] * design)
        np.testing.assert_allclose(fitted[at], np.linalg.solve(normal, design.T @ (w[at] * v[at])), atol=2e-3)
        mean = np.average(x[at], weights=w[at])
        np.testing.assert_allclose(
            moments[at][[0, 2]], [mean, np.average((x[at] - mean) ** 2, weights=w[at])], rtol=1e-3
        )
        inverse = np.linalg.inv(normal)
        np.testing.assert_allclose(loose[0][place], inverse[0, 0], rtol=1e-3)
        covariance = inverse @ (design.T @ ((window * w)[at][:, None] * design)) @ inverse
        expected = covariance[0, 0] + spread * (covariance[1, 1] + covariance[2, 2])
        np.testing.assert_allclose(loose[1][place], expected, rtol=2e-3)


def test_a_bend_is_told_by_how_slopes_change() -> None:
    """Of n = k x^2 / 2 a window of second moment s errs by k s / 2; chunks without planes are left out."""
    rows, columns, cell, change = 20, 200, 4, 0.002
    slopes = np.zeros((2, rows, columns), np.float32)
    slopes[0] = change * cell * np.arange(columns)
    whole = np.zeros((rows, columns), np.uint8)
    whole[:, :60] = 1
    shape = np.zeros((5, rows, columns), np.float32)
    shape[2] = 30.0
    for kernel in (bend, plain("bend")):
        room, found = np.empty((6, 7, columns), np.float32), np.empty((rows, columns), np.float32)
        told, bent = np.empty((2, rows, columns), np.uint8)
        sigma = np.full((rows, columns), 0.01, np.float32)
        frame, moments = (2, 4.0 * cell, 1), (*shape, 1.0)
        count = kernel.bias(*slopes, whole, *frame, *moments, sigma, 20.0, 8.0, room, told, found, bent)
        np.testing.assert_array_equal(told, whole)
        np.testing.assert_allclose(found[:, 2:58], change * 30 / 2, rtol=1e-4)
        assert count == np.count_nonzero(bent) >= rows * 56
        assert not found[:, 64:].any()
