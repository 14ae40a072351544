"""The grid that a capture's points lie in, and where the surface goes on from one cell to the next.

It does not where inverse depth jumps: depth jumps are judged in w = 1 / Z, because on a plane w is linear in the
picture, and its noise is even over the picture. A step is a jump when it leaves the slope of the surface on BOTH of
its sides by more than the noise explains, and by more than a fraction of the spacing of points.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from retrue.errors import InputError
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.robust import MAD_TO_SIGMA

LARGEST_GRID = 200_000_000  # cells; more is a mistake, and would not fit into memory
NOISE_SIGMAS = 6.0  # what exceeds so many robust sigmas is not noise
OWN_SIGMAS = 3.0  # of what two points err by themselves: a step of less is noise, too, where few steps are noisy
SPACING_FRACTION = 0.5  # a kink of this many point spacings in one step, about 27 degrees, is still a surface


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceGrid:
    """Points by cell, and links between neighbours that lie on one surface.

    Attributes
    ----------
    index : (H, W) row of the point in each cell, -1 for none.
    w : (H, W) inverse depth 1 / Z, NaN where there is no point.
    right : (H, W - 1) whether the surface goes on to the next cell of the row.
    down : (H - 1, W) the same of the column.
    limit : (H, W) the largest departure of w from the surface's slope that is not a jump.
    """

    index: IntArray
    w: FloatArray
    right: BoolArray
    down: BoolArray
    limit: FloatArray

    def links(self) -> tuple[IntArray, IntArray]:
        """The points (M,) and (M,) at the two ends of every link."""
        left, upper = self.index[:, :-1][self.right], self.index[:-1][self.down]
        right, lower = self.index[:, 1:][self.right], self.index[1:][self.down]
        return np.concatenate([left, upper]), np.concatenate([right, lower])


def surface_grid(points: FloatArray, cells: IntArray, sigma: FloatArray | None = None) -> SurfaceGrid:
    """The grid of points (N, 3) of the camera frame in cells (N, 2), row and column, from the first ones in use.

    Where two points claim one cell, the later one holds it. Raises `InputError` for a grid beyond memory. With `sigma`
    (N,) along the rays, what points err by themselves makes no jumps: where neighbours mostly err alike, as those of
    one stripe do, most steps show none of the noise that the steps from stripe to stripe have.
    """
    index = cell_index(cells)
    w = np.where(index >= 0, 1 / points[index, 2], np.nan)
    step_right, step_down = slope_residual(w), slope_residual(w.T).T
    residuals = np.concatenate([step_right.ravel(), step_down.ravel()])
    angles = np.concatenate(
        [_spacing_angle(points, index[:, :-1], index[:, 1:]), _spacing_angle(points, index[:-1], index[1:])]
    )
    angle = float(np.median(angles)) if len(angles) else 0.0
    limit = jump_limit(residuals, w, angle)
    right_limit, down_limit = np.fmin(limit[:, :-1], limit[:, 1:]), np.fmin(limit[:-1], limit[1:])
    if sigma is not None:
        own = (OWN_SIGMAS * sigma / (np.linalg.norm(points, axis=1) * points[:, 2])) ** 2
        square = np.where(index >= 0, own[index], np.nan)
        right_limit = np.fmax(right_limit, np.sqrt(square[:, :-1] + square[:, 1:]))
        down_limit = np.fmax(down_limit, np.sqrt(square[:-1] + square[1:]))
    right, down = step_right <= right_limit, step_down <= down_limit
    return SurfaceGrid(index, w, right, down, limit)


def cell_index(cells: IntArray) -> IntArray:
    """(H, W): which of N points lies in each cell, -1 for none; row 0 and column 0 are the first in use.

    >>> cell_index(np.array([[5, 7], [6, 8]])).tolist()
    [[0, -1], [-1, 1]]
    """
    if not len(cells):
        return np.empty((0, 0), dtype=np.int64)
    cells = cells - cells.min(axis=0)
    height, width = (int(length) + 1 for length in cells.max(axis=0))
    if not height * width <= LARGEST_GRID:
        raise InputError(f"cells: expected a grid of at most {LARGEST_GRID} cells, found {height} x {width}")
    index = np.full((height, width), -1, dtype=np.int64)
    index[cells[:, 0], cells[:, 1]] = np.arange(len(cells))
    return index


def linked(index: IntArray, right: BoolArray, step: int) -> IntArray:
    """(M, 2) points of a row, so many cells apart, between which the surface goes on without a jump."""
    count = index.shape[1] - step
    if count <= 0:
        return np.empty((0, 2), dtype=np.int64)
    along = np.pad(np.cumsum(right, axis=1), ((0, 0), (1, 0)))
    whole = along[:, step:] - along[:, :count] == step
    return np.stack([index[:, :count][whole], index[:, step:][whole]], axis=1)


def cells_from_rim(grid: SurfaceGrid, count: int, most: int) -> IntArray:
    """(N,) how many cells each of `count` points lies from one that is not linked to all its four neighbours.

    Parameters
    ----------
    most : cells; farther than that counts as that.
    """
    from scipy import ndimage

    height, width = grid.index.shape
    inside = np.zeros((height, width), dtype=np.bool_)
    inside[1:-1, 1:-1] = grid.right[1:-1, :-1] & grid.right[1:-1, 1:] & grid.down[:-1, 1:-1] & grid.down[1:, 1:-1]
    cells = np.zeros((height, width), dtype=np.int64)
    for _ in range(most):
        cells += inside
        inside = cast("Any", ndimage).binary_erosion(inside, np.ones((3, 3)))
    found = np.zeros(count, dtype=np.int64)
    found[grid.index[grid.index >= 0]] = cells[grid.index >= 0]
    return found


def _spacing_angle(points: FloatArray, a: IntArray, b: IntArray) -> FloatArray:
    """Distance over depth of the neighbours `a` and `b`, wherever there are both."""
    both = (a >= 0) & (b >= 0)
    near, far = points[a[both]], points[b[both]]
    return np.linalg.norm(far - near, axis=1) / near[:, 2]


def slope_residual(w: FloatArray) -> FloatArray:
    """How far each step (H, W - 1) along the rows of w (H, W) departs from the slope before or after it.

    The nearer of the two counts, so that a crease is no jump. A slope is the median of three steps, so that
    one stray point on the edge of an object does not make a ramp of a jump.
    """
    step = np.diff(w, axis=1)
    padded = np.pad(step, ((0, 0), (3, 3)), constant_values=np.nan)
    count = step.shape[1]
    before = _median_of_three(*(padded[:, k : k + count] for k in (0, 1, 2)))
    after = _median_of_three(*(padded[:, k : k + count] for k in (4, 5, 6)))
    residual = np.fmin(np.abs(step - before), np.abs(step - after))
    return np.where(np.isnan(residual), np.abs(step), residual)


def _median_of_three(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Of those that are not NaN; the flatter one of two."""
    ordered = np.sort(np.stack([a, b, c]), axis=0)  # NaN sorts last
    low: FloatArray = ordered[0]
    middle: FloatArray = ordered[1]
    high: FloatArray = ordered[2]
    flatter_of_two = np.where(np.abs(middle) < np.abs(low), middle, low)
    return np.where(np.isnan(high), flatter_of_two, middle)


def jump_limit(residuals: FloatArray, inverse_depth: FloatArray, spacing_angle: float) -> FloatArray:
    """The largest departure from the surface's slope, in inverse depth, that is not a jump; as `inverse_depth`.

    Six robust sigmas of all `residuals` (NaN: unknown), so that noise makes no holes; and at least half the
    distance between neighbours, `spacing_angle` times depth, so that the curvature of a noiseless surface
    makes none: dZ = angle Z / 2 is dw = angle w / 2.

    >>> jump_limit(np.zeros(9), np.array([0.5]), spacing_angle=0.01).tolist()
    [0.0025]
    """
    finite = residuals[np.isfinite(residuals)]
    noise = MAD_TO_SIGMA * float(np.median(np.abs(finite))) if len(finite) else 0.0
    return np.maximum(NOISE_SIGMAS * noise, SPACING_FRACTION * spacing_angle * inverse_depth)
