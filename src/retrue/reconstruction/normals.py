"""Normals from planes through the neighbours that the surface goes on to.

On a plane n . X = d inverse depth is linear in the ray (x, y, 1): w = 1 / Z = n . (x, y, 1) / d. So a straight line
fit of w, where noise is even, gives n / d itself. The weights are those of a random walk along the links of the
grid: a binomial that nothing crosses a depth jump with.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from retrue.errors import InputError
from retrue.geometry.arrays import BoolArray, FloatArray
from retrue.reconstruction.cloud import Cloud, require_cloud
from retrue.reconstruction.surface_grid import SurfaceGrid, surface_grid

CELLS_PER_STEP = 160  # the walk takes one step for so many cells of the longer side,
FEWEST_STEPS, MOST_STEPS = 2, 32  # within these
BAND = 256  # rows at a time, to save memory
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
    height, width = grid.index.shape
    if steps is None:
        steps = min(max(FEWEST_STEPS, max(height, width) // CELLS_PER_STEP), MOST_STEPS)
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
            return _walked(values, right, down, steps) / total

    total = _walked(there.astype(np.float64), right, down, steps)
    mx, my, mw = mean(x), mean(y), mean(w)
    xx, xy, yy = mean(x * x) - mx * mx, mean(x * y) - mx * my, mean(y * y) - my * my
    xw, yw = mean(x * w) - mx * mw, mean(y * w) - my * mw
    determinant = xx * yy - xy * xy
    with np.errstate(invalid="ignore", divide="ignore"):
        a, b = (xw * yy - yw * xy) / determinant, (yw * xx - xw * xy) / determinant
        plane = np.stack([a, b, mw - a * mx - b * my], axis=-1)
    plane[~(determinant > FLATTEST * xx * yy)] = np.nan
    return plane


def _walked(values: FloatArray, right: FloatArray, down: FloatArray, steps: int) -> FloatArray:
    """Values (h, W) after steps of a walk that stays with weight 2 and takes each link with weight 1."""
    for _ in range(steps):
        across = 2 * values
        across[:, 1:] += right * values[:, :-1]
        across[:, :-1] += right * values[:, 1:]
        values = 2 * across
        values[1:] += down * across[:-1]
        values[:-1] += down * across[1:]
    return values
