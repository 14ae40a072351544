"""What neighbours on one surface say about each other: slopes, bends, and blocks that are not as large."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from retrue.geometry.arrays import BoolArray, FloatArray
from retrue.geometry.compiling import OUT_STACK, STACK, VECTOR, compiled, numba

CREASE = 0.1  # change of the pitch from one block to the next that no smooth surface shows
STEP_CHANGE = 0.25  # of a step, to the most similar step beside it or before or after it, on one surface
SIDE_CHANGE, PIXELS_CHANGE = 1.15, 1.0  # of a block, from its neighbours on one surface; and that many px / its side
Scalar = TypeVar("Scalar", bound=np.generic)


@dataclass(frozen=True, slots=True, eq=False)
class Joints:
    """Which blocks are linked to the next of their row (rows, columns - 1), of their column (rows - 1, columns)."""

    right: BoolArray
    down: BoolArray

    def between(self, held: BoolArray) -> Joints:
        """Only the joints with a held block at both ends."""
        return Joints(self.right & held[:, :-1] & held[:, 1:], self.down & held[:-1] & held[1:])

    def inside(self) -> BoolArray:
        """(rows, columns) blocks that are linked to all four of their neighbours."""
        right, down = np.pad(self.right, ((0, 0), (1, 1))), np.pad(self.down, ((1, 1), (0, 0)))
        return right[:, :-1] & right[:, 1:] & down[:-1] & down[1:]


def shifted(grid: NDArray[Scalar], step: tuple[int, int], fill: float) -> NDArray[Scalar]:
    """`grid` (rows, columns, ...) seen from one `step` (down, right) away: result[r, c] = grid[r + down, c + right]."""
    result = np.full_like(grid, fill)
    rows, columns = grid.shape[:2]
    down, right = step
    target = slice(max(0, -down), rows - max(0, down)), slice(max(0, -right), columns - max(0, right))
    source = slice(max(0, down), rows + min(0, down)), slice(max(0, right), columns + min(0, right))
    result[target] = grid[source]
    return result


def slopes(position: FloatArray, joints: Joints) -> tuple[FloatArray, FloatArray, FloatArray]:
    """d position / d column, d position / d row, and the sum of both second derivatives, (rows, columns, 2) each.

    One-sided at the ends of a surface; where a block has no neighbour in a direction, as its other neighbours have it.
    """
    u, v, bend = np.full_like(position, np.nan), np.full_like(position, np.nan), np.zeros_like(position)
    _slopes(np.ascontiguousarray(position), joints.right, u, bend, 0, 1)
    _slopes(np.ascontiguousarray(position), joints.down, v, bend, 1, 0)
    for slope in (u, v):
        _borrow(slope.copy(), np.isfinite(position[..., 0]), joints.right, joints.down, slope)
    return u, v, bend


FLAGS = numba.types.Array(numba.boolean, 2, "A", readonly=True)


@compiled(numba.void(STACK, FLAGS, OUT_STACK, OUT_STACK, numba.int64, numba.int64))
def _slopes(
    position: FloatArray, linked: BoolArray, slope: FloatArray, bend: FloatArray, down: int, right: int
) -> None:
    """`slope` (rows, columns, 2) <- mean of the steps before and after each block; `bend` += their difference."""
    rows, columns, _ = position.shape
    for r in range(rows):
        for c in range(columns):
            ahead = r < rows - down and c < columns - right and linked[r, c]
            behind = r >= down and c >= right and linked[r - down, c - right]
            size, change = 0.0, 0.0
            for k in range(2):
                here = position[r, c, k]
                step = position[r + down, c + right, k] - here if ahead else np.nan
                before = here - position[r - down, c - right, k] if behind else np.nan
                if np.isnan(step):
                    slope[r, c, k] = before
                elif np.isnan(before):
                    slope[r, c, k] = step
                else:
                    slope[r, c, k] = (step + before) / 2
                size += slope[r, c, k] ** 2
                change += (step - before) ** 2
            if change < CREASE**2 * size:
                for k in range(2):
                    bend[r, c, k] += position[r + down, c + right, k] - 2 * position[r, c, k]
                    bend[r, c, k] += position[r - down, c - right, k]


@compiled(numba.void(OUT_STACK, FLAGS, FLAGS, FLAGS, OUT_STACK))
def _borrow(known: FloatArray, here: BoolArray, right: BoolArray, down: BoolArray, slope: FloatArray) -> None:
    """`slope`, where blocks that are `here` lack it, <- the mean of what their linked neighbours have."""
    rows, columns, _ = known.shape
    for r in range(rows):
        for c in range(columns):
            if not here[r, c] or np.isfinite(known[r, c, 0]):
                continue
            x, y, count = 0.0, 0.0, 0
            for dr, dc in ((0, 1), (0, -1), (1, 0), (-1, 0)):
                i, j = r + dr, c + dc
                if not (0 <= i < rows and 0 <= j < columns and np.isfinite(known[i, j, 0])):
                    continue
                if right[r, min(c, j)] if dr == 0 else down[min(r, i), c]:
                    x += known[i, j, 0]
                    y += known[i, j, 1]
                    count += 1
            if count > 0:
                slope[r, c, 0], slope[r, c, 1] = x / count, y / count


def sound_joints(position: FloatArray, joints: Joints) -> Joints:
    """The joints whose step is like another one: of the next row or column, or before or after it in its own.

    Where a surface hides part of another, blocks that are no neighbours stand side by side, and at a distance of
    their own.
    """
    right, down = np.zeros_like(joints.right), np.zeros_like(joints.down)
    position = np.ascontiguousarray(position)
    _like_another(position, joints.right, 0, 1, right)
    _like_another(position, joints.down, 1, 0, down)
    return Joints(right, down)


@compiled(numba.void(STACK, FLAGS, numba.int64, numba.int64, numba.types.Array(numba.boolean, 2, "C")))
def _like_another(position: FloatArray, linked: BoolArray, down: int, right: int, alike: BoolArray) -> None:
    """`alike` <- which of the `linked` steps to (down, right) are like the one beside, before or after them."""
    rows, columns = linked.shape
    for r in range(rows):
        for c in range(columns):
            if not linked[r, c]:
                continue
            x = position[r + down, c + right, 0] - position[r, c, 0]
            y = position[r + down, c + right, 1] - position[r, c, 1]
            for dr, dc in ((0, 1), (0, -1), (1, 0), (-1, 0)):
                i, j = r + dr, c + dc
                if 0 <= i < rows and 0 <= j < columns and linked[i, j]:
                    dx = position[i + down, j + right, 0] - position[i, j, 0] - x
                    dy = position[i + down, j + right, 1] - position[i, j, 1] - y
                    if dx * dx + dy * dy < STEP_CHANGE**2 * (x * x + y * y):
                        alike[r, c] = True


def in_squares(joints: Joints) -> BoolArray:
    """(rows, columns) blocks that are part of a square of four in which three or all joints hold."""
    right, down = joints.right.astype(int), joints.down.astype(int)
    square = right[:-1] + right[1:] + down[:, :-1] + down[:, 1:] >= 3
    padded = np.pad(square, 1)
    return padded[:-1, :-1] | padded[:-1, 1:] | padded[1:, :-1] | padded[1:, 1:]


def whole_blocks(shape: FloatArray, position: FloatArray, joints: Joints) -> BoolArray:
    """(rows, columns) blocks that are as wide, and as high, as their neighbours, measured in steps of the grid.

    `shape` (rows, columns, 2, 2) are the second moments M of the blocks; in grid units, J^-1 M J^-T with J the steps.
    """
    right, down, _ = slopes(position, joints)
    side = np.full_like(position, np.nan)
    _sides(np.ascontiguousarray(shape.reshape(*shape.shape[:2], 4)), right, down, side)
    known: BoolArray = np.isfinite(side[..., 0] + side[..., 1])
    if not known.any():
        return known
    usual = np.median(side[known], axis=0)
    _compare_sides(side, usual, right, down, joints.right, joints.down, known)
    return known


@compiled(numba.void(STACK, STACK, STACK, OUT_STACK))
def _sides(shape: FloatArray, right: FloatArray, down: FloatArray, side: FloatArray) -> None:
    """`side` (rows, columns, 2) <- standard deviation of each block along its row and column, in steps of the grid."""
    for r in range(len(shape)):
        for c in range(shape.shape[1]):
            ux, uy, vx, vy = right[r, c, 0], right[r, c, 1], down[r, c, 0], down[r, c, 1]
            xx, xy, yy = shape[r, c, 0], shape[r, c, 1], shape[r, c, 3]
            size = abs(ux * vy - uy * vx)
            side[r, c, 0] = np.sqrt(vy * vy * xx - 2 * vx * vy * xy + vx * vx * yy) / size
            side[r, c, 1] = np.sqrt(uy * uy * xx - 2 * ux * uy * xy + ux * ux * yy) / size


@compiled(numba.void(STACK, VECTOR, STACK, STACK, FLAGS, FLAGS, numba.types.Array(numba.boolean, 2, "C")))
def _compare_sides(
    side: FloatArray,
    usual: FloatArray,
    right: FloatArray,
    down: FloatArray,
    linked_right: BoolArray,
    linked_down: BoolArray,
    alike: BoolArray,
) -> None:
    """`alike` is cleared where a block's sides are not those of its linked neighbours, or the `usual` ones for lack."""
    rows, columns = alike.shape
    for r in range(rows):
        for c in range(columns):
            if not alike[r, c]:
                continue
            for k in range(2):
                total, least, most = 0.0, np.inf, 0.0
                for dr, dc in ((0, 1), (0, -1), (1, 0), (-1, 0)):
                    i, j, other = r + dr, c + dc, usual[k]
                    if 0 <= i < rows and 0 <= j < columns:
                        linked = linked_right[r, min(c, j)] if dr == 0 else linked_down[min(r, i), c]
                        if linked and np.isfinite(side[i, j, k]):
                            other = side[i, j, k]
                    total, least, most = total + other, min(least, other), max(most, other)
                like = (total - least - most) / 2  # their median
                pitch = np.hypot(right[r, c, 0], right[r, c, 1]) if k == 0 else np.hypot(down[r, c, 0], down[r, c, 1])
                change = SIDE_CHANGE + PIXELS_CHANGE / max(12**0.5 * like * pitch, 1.0)
                if not like / change < side[r, c, k] < change * like:
                    alike[r, c] = False
