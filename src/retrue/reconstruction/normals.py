"""Normals from planes through the neighbours that the surface goes on to.

On a plane n . X = d inverse depth is linear in the ray (x, y, 1): w = 1 / Z = n . (x, y, 1) / d. So a straight line
fit of w, where noise is even, gives n / d itself. The weights are those of a random walk along the links of the
grid: a binomial that nothing crosses a depth jump with.
"""

from __future__ import annotations

from dataclasses import replace
from math import comb

import numpy as np

from retrue.errors import InputError
from retrue.geometry.arrays import BoolArray, FloatArray
from retrue.geometry.walks import STEP_WEIGHT, walked
from retrue.reconstruction.cloud import Cloud, require_cloud
from retrue.reconstruction.surface_grid import SurfaceGrid, surface_grid

CELLS_PER_STEP = 160  # the walk takes one step for so many cells of the longer side,
FEWEST_STEPS, MOST_STEPS = 2, 32  # within these
BAND = 256  # rows at a time, to save memory
PLANE, QUADRIC = 3, 6  # coefficients
WORST_CONDITION = {PLANE: 1e10, QUADRIC: 1e13}  # of their moments: beyond it the neighbours tell none
FLATTEST = 1e-9  # determinant of the moments, relative to the product of their diagonal: points on a line


def with_normals(cloud: Cloud) -> Cloud:
    """The cloud with `Cloud.normals`; raises `InputError` where its points have no grid."""
    require_cloud(cloud)
    if cloud.cells is None:
        raise InputError("normals: expected points of a capture with a grid, found scattered ones; decode a picture")
    grid = surface_grid(cloud.points, cloud.cells)
    return replace(cloud, normals=surface_normals(cloud.points, grid))


def surface_normals(points: FloatArray, grid: SurfaceGrid) -> FloatArray:
    """Unit normals (N, 3) of points (N, 3), towards the camera; NaN where the linked neighbours are on a line."""
    n = local_planes(points, grid)
    return -n / np.linalg.norm(n, axis=1, keepdims=True)


def bent_gradients(points: FloatArray, grid: SurfaceGrid) -> tuple[FloatArray, FloatArray, FloatArray]:
    """How w goes with the ray (x, y) at each of N points, by the quadric of w through the neighbours: at a rim, whose
    neighbours all lie to one side, a plane has the slope further inside. Where they tell no quadric, that of the plane.

    Returns
    -------
    (N, 2) the slopes, NaN where there is none; (N, 2, 2) their covariance where w errs by one; and (N,) the variance of
    w as the neighbours leave it, each of which noise and what no quadric follows are part of.
    """
    slopes, covariance, left = (
        np.full((len(points), 2), np.nan),
        np.full((len(points), 2, 2), np.inf),
        np.zeros(len(points)),
    )
    steps = _steps(grid)
    height = grid.index.shape[0]
    for top in range(0, height, BAND):
        first, last = max(0, top - steps), min(height, top + BAND + steps)
        index = grid.index[first:last]
        inner = np.zeros(index.shape, np.bool_)
        inner[top - first : top - first + BAND] = True
        sums, x, y, size = _moments(points, grid, slice(first, last), steps)
        for terms in (QUADRIC, PLANE):
            asked = inner & (index >= 0) & (sums[0, 0] > 0)
            asked[asked] = np.isnan(slopes[index[asked], 0])
            values, vectors = np.linalg.eigh(np.moveaxis(sums[:terms, :terms, asked], -1, 0))
            sound = values[:, 0] > values[:, -1] / WORST_CONDITION[terms]
            told, vectors = asked.copy(), vectors[sound]
            told[asked] = sound
            inverse = (vectors / values[sound, None]) @ vectors.swapaxes(1, 2)
            moments = np.moveaxis(sums[:, :, told], -1, 0)
            w = moments[:, :terms, -1]
            a = (inverse @ w[:, :, None])[:, :, 0]
            slope = _slope(x[told], y[told])[:, :, :terms] / size
            rows, total, independent = index[told], moments[:, 0, 0], STEP_WEIGHT**steps / _shared(steps)
            slopes[rows] = (slope @ a[:, :, None])[:, :, 0]
            covariance[rows] = _shared(steps) * slope @ inverse @ slope.swapaxes(1, 2)
            square = np.maximum(moments[:, -1, -1] - (a * w).sum(axis=1), 0.0) / total
            left[rows] = square * independent / (independent - terms)
    return slopes, covariance, left


def _steps(grid: SurfaceGrid) -> int:
    return min(max(FEWEST_STEPS, max(grid.index.shape) // CELLS_PER_STEP), MOST_STEPS)


def _shared(steps: int) -> float:
    """Sum of squares over the sum of a walk's weights: what the variance of a weighted mean of equals is, times it."""
    return STEP_WEIGHT**steps * (comb(4 * steps, 2 * steps) / 4 ** (2 * steps)) ** 2


def _moments(
    points: FloatArray, grid: SurfaceGrid, rows: slice, steps: int
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """(7, 7, h, W) sums over the neighbours of the products of 1, x, y, x^2, xy, y^2 and w, and x, y and their unit."""
    index = grid.index[rows]
    there = index >= 0
    rays = np.where(there[..., None], points[index, :2] / points[index, 2:], 0.0)
    centre, size = rays[there].mean(axis=0) if there.any() else np.zeros(2), max(float(np.ptp(rays)), 1e-9)
    x, y = np.moveaxis((rays - centre) / size * there[..., None], -1, 0)
    w = grid.w[rows]
    level = float(np.median(w[there])) if there.any() else 0.0
    right = grid.right[rows].astype(np.float64)[..., None]
    down = grid.down[rows.start : rows.stop - 1].astype(np.float64)[..., None]
    terms = np.stack([there.astype(np.float64), x, y, x * x, x * y, y * y, np.where(there, w - level, 0.0)], axis=-1)
    i, j = np.triu_indices(QUADRIC + 1)
    sums = np.empty((QUADRIC + 1, QUADRIC + 1, *index.shape))
    sums[i, j] = sums[j, i] = np.moveaxis(walked(terms[..., i] * terms[..., j], right, down, steps), -1, 0)
    return sums, x, y, size


def _slope(x: FloatArray, y: FloatArray) -> FloatArray:
    """(N, 2, 6) of 1, x, y, x^2, xy, y^2 by x and by y."""
    none, one = np.zeros_like(x), np.ones_like(x)
    return np.stack(
        [np.stack([none, one, none, 2 * x, y, none], axis=-1), np.stack([none, none, one, none, x, 2 * y], axis=-1)], 1
    )


def local_planes(
    points: FloatArray, grid: SurfaceGrid, counted: BoolArray | None = None, steps: int | None = None
) -> FloatArray:
    """n / d (N, 3) of the plane n . X = d through the neighbours of each point (N, 3); NaN where they are on a line.

    Parameters
    ----------
    counted : (N,) the points that planes go through; None: all.
    steps : of the walk; None: as many as suit a grid of that size.
    """
    planes = np.full(points.shape, np.nan)
    height = grid.index.shape[0]
    if steps is None:
        steps = _steps(grid)
    counts = np.ones(len(points), dtype=np.bool_) if counted is None else counted
    for top in range(0, height, BAND):
        first, last = max(0, top - steps), min(height, top + BAND + steps)
        n = _plane_through_neighbours(points, grid, counts, slice(first, last), steps)
        n = n[top - first : top - first + BAND]
        index = grid.index[top : top + BAND]
        planes[index[index >= 0]] = n[index >= 0]
    return planes


def _plane_through_neighbours(
    points: FloatArray, grid: SurfaceGrid, counted: BoolArray, rows: slice, steps: int
) -> FloatArray:
    """n / d (h, W, 3) of the plane fitted at each cell of those rows."""
    index = grid.index[rows]
    there = (index >= 0) & counted[index]
    rays = np.where(there[..., None], points[index, :2] / points[index, 2:], 0.0)
    x, y, w = rays[..., 0], rays[..., 1], np.where(there, grid.w[rows], 0.0)
    right = grid.right[rows].astype(np.float64)
    down = grid.down[rows.start : rows.stop - 1].astype(np.float64)

    def mean(values: FloatArray) -> FloatArray:
        with np.errstate(invalid="ignore", divide="ignore"):
            return walked(values, right, down, steps) / total

    total = walked(there.astype(np.float64), right, down, steps)
    mx, my, mw = mean(x), mean(y), mean(w)
    xx, xy, yy = mean(x * x) - mx * mx, mean(x * y) - mx * my, mean(y * y) - my * my
    xw, yw = mean(x * w) - mx * mw, mean(y * w) - my * mw
    determinant = xx * yy - xy * xy
    with np.errstate(invalid="ignore", divide="ignore"):
        a, b = (xw * yy - yw * xy) / determinant, (yw * xx - xw * xy) / determinant
        plane = np.stack([a, b, mw - a * mx - b * my], axis=-1)
    plane[~(determinant > FLATTEST * xx * yy)] = np.nan
    return plane
