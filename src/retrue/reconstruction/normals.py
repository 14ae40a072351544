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
from retrue.geometry.walks import walked
from retrue.reconstruction.cloud import Cloud, require_cloud
from retrue.reconstruction.surface_grid import SurfaceGrid, surface_grid

CELLS_PER_STEP = 160  # the walk takes one step for so many cells of the longer side,
FEWEST_STEPS, MOST_STEPS = 2, 32  # within these
BAND = 256  # rows at a time, to save memory
QUADRIC = 6  # coefficients
WORST_CONDITION = 1e13  # of their moments: beyond it the neighbours tell no quadric
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


def bent_normals(points: FloatArray, grid: SurfaceGrid) -> FloatArray:
    """The same of the quadrics of w through the neighbours: at a rim, whose neighbours all lie to one side, a plane has
    the normal further inside. Where too few neighbours tell a quadric, that of the plane.
    """
    found = surface_normals(points, grid)
    steps = _steps(grid)
    height = grid.index.shape[0]
    for top in range(0, height, BAND):
        first, last = max(0, top - steps), min(height, top + BAND + steps)
        n = _tangents_of_quadrics(points, grid, slice(first, last), steps)[top - first : top - first + BAND]
        index = grid.index[top : top + BAND]
        told = (index >= 0) & np.isfinite(n[..., 0])
        found[index[told]] = -n[told] / np.linalg.norm(n[told], axis=1, keepdims=True)
    return found


def _steps(grid: SurfaceGrid) -> int:
    return min(max(FEWEST_STEPS, max(grid.index.shape) // CELLS_PER_STEP), MOST_STEPS)


def _tangents_of_quadrics(points: FloatArray, grid: SurfaceGrid, rows: slice, steps: int) -> FloatArray:
    """n / d (h, W, 3) of the plane that touches the quadric w(x, y) at each cell of those rows; NaN: none is told."""
    index = grid.index[rows]
    there = index >= 0
    rays = np.where(there[..., None], points[index, :2] / points[index, 2:], 0.0)
    centre, size = rays[there].mean(axis=0) if there.any() else np.zeros(2), max(float(np.ptp(rays)), 1e-9)
    x, y = np.moveaxis((rays - centre) / size * there[..., None], -1, 0)
    right = grid.right[rows].astype(np.float64)[..., None]
    down = grid.down[rows.start : rows.stop - 1].astype(np.float64)[..., None]
    terms = np.stack([there.astype(np.float64), x, y, x * x, x * y, y * y], axis=-1)
    i, j = np.triu_indices(QUADRIC)
    w = np.where(there, grid.w[rows], 0.0)[..., None]
    sums = walked(np.concatenate([terms[..., i] * terms[..., j], terms * w], axis=-1), right, down, steps)
    moments = np.zeros((*index.shape, QUADRIC, QUADRIC))
    moments[..., i, j] = moments[..., j, i] = sums[..., : len(i)]
    plane = np.full((*index.shape, 3), np.nan)
    known = there & (walked(terms[..., :1], right, down, steps)[..., 0] > 0)
    known[known] = np.linalg.cond(moments[known]) < WORST_CONDITION
    a = np.linalg.solve(moments[known], sums[known][:, len(i) :, None])[..., 0]
    x, y = x[known], y[known]
    w_x, w_y = (a[:, 1] + 2 * a[:, 3] * x + a[:, 4] * y) / size, (a[:, 2] + a[:, 4] * x + 2 * a[:, 5] * y) / size
    ray = rays[known]
    plane[known] = np.stack([w_x, w_y, grid.w[rows][known] - w_x * ray[:, 0] - w_y * ray[:, 1]], axis=1)
    return plane


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
