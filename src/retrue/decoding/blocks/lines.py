"""Lines of three blocks: each should be in the middle of its neighbours, along rows, columns and diagonals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.decoding.blocks.surface import FLAGS, Joints
from retrue.geometry.arrays import BoolArray, FloatArray
from retrue.geometry.compiling import OUT_MATRIX, OUT_STACK, OUT_VECTOR, STACK, compiled, numba

OUTLIER_SIGMAS = 5.0
LEAST_SIGMA = 0.02  # px
DIRECTIONS = ((0, 1), (1, 0), (1, 1), (1, -1))


@dataclass(frozen=True, slots=True, eq=False)
class Agreement:
    """How each block fits in with its neighbours.

    Attributes
    ----------
    odd : (rows, columns) blocks that fit in no line of three in any of the four directions, or have no such line.
    expected : (rows, columns, 2) where the lines of three that hold no odd block say it is; NaN: nowhere.
    spread : (rows, columns) largest distance between those lines.
    sigma : noise of one coordinate, of the whole picture.
    """

    odd: BoolArray
    expected: FloatArray
    spread: FloatArray
    sigma: float


def agreement(position: FloatArray, joints: Joints) -> Agreement:
    """Compare each block with the middle of its two neighbours, along the row, the column and both diagonals.

    A crease or the edge of a surface leaves at least one of these lines straight; a block that is off all of
    them is off the surface, or was measured badly.
    """
    lines, held = middles(position, joints), np.isfinite(position[..., 0])
    least, off = np.full(held.shape, np.inf), np.empty(lines.size)
    off = off[: _distances(np.ascontiguousarray(position), lines, least, off)]
    sigma = max(float(np.median(off)) / (0.6745 * 1.5**0.5), LEAST_SIGMA) if len(off) else LEAST_SIGMA
    odd = held & ~(least <= OUTLIER_SIGMAS * sigma)
    if odd.any():
        lines = middles(np.where(odd[..., None], np.nan, position), joints)
    expected, spread = np.full_like(position, np.nan), np.zeros(held.shape)
    _meet(lines, expected, spread)
    return Agreement(odd, expected, spread, sigma)


_LINES = numba.types.Array(numba.float64, 4, "C")


@compiled(numba.int64(STACK, _LINES, OUT_MATRIX, OUT_VECTOR))
def _distances(position: FloatArray, lines: FloatArray, least: FloatArray, off: FloatArray) -> int:
    """`least` (rows, columns) <- distance to the nearest line; `off` <- all offsets, as many as are returned."""
    count = 0
    for k in range(len(lines)):
        for r in range(len(position)):
            for c in range(position.shape[1]):
                x, y = abs(position[r, c, 0] - lines[k, r, c, 0]), abs(position[r, c, 1] - lines[k, r, c, 1])
                if np.isfinite(x + y):
                    least[r, c] = min(least[r, c], np.sqrt(x * x + y * y))
                    off[count], off[count + 1] = x, y
                    count += 2
    return count


@compiled(numba.void(_LINES, OUT_STACK, OUT_MATRIX))
def _meet(lines: FloatArray, expected: FloatArray, spread: FloatArray) -> None:
    """`expected` (rows, columns, 2) <- mean of two lines or more; `spread` <- how far they are from it at most."""
    for r in range(lines.shape[1]):
        for c in range(lines.shape[2]):
            x, y, count = 0.0, 0.0, 0
            for k in range(len(lines)):
                if np.isfinite(lines[k, r, c, 0]):
                    x += lines[k, r, c, 0]
                    y += lines[k, r, c, 1]
                    count += 1
            if count < 2:
                continue
            expected[r, c, 0], expected[r, c, 1] = x / count, y / count
            for k in range(len(lines)):
                if np.isfinite(lines[k, r, c, 0]):
                    dx, dy = lines[k, r, c, 0] - expected[r, c, 0], lines[k, r, c, 1] - expected[r, c, 1]
                    spread[r, c] = max(spread[r, c], np.sqrt(dx * dx + dy * dy))


def middles(position: FloatArray, joints: Joints) -> FloatArray:
    """(4, rows, columns, 2) middle of the two linked neighbours of each block in each of DIRECTIONS; NaN where none."""
    lines = np.full((len(DIRECTIONS), *position.shape), np.nan)
    _middles(np.ascontiguousarray(position), joints.right, joints.down, lines)
    return lines


@compiled(numba.void(STACK, FLAGS, FLAGS, _LINES))
def _middles(position: FloatArray, right: BoolArray, down: BoolArray, lines: FloatArray) -> None:
    """The same; a diagonal neighbour is linked over either corner."""
    rows, columns, _ = position.shape
    linked = np.zeros((4, rows, columns), dtype=np.bool_)  # each block to the next in that direction
    for r in range(rows):
        for c in range(columns):
            ahead, below = c < columns - 1 and right[r, c], r < rows - 1 and down[r, c]
            linked[0, r, c], linked[1, r, c] = ahead, below
            if r == rows - 1:
                continue
            if c < columns - 1:
                linked[2, r, c] = (ahead and down[r, c + 1]) or (below and right[r + 1, c])
            if c > 0:
                linked[3, r, c] = (right[r, c - 1] and down[r, c - 1]) or (below and right[r + 1, c - 1])
    for k, (dr, dc) in enumerate(DIRECTIONS):
        for r in range(dr, rows - dr):
            for c in range(abs(dc), columns - abs(dc)):
                if linked[k, r, c] and linked[k, r - dr, c - dc]:
                    for i in range(2):
                        lines[k, r, c, i] = (position[r + dr, c + dc, i] + position[r - dr, c - dc, i]) / 2
