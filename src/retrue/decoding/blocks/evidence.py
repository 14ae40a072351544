"""How well blocks match the code where they stand, beyond chance, and whether their neighbours do."""

from __future__ import annotations

import numpy as np

from retrue.decoding.blocks.links import NONE, Links
from retrue.decoding.blocks.surface import Joints
from retrue.decoding.blocks.windows import INTEGERS, OUT_INTEGERS, WINDOWS, Code, moved
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.compiling import compiled, numba

SIGNIFICANCE = 28.0  # nats by which a surface must beat chance; pictures of other grids reach 22


def neighbours_colors(
    code: Code, links: Links, label: IntArray, clear: BoolArray, place: IntArray
) -> tuple[IntArray, IntArray]:
    """How many of the eight neighbours of each block (N,) stand where it says and have the colour that the code has
    there; and how many are `clear`ly of another colour, wherever they stand."""
    agreeing, contradicting = np.zeros(len(place), np.int64), np.zeros(len(place), np.int64)
    _count_colors(code.cells, links.around, links.around_turn, label, clear, place, agreeing, contradicting)
    return agreeing, contradicting


@compiled(
    numba.void(
        *[WINDOWS] * 3,
        INTEGERS,
        numba.types.Array(numba.boolean, 1, "C", readonly=True),
        INTEGERS,
        OUT_INTEGERS,
        OUT_INTEGERS,
    )
)
def _count_colors(
    cells: IntArray,
    around: IntArray,
    turn: IntArray,
    label: IntArray,
    clear: BoolArray,
    place: IntArray,
    agreeing: IntArray,
    contradicting: IntArray,
) -> None:
    rows, columns = cells.shape
    for n in range(len(place)):
        for cell in range(9):
            there, expected = around[n, cell], moved(place[n], cell, turn[n, cell], rows, columns)
            if cell == 4 or there < 0 or expected < 0:
                continue
            if label[there] != cells[expected // (4 * columns), expected // 4 % columns]:
                contradicting[n] += clear[there]
            elif place[there] == expected:
                agreeing[n] += 1


def surface_evidence(code: Code, links: Links, label: IntArray, place: IntArray) -> FloatArray:
    """By how many nats the surface of each block (N,), held by agreeing links, matches the code beyond chance."""
    ends = np.empty((links.around.size, 2), np.int64)
    ends = ends[: _agree(code.cells, links.around, links.around_turn, place, ends)]
    return _evidence(code, ends, place >= 0, code.color(place) == label)


def patch_evidence(code: Code, joints: Joints, held: BoolArray, right: BoolArray) -> FloatArray:
    """The same (rows, columns), of places that are `held` and of the `right` colour, linked by joints."""
    index = np.arange(held.size).reshape(held.shape)
    along = np.stack([index[:, :-1][joints.right], index[:, 1:][joints.right]], axis=-1)
    across = np.stack([index[:-1][joints.down], index[1:][joints.down]], axis=-1)
    ends = np.concatenate([along, across])
    return _evidence(code, ends, held.ravel(), (held & right).ravel()).reshape(held.shape)


def _evidence(code: Code, ends: IntArray, placed: BoolArray, right: BoolArray) -> FloatArray:
    """m of n colours right has probability C(n, m) q^m, q of one colour by chance; and a surface could have been laid
    over any place of the code, starting from any of its blocks."""
    from scipy.special import gammaln

    count = len(placed)
    surface = np.arange(count)
    _join(ends, surface)
    n, m = np.bincount(surface, placed), np.bincount(surface, placed & right)
    some = np.flatnonzero(n)
    n, m, nats = n[some], m[some], np.full(count, -np.inf)
    log_chance = gammaln(n + 1) - gammaln(m + 1) - gammaln(n - m + 1) - m * np.log(max(code.base - 1, 2))
    log_trials = np.log(len(code.windows)) + np.log(max(int(placed.sum()), 1))
    nats[some] = -(log_chance + log_trials)
    return np.where(placed, nats[surface], -np.inf)


@compiled(numba.void(WINDOWS, OUT_INTEGERS))
def _join(ends: IntArray, surface: IntArray) -> None:
    """`surface` (N,), 0 .. N - 1 at first <- one number for all that are linked."""
    for k in range(len(ends)):
        a, b = ends[k]
        while surface[a] != a:
            surface[a] = a = surface[surface[a]]
        while surface[b] != b:
            surface[b] = b = surface[surface[b]]
        surface[max(a, b)] = min(a, b)
    for k in range(len(surface)):
        surface[k] = surface[surface[k]]


@compiled(numba.int64(*[WINDOWS] * 3, INTEGERS, numba.types.Array(numba.int64, 2, "C")))
def _agree(cells: IntArray, around: IntArray, turn: IntArray, place: IntArray, ends: IntArray) -> int:
    """`ends` (E, 2) <- the pairs of blocks of which one stands where the other says; their number."""
    count, (rows, columns) = 0, cells.shape
    for n in range(len(place)):
        for cell in range(9):
            there = around[n, cell]
            if cell == 4 or there < 0 or place[n] < 0 or place[there] < 0:
                continue
            if place[there] == moved(place[n], cell, turn[n, cell], rows, columns):
                ends[count] = n, there
                count += 1
    return count


def joined_places(links: Links, place: IntArray, holder: IntArray) -> Joints:
    """Which places of the code, held by blocks, are linked to the next one of their row and of their column."""
    right, down = np.full_like(holder, NONE), np.full_like(holder, NONE)
    held = holder >= 0
    blob = holder[held]
    right[held] = links.neighbour[blob, (0 - place[blob]) % 4]
    down[held] = links.neighbour[blob, (1 - place[blob]) % 4]
    return Joints((right[:, :-1] >= 0) & (right[:, :-1] == holder[:, 1:]), (down[:-1] >= 0) & (down[:-1] == holder[1:]))
