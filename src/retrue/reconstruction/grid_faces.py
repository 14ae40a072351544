"""Faces between neighbouring cells of a grid."""

from __future__ import annotations

import numpy as np

from retrue.errors import InputError
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.reconstruction.depth_jumps import jump_limit

LARGEST_GRID = 200_000_000  # cells; more is a mistake, and would not fit into memory


def grid_faces(points: FloatArray, cells: IntArray) -> IntArray:
    """Faces (M, 3) between points (N, 3) whose cells (N, 2) are direct neighbours with no depth jump between.

    Where two points claim one cell, the later one holds it.
    """
    cells = cells - cells.min(axis=0)
    height, width = (int(length) + 1 for length in cells.max(axis=0))
    if not height * width <= LARGEST_GRID:
        raise InputError(f"cells: expected a grid of at most {LARGEST_GRID} cells, found {height} x {width}")
    index = np.full((height, width), -1, dtype=np.int64)
    index[cells[:, 0], cells[:, 1]] = np.arange(len(points))
    right, down = _continuous(points, index)
    return _corner_faces(index, right, down)


def _continuous(points: FloatArray, index: IntArray) -> tuple[BoolArray, BoolArray]:
    """Whether the surface goes on from each cell to the next one in its row, and to the next in its column."""
    w = np.where(index >= 0, 1 / points[index, 2], np.nan)
    step_right, step_down = _slope_residual(w), _slope_residual(w.T).T
    residuals = np.concatenate([step_right.ravel(), step_down.ravel()])
    angles = np.concatenate(
        [_spacing_angle(points, index[:, :-1], index[:, 1:]), _spacing_angle(points, index[:-1], index[1:])]
    )
    angle = float(np.median(angles)) if len(angles) else 0.0
    limit = jump_limit(residuals, w, angle)
    return step_right <= np.fmin(limit[:, :-1], limit[:, 1:]), step_down <= np.fmin(limit[:-1], limit[1:])


def _spacing_angle(points: FloatArray, a: IntArray, b: IntArray) -> FloatArray:
    """Distance over depth of the neighbours `a` and `b`, wherever there are both."""
    both = (a >= 0) & (b >= 0)
    near, far = points[a[both]], points[b[both]]
    return np.linalg.norm(far - near, axis=1) / near[:, 2]


def _slope_residual(w: FloatArray) -> FloatArray:
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


def _corner_faces(index: IntArray, right: BoolArray, down: BoolArray) -> IntArray:
    """Two faces a square whose four sides are continuous; one where just one corner is missing or cut off."""
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]  # a b over c d
    top, bottom, left, right_side = right[:-1], right[1:], down[:, :-1], down[:, 1:]
    whole = top & bottom & left & right_side
    corners = (
        (whole, (a, b, c)),
        (whole, (b, d, c)),
        (~top & ~left & bottom & right_side, (b, d, c)),
        (~top & ~right_side & bottom & left, (a, d, c)),
        (~bottom & ~left & top & right_side, (a, b, d)),
        (~bottom & ~right_side & top & left, (a, b, c)),
    )
    return np.concatenate([np.stack([corner[where] for corner in triangle], axis=1) for where, triangle in corners])
