"""What neighbours on one surface say about each other: slopes and bends, lines of three, steps and sizes alike."""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.walks import STEP_WEIGHT, walked
from retrue.kernels import curvature as bend_kernel
from retrue.kernels import lattice as kernel

OUTLIER_SIGMAS = 5.0
LEAST_SIGMA = 0.02  # px, of what tells odd blocks
LEAST_NOISE = 0.004  # px, of a drawing that has none
PRIOR = 4.0  # lines that the noise of the whole picture counts as
DIRECTIONS = 4  # of lines: along rows, columns, and both diagonals


@dataclass(frozen=True, slots=True, eq=False)
class Joints:
    """Which blocks are linked to the next of their row (rows, columns - 1), of their column (rows - 1, columns)."""

    right: BoolArray
    down: BoolArray

    @classmethod
    def none(cls, rows: int, columns: int) -> Joints:
        return cls(np.zeros((rows, columns - 1), dtype=bool), np.zeros((rows - 1, columns), dtype=bool))

    def between(self, held: BoolArray) -> Joints:
        """Only the joints with a held block at both ends."""
        return Joints(self.right & held[:, :-1] & held[:, 1:], self.down & held[:-1] & held[1:])

    def linked(self) -> tuple[BoolArray, BoolArray]:
        """(rows, columns, 2) whether a surface goes on before, and after each block, along its row and its column."""
        right, down = self.right, self.down
        before = np.stack([np.pad(right, ((0, 0), (1, 0))), np.pad(down, ((1, 0), (0, 0)))], axis=-1)
        after = np.stack([np.pad(right, ((0, 0), (0, 1))), np.pad(down, ((0, 1), (0, 0)))], axis=-1)
        return before, after

    def inside(self) -> BoolArray:
        """(rows, columns) blocks that are linked to all four of their neighbours."""
        inside = np.zeros((len(self.right), self.down.shape[1]), dtype=bool)
        inside[1:-1, 1:-1] = self.right[1:-1, :-1] & self.right[1:-1, 1:] & self.down[:-1, 1:-1] & self.down[1:, 1:-1]
        return inside


def median(values: FloatArray) -> float:
    """Of one number or more, all finite: `np.median`, in a sixth of its time."""
    middle = len(values) // 2
    parted = np.partition(values, middle)
    return float(parted[middle] if len(values) % 2 else (parted[:middle].max() + parted[middle]) / 2)


def lengths(vectors: FloatArray) -> FloatArray:
    """(...) of vectors (..., 2): `np.hypot`, in a fifth of its time."""
    x, y = vectors[..., 0], vectors[..., 1]
    return np.sqrt(x * x + y * y)


def slopes(position: FloatArray, joints: Joints) -> tuple[FloatArray, FloatArray]:
    """d position / d column and d position / d row, (rows, columns, 2).

    One-sided at the ends of a surface; where a block has no neighbour in a direction, as its other neighbours have it.
    """
    u, v = np.empty(position.shape), np.empty(position.shape)
    kernel.slopes(position, joints.right, joints.down, u, v)
    return u, v


def bends(position: FloatArray, joints: Joints) -> FloatArray:
    """(rows, columns, 2, 2) second derivatives along the row, along the column; 0 where nothing tells.

    The median of five along the line: a bent surface has them alike, a crease bends two.
    """
    return bends_of(np.arange(position[..., 0].size), position, joints).reshape(*position.shape, 2)


def bends_of(blocks: IntArray, position: FloatArray, joints: Joints) -> FloatArray:
    """(N, 2, 2) the same of some blocks."""
    bend = np.empty((len(blocks), 2, 2))
    bend_kernel.bends(position, joints.right, joints.down, blocks, bend)
    return bend


def sound_joints(position: FloatArray, joints: Joints) -> Joints:
    """The joints whose step is like another one: of the next row or column, or before or after it in its own.

    Where a surface hides part of another, blocks that are no neighbours stand side by side, and at a distance of
    their own.
    """
    sound = Joints(np.empty_like(joints.right), np.empty_like(joints.down))
    kernel.alike_steps(position, joints.right, joints.down, sound.right, sound.down)
    return sound


def in_squares(joints: Joints) -> BoolArray:
    """(rows, columns) blocks that are part of a square of four in which three or all joints hold."""
    right, down = joints.right.view(np.uint8), joints.down.view(np.uint8)
    square = right[:-1] + right[1:] + down[:, :-1] + down[:, 1:] >= 3
    part = np.zeros((len(right), down.shape[1]), dtype=bool)
    for corner in (part[:-1, :-1], part[:-1, 1:], part[1:, :-1], part[1:, 1:]):
        corner |= square
    return part


def whole_blocks(shape: FloatArray, position: FloatArray, joints: Joints) -> BoolArray:
    """(rows, columns) blocks that are as wide, and as high, as their neighbours, measured in steps of the grid.

    `shape` (rows, columns, 2, 2) are the second moments M of the blocks; in grid units, J^-1 M J^-T with J the steps.
    """
    u, v = slopes(position, joints)
    side = np.empty(position.shape)
    kernel.measure_sides(shape.reshape(*shape.shape[:2], 4), u, v, side)
    whole: BoolArray = np.isfinite(side[..., 0])
    if whole.any():
        usual = np.array([median(side[..., k][whole]) for k in range(2)])
        kernel.compare_sides(side, usual, u, v, joints.right, joints.down, whole)
    return whole


def odd_blocks(position: FloatArray, joints: Joints) -> tuple[BoolArray, float]:
    """Blocks (rows, columns) that fit in with none of their neighbours; noise of one coordinate, of the whole picture.

    Each block is compared with the middle of its two neighbours, along the row, the column and both diagonals. A crease
    or the edge of a surface leaves at least one of these lines straight; a block that is off all of them, or has none,
    is off the surface, or was measured badly.
    """
    held: BoolArray = np.isfinite(position[..., 0])
    least, off = np.empty(held.shape), np.empty(DIRECTIONS * position.size)
    off = off[: kernel.line_distances(position, joints.right, joints.down, least, off)]
    sigma = max(median(off) / (0.6745 * 1.5**0.5), LEAST_SIGMA) if len(off) else LEAST_SIGMA
    return held & ~(least <= OUTLIER_SIGMAS * sigma), sigma


def between_neighbours(position: FloatArray, odd: BoolArray, joints: Joints) -> tuple[FloatArray, FloatArray]:
    """Where the lines of three that hold no `odd` block say that each is (rows, columns, 2), NaN: nowhere; and the
    largest distance (rows, columns) between those lines."""
    expected, spread = np.empty(position.shape), np.empty(odd.shape)
    fitting = np.where(odd[..., None], np.nan, position)
    kernel.meet_lines(fitting, joints.right, joints.down, expected, spread)
    return expected, spread


def mean_around(values: FloatArray, joints: Joints, steps: int) -> tuple[FloatArray, FloatArray]:
    """Means (rows, columns, channels) of `values` that are known over the neighbours on one surface, and the sums of
    their squared weights (rows, columns): by how much the mean's variance is less. NaN where none is known.

    The weights are those of a random walk along the joints, a binomial that nothing crosses an edge with.
    """
    known = np.asarray(np.isfinite(values).all(axis=-1), dtype=np.bool_)
    links = joints.right[..., None], joints.down[..., None]
    total = walked(known[..., None].astype(np.float64), *links, steps)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = walked(np.where(known[..., None], values, 0.0), *links, steps) / total
        return mean, _alone(steps) ** 2 * STEP_WEIGHT**steps / total[..., 0]


def _alone(steps: int) -> float:
    """Sum of the squared weights of a walk along one axis, nothing in its way."""
    return comb(4 * steps, 2 * steps) / 4 ** (2 * steps)


def bend_changes(position: FloatArray, joints: Joints) -> FloatArray:
    """Variance of one coordinate (4, rows, columns) from how each line's second differences change; NaN: no line."""
    lines = np.empty((DIRECTIONS, *position.shape[:2]))
    kernel.bend_changes(position, joints.right, joints.down, lines)
    return lines


def usual_variance(position: FloatArray, joints: Joints) -> float:
    """Of one coordinate of places `position`, all over the picture; 1 px^2 where no line tells."""
    return _usual(bend_changes(position, joints))


def _usual(lines: FloatArray) -> float:
    known = lines[np.isfinite(lines)]
    # The mean of two squared normal coordinates has its median at ln 2.
    return median(known) / np.log(2) if len(known) else 1.0


def noise_of(position: FloatArray, joints: Joints) -> FloatArray:
    """Standard deviation per axis (rows, columns) of places `position` (rows, columns, 2).

    Along each row, column and diagonal of a smooth surface the second differences hardly change, so their changes are
    noise. One block has up to four lines of its own, of two coordinates: they are averaged with the noise of the whole
    picture, as if that were PRIOR lines more.
    """
    lines = bend_changes(position, joints)
    known = np.isfinite(lines)
    usual = max(_usual(lines), LEAST_NOISE**2)
    own = np.where(known, lines, 0.0).sum(axis=0)
    sigma = np.sqrt(np.maximum((PRIOR * usual + own) / (PRIOR + known.sum(axis=0)), LEAST_NOISE**2))
    return np.where(np.isfinite(position[..., 0]), sigma, np.nan)
