"""Which block is whose neighbour: a grid without global directions, as perspective and depth edges leave it."""

from __future__ import annotations

import numpy as np

from retrue.decoding.blocks.blobs import Blocks
from retrue.decoding.blocks.nearest import nearest_of_all
from retrue.geometry.arrays import FloatArray, IntArray
from retrue.geometry.compiling import MATRIX, OUT_MATRIX, VECTOR, called, compiled, numba

CANDIDATES = 8  # nearest blobs that may be one of the four neighbours, or one of the four diagonal ones
SIZE_RATIO = 2.2  # between the areas of neighbours
SHAPE_RATIO = 2.5  # between the spacings that neighbours measure, each in its own shape
SINE_OFF_AXIS = float(np.sin(np.radians(24)))
NONE = -1


class Links:
    """Four neighbours of each block, counter-clockwise in a frame of the block's own.

    Attributes
    ----------
    neighbour : (N, 4) index of the neighbour in direction k, or -1; k and k + 2 are opposite.
    turn : (N, 4) quarter turns to add to a direction of this block to get the same one of the neighbour.
    around : (N, 9) the 3x3 window about each block in its own frame, row by row, or -1.
    around_turn : (N, 9) quarter turns to the frame of each of them.
    """

    __slots__ = ("around", "around_turn", "neighbour", "turn")

    def __init__(self, neighbour: IntArray, turn: IntArray) -> None:
        self.neighbour, self.turn = neighbour, turn
        self.around, self.around_turn = np.full((len(neighbour), 9), NONE), np.zeros((len(neighbour), 9), np.int64)
        _fill_windows(neighbour, turn, self.around, self.around_turn)


def link_blocks(blocks: Blocks) -> Links:
    """Neighbours along the two directions of the blocks' own sides.

    The second moments M of a blob tell the parallelogram that perspective made of the square: in the
    frame M^-1/2 the block is a square again and its neighbours lie at right angles, at equal distances,
    however steep the surface. What is left is a rotation, and that is the fourfold mean of the directions
    to the neighbours. Only mutual links stay.
    """
    count = len(blocks)
    if count < 9:
        return Links(np.full((count, 4), NONE), np.zeros((count, 4), np.int64))
    near = nearest_of_all(blocks.centre, blocks.centre, min(CANDIDATES + 1, count))[1][:, 1:]
    chosen, neighbour, turn = np.full((count, 4), NONE), np.full((count, 4), NONE), np.zeros((count, 4), np.int64)
    whiten = np.ascontiguousarray(_inverse_roots(blocks.shape).reshape(-1, 4))
    _choose(blocks.centre, whiten, blocks.area(), near, chosen)
    _keep_mutual(chosen, neighbour, turn)
    return Links(neighbour, turn)


_INTEGERS = numba.types.Array(numba.int64, 2, "A")


@called
def _norm(x: float, y: float) -> float:
    return np.sqrt(x * x + y * y)


@compiled(numba.void(MATRIX, MATRIX, VECTOR, _INTEGERS, _INTEGERS))
def _choose(centre: FloatArray, whiten: FloatArray, area: FloatArray, near: IntArray, neighbour: IntArray) -> None:
    """`neighbour` (N, 4) <- the nearest blob of `near` (N, M) in each direction of the block's own frame, or -1."""
    candidates = near.shape[1]
    length, ax, ay = np.empty(candidates), np.empty(candidates), np.empty(candidates)
    best = np.empty(4)
    for n in range(len(centre)):
        shortest = np.inf
        for m in range(candidates):
            other = near[n, m]
            x, y = centre[other, 0] - centre[n, 0], centre[other, 1] - centre[n, 1]
            sx, sy = whiten[n, 0] * x + whiten[n, 1] * y, whiten[n, 2] * x + whiten[n, 3] * y
            # The same step as the other end sees it: where the two disagree, they are not blocks of one surface.
            here, there = (
                _norm(sx, sy),
                _norm(whiten[other, 0] * x + whiten[other, 1] * y, whiten[other, 2] * x + whiten[other, 3] * y),
            )
            ratio = area[other] / area[n]
            similar = 1 / SIZE_RATIO < ratio < SIZE_RATIO and there < SHAPE_RATIO * here and here < SHAPE_RATIO * there
            length[m], ax[m], ay[m] = here if similar else np.inf, sx / here, sy / here
            shortest = min(shortest, length[m])
        cosine, sine = 0.0, 0.0
        for m in range(candidates):
            if length[m] < 1.25 * shortest:
                c, s = ax[m] * ax[m] - ay[m] * ay[m], 2 * ax[m] * ay[m]  # of twice the angle
                cosine += c * c - s * s
                sine += 2 * c * s
        frame = np.arctan2(sine, cosine) / 4  # direction 0, in the whitened frame, in [-45, 45) degrees
        cosine, sine = np.cos(frame), np.sin(frame)
        best[:] = 1.6 * shortest
        for m in range(candidates):
            x, y = cosine * ax[m] + sine * ay[m], cosine * ay[m] - sine * ax[m]
            flat = abs(x) > abs(y)
            direction = (0 if x > 0 else 2) if flat else (1 if y > 0 else 3)
            off = abs(y) if flat else abs(x)
            if off < SINE_OFF_AXIS and length[m] < best[direction]:
                best[direction], neighbour[n, direction] = length[m], near[n, m]


def lengths_and_bends(blocks: Blocks, links: Links) -> tuple[FloatArray, FloatArray]:
    """Of each link (N, 4): its length in standard deviations of the block it starts from, and its change to the link
    before or after it, the lesser one, over its length; NaN where there is none."""
    length, bend = np.full(links.neighbour.shape, np.nan), np.full(links.neighbour.shape, np.nan)
    whiten = np.ascontiguousarray(_inverse_roots(blocks.shape).reshape(-1, 4))
    _measure(blocks.centre, whiten, links.neighbour, links.turn, length, bend)
    return length, bend


@compiled(numba.void(MATRIX, MATRIX, _INTEGERS, _INTEGERS, OUT_MATRIX, OUT_MATRIX))
def _measure(
    centre: FloatArray, whiten: FloatArray, neighbour: IntArray, turn: IntArray, length: FloatArray, bend: FloatArray
) -> None:
    for n in range(len(centre)):
        for k in range(4):
            other = neighbour[n, k]
            if other < 0:
                continue
            x, y = centre[other, 0] - centre[n, 0], centre[other, 1] - centre[n, 1]
            sx, sy = whiten[n, 0] * x + whiten[n, 1] * y, whiten[n, 2] * x + whiten[n, 3] * y
            length[n, k] = _norm(sx, sy)
            change = np.inf
            before, after = neighbour[n, (k + 2) % 4], neighbour[other, (k + turn[n, k]) % 4]
            if before >= 0:
                change = _norm(x - centre[n, 0] + centre[before, 0], y - centre[n, 1] + centre[before, 1])
            if after >= 0:
                change = min(
                    change, _norm(x - centre[after, 0] + centre[other, 0], y - centre[after, 1] + centre[other, 1])
                )
            if np.isfinite(change):
                bend[n, k] = change / _norm(x, y)


@compiled(numba.void(*[_INTEGERS] * 3))
def _keep_mutual(chosen: IntArray, neighbour: IntArray, turn: IntArray) -> None:
    """`neighbour` (N, 4) <- those of `chosen` that both ends see; `turn` between the frames of the ends."""
    for n in range(len(chosen)):
        for k in range(4):
            other = chosen[n, k]
            if other < 0:
                continue
            for back in range(4):
                if chosen[other, back] == n:
                    neighbour[n, k], turn[n, k] = other, (back + 2 - k) % 4
                    break


@compiled(numba.void(*[_INTEGERS] * 4))
def _fill_windows(neighbour: IntArray, turn: IntArray, around: IntArray, turns: IntArray) -> None:
    """(N, 9) the blocks about each block and their turns, row by row; directions 0 1 2 3 are right, down, left, up.

    A diagonal block is reached over either side neighbour; where both ways exist they must agree.
    """
    for n in range(len(neighbour)):
        around[n, 4] = n
        for k, cell in enumerate((5, 7, 3, 1)):
            around[n, cell], turns[n, cell] = neighbour[n, k], turn[n, k]
        for k, cell in enumerate((8, 6, 0, 2)):
            for first, then in ((k, (k + 1) % 4), ((k + 1) % 4, k)):
                side, side_turn = neighbour[n, first], turn[n, first]
                if side < 0:
                    continue
                direction = (then + side_turn) % 4
                corner, corner_turn = neighbour[side, direction], (side_turn + turn[side, direction]) % 4
                if corner < 0:
                    continue
                if around[n, cell] >= 0 and (around[n, cell] != corner or turns[n, cell] != corner_turn):
                    around[n, cell] = NONE
                else:
                    around[n, cell], turns[n, cell] = corner, corner_turn


def _inverse_roots(shape: FloatArray) -> FloatArray:
    """M^-1/2 of symmetric positive (N, 2, 2), in closed form."""
    a, b, c = shape[:, 0, 0], shape[:, 0, 1], shape[:, 1, 1]
    root = np.sqrt(np.maximum(a * c - b * b, 1e-9))
    scale = 1 / (root * np.sqrt(a + c + 2 * root))
    inverse = np.empty_like(shape)
    inverse[:, 0, 0], inverse[:, 1, 1] = (c + root) * scale, (a + root) * scale
    inverse[:, 0, 1] = inverse[:, 1, 0] = -b * scale
    return inverse
