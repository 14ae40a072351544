"""Planes through stripe edges say the same compiled and as Python, and what least squares say."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from retrue.geometry.arrays import FloatArray
from retrue.kernels import bend, planes
from tests.kernels.plain import plain


@pytest.mark.parametrize("along", [0, 1])
def test_a_plane_of_moments_is_that_of_least_squares_in_its_window(along: int) -> None:
    rng = np.random.default_rng(along)
    shape, cell = (9, 150), 4.0  # more columns than are taken at a time
    w, own = rng.uniform(0.1, 3, (30, *shape)), rng.uniform(-2, 2, (2, 30, *shape))
    grid = np.meshgrid(*(cell * np.arange(side) for side in shape), indexing="ij")
    place = [centre + off for centre, off in zip(grid, own, strict=True)]
    v = 100 + 0.04 * place[along] - 0.02 * place[1 - along] + rng.normal(0, 0.1, w.shape)
    w[..., 100:] = 0  # no edges
    x, y = own[along], own[1 - along]
    sums = np.stack([(w * term).sum(axis=0) for term in (x**0, x, x * x, y, y * y, x * y, v, x * v, y * v)])
    weight = np.exp(-0.5 * (np.arange(-3, 4) / 1.25) ** 2)
    window = (weight * (cell * np.arange(-3, 4)) ** np.arange(3)[:, None]).astype(np.float32)
    found: list[list[NDArray[np.float32]]] = []
    for kernel in (planes, plain("planes")):
        made = [np.zeros((count, *shape), np.float32) for count in (3, 5, 2)]
        kernel.solve(sums.astype(np.float32), window, along, (1, 3), *made)
        found.append(made)
    for compiled, python in zip(*found, strict=True):
        np.testing.assert_allclose(compiled, python, rtol=2e-3, atol=2e-3)
    fitted, moments, loose = found[0]
    assert not loose[:, 0].any()
    assert not loose[:, 3:].any()
    assert not loose[0, :, 128:].any()
    for r, c in ((1, 0), (2, 63), (2, 97)):
        rows, columns = slice(max(r - 3, 0), r + 4), slice(max(c - 3, 0), c + 4)
        k = weight[rows.start - r + 3 : rows.stop - r + 3, None] * weight[columns.start - c + 3 : columns.stop - c + 3]
        own_w: FloatArray = (w[:, rows, columns] * k).ravel()
        dx, dy = ((place[axis][:, rows, columns] - cell * (r, c)[axis]).ravel() for axis in (along, 1 - along))
        design = np.stack([np.ones_like(dx), dx, dy], axis=1)
        normal = design.T @ (own_w[:, None] * design)
        solved = np.linalg.solve(normal, design.T @ (own_w * v[:, rows, columns].ravel()))
        np.testing.assert_allclose(fitted[:, r, c], solved, atol=2e-3)
        mean = np.average(dx, weights=own_w)
        spread = np.average((dx - mean) ** 2, weights=own_w)
        np.testing.assert_allclose(moments[[0, 2], r, c], [mean, spread], rtol=1e-3)
        np.testing.assert_allclose(loose[0, r, c] * loose[1, r, c], np.linalg.inv(normal)[0, 0], rtol=1e-3)


def test_planes_are_judged_by_what_their_windows_miss() -> None:
    rng = np.random.default_rng(0)
    shape = (8, 140)
    misses = rng.uniform(0.5, 2, (3, *shape)).astype(np.float32)
    weight = np.exp(-0.5 * (np.arange(-3, 4) / 1.25) ** 2).astype(np.float32)
    loose = np.full((2, *shape), 0.5, np.float32)
    loose[:, :, 128:] = 0  # without edges
    around = np.pad(misses, ((0, 0), (3, 3), (3, 3)))
    off, of, count = (
        np.array([[np.sum(a[r : r + 7, c : c + 7] * np.outer(weight, weight)) for c in range(140)] for r in range(8)])
        for a in around
    )
    for kernel in (planes, plain("planes")):
        variance, (even, sure, whole) = np.zeros(shape, np.float32), np.zeros((3, *shape), np.uint8)
        kernel.judge(misses, weight, (0, 8), loose, (0.1, 2.0), (1.0, 0.55), variance, even, sure, whole)
        np.testing.assert_allclose(variance[:, :128], ((off / count + 0.1) * 0.5)[:, :128], rtol=1e-4)
        clear = np.abs(off / of - 1) > 1e-4
        np.testing.assert_array_equal(even[:, :128][clear[:, :128]], (off / of < 1)[:, :128][clear[:, :128]])
        np.testing.assert_array_equal(sure[:, :128], variance[:, :128] < 0.55)
        np.testing.assert_array_equal(whole, even)
        assert not np.any([variance[:, 128:], even[:, 128:], sure[:, 128:]])


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
