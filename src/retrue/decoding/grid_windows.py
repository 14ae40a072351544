"""Where in the code each block stands: every 3x3 window looked up, all windows voting, links that must agree."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from retrue.decoding.grid_links import NONE, Links
from retrue.decoding.grid_surface import Joints
from retrue.errors import InputError
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.compiling import compiled, inlined, numba
from retrue.patterns.color_grid import ColorGrid

EXACT_VOTE, CORRECTED_VOTE = 3, 1
SIGNIFICANCE = 28.0  # nats by which a surface must beat chance; pictures of other grids reach 22
OFFSETS = np.array([(r, c) for r in (-1, 0, 1) for c in (-1, 0, 1)])  # the cells of a window, row by row


COSINE, SINE = np.array([1, 0, -1, 0]), np.array([0, 1, 0, -1])  # of quarter turns


class Code:
    """The code of a grid, and its windows in all four rotations, to look up.

    A place is one number, (row * columns + column) * 4 + rotation: where a block stands, and by how many
    quarter turns its own frame is rotated against the code's.
    """

    def __init__(self, pattern: ColorGrid) -> None:
        self.cells = np.asarray(pattern.code, dtype=np.int64)
        self.base = len(pattern.colors)
        self.rows, self.columns = self.cells.shape
        if min(self.rows, self.columns) < 3:
            raise InputError(f"color grid: expected 3 x 3 blocks or more, found {self.rows} x {self.columns}")
        inner = np.argwhere(np.ones((self.rows - 2, self.columns - 2), dtype=bool)) + 1
        places: list[IntArray] = []
        windows: list[IntArray] = []
        for rotation in range(4):
            at = inner[:, None] + rotated(OFFSETS, np.array(rotation))
            windows.append(self.cells[at[..., 0], at[..., 1]])
            places.append((inner[:, 0] * self.columns + inner[:, 1]) * 4 + rotation)
        self.windows, self.places = np.concatenate(windows), np.concatenate(places)
        self.tables = {without: self._table(without) for without in (None, *range(9))}

    def split(self, place: IntArray) -> tuple[IntArray, IntArray, IntArray]:
        """Row, column and rotation of places."""
        return place // (4 * self.columns), place // 4 % self.columns, place % 4

    def color(self, place: IntArray) -> IntArray:
        """Colour index that the code has at each place; -1 for none."""
        row, column, _ = self.split(np.maximum(place, 0))
        return np.where(place >= 0, self.cells[row, column], NONE)

    def find(self, seen: IntArray, without: int | None = None) -> IntArray:
        """Place of each window (N, 9) of colour indices, one cell left out if asked; -1 where none or several fit."""
        weight, keys, places = self.tables[without]
        if len(keys) == 0:
            return np.full(len(seen), NONE)
        place = np.full(len(seen), NONE)
        _look_up(np.ascontiguousarray(seen), weight, keys, places, place)
        return place

    def _table(self, without: int | None) -> tuple[IntArray, IntArray, IntArray]:
        """Weights (9,) that make a key of a window, the keys that only one window has, in order, and their places."""
        weight = self.base ** np.arange(9)
        if without is not None:
            weight[without] = 0
        keys = self.windows @ weight
        order = np.argsort(keys, kind="stable")
        step = np.diff(keys[order]) != 0
        alone = np.concatenate([[True], step]) & np.concatenate([step, [True]])
        return weight, keys[order[alone]], self.places[order[alone]]


_INTEGERS = numba.types.Array(numba.int64, 1, "C", readonly=True)
_WINDOWS = numba.types.Array(numba.int64, 2, "C", readonly=True)
_FLAGS = numba.types.Array(numba.boolean, 1, "C", readonly=True)
_OUT_INTEGERS = numba.types.Array(numba.int64, 1, "C")


@compiled(numba.void(_WINDOWS, *[_INTEGERS] * 3, _OUT_INTEGERS))
def _look_up(seen: IntArray, weight: IntArray, keys: IntArray, places: IntArray, place: IntArray) -> None:
    """`place` (N,) <- that of the key which each row of `seen` (N, 9) makes, where all cells with a weight are known."""
    for n in range(len(seen)):
        wanted, known = 0, True
        for cell in range(9):
            wanted += weight[cell] * seen[n, cell]
            known &= weight[cell] == 0 or seen[n, cell] >= 0
        if known:
            k = np.searchsorted(keys, wanted)
            if k < len(keys) and keys[k] == wanted:
                place[n] = places[k]


@inlined
def _moved(place: int, cell: int, turn: int, rows: int, columns: int) -> int:
    """Place of the block in that `cell` of the window of the block at `place`, or -1 outside."""
    if place < 0:
        return NONE
    rotation, row, column = place % 4, place // (4 * columns), place // 4 % columns
    down, right = cell // 3 - 1, cell % 3 - 1
    row += down * COSINE[rotation] + right * SINE[rotation]
    column += right * COSINE[rotation] - down * SINE[rotation]
    return (row * columns + column) * 4 + (rotation - turn) % 4 if 0 <= row < rows and 0 <= column < columns else NONE


@lru_cache(maxsize=4)
def code_of(pattern: ColorGrid) -> Code:
    """The tables of a pattern, made once."""
    return Code(pattern)


def rotated(offset: IntArray, quarter_turns: IntArray) -> IntArray:
    """(row, column) offsets, turned so that right becomes down at one quarter turn."""
    cosine, sine = COSINE[quarter_turns], SINE[quarter_turns]
    row, column = offset[..., 0], offset[..., 1]
    return np.stack([row * cosine + column * sine, column * cosine - row * sine], axis=-1)


def place_blocks(code: Code, links: Links, label: IntArray) -> IntArray:
    """Place (N,) of each block or -1: by votes of the windows that hold it, then from agreeing neighbours."""
    members = links.around
    seen = np.where(members >= 0, label[members], NONE)
    exact = code.find(seen)
    voters, votes = [exact], [EXACT_VOTE] + [CORRECTED_VOTE] * 9
    open_rows = np.flatnonzero((exact < 0) & ((seen >= 0).sum(axis=1) >= 8))
    for cell in range(9) if len(open_rows) else ():
        corrected = np.full(len(seen), NONE)
        corrected[open_rows] = code.find(seen[open_rows], without=cell)
        voters.append(corrected)
    nowhere = np.full(len(seen), NONE)
    place = _elected(code, links, label, nowhere, np.stack(voters), np.array(votes), lead=2.0, by_color=False)
    for _ in range(4):
        place = _undisputed(code, links, label, place)
        said = place[None]
        grown = _elected(code, links, label, place, said, np.ones(1, np.int64), lead=1.0, by_color=True)
        if np.array_equal(grown, place):
            break
        place = grown
    return _undisputed(code, links, label, place)


def neighbours_colors(
    code: Code, links: Links, label: IntArray, clear: BoolArray, place: IntArray
) -> tuple[IntArray, IntArray]:
    """How many of the eight neighbours of each block (N,) stand where it says and have the colour that the code has
    there; and how many are `clear`ly of another colour, wherever they stand."""
    agreeing, contradicting = np.zeros(len(place), np.int64), np.zeros(len(place), np.int64)
    _count_colors(*_grid(code, links), label, clear, place, agreeing, contradicting)
    return agreeing, contradicting


@compiled(numba.void(*[_WINDOWS] * 3, _INTEGERS, _FLAGS, _INTEGERS, _OUT_INTEGERS, _OUT_INTEGERS))
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
            there, expected = around[n, cell], _moved(place[n], cell, turn[n, cell], rows, columns)
            if cell == 4 or there < 0 or expected < 0:
                continue
            if label[there] != cells[expected // (4 * columns), expected // 4 % columns]:
                contradicting[n] += clear[there]
            elif place[there] == expected:
                agreeing[n] += 1


def surface_evidence(code: Code, links: Links, label: IntArray, place: IntArray) -> FloatArray:
    """By how many nats the surface of each block (N,), held by agreeing links, matches the code beyond chance."""
    agree = np.zeros(links.around.shape, dtype=np.bool_)
    _agree(*_grid(code, links), place, agree)
    row, cell = np.nonzero(agree)
    return _evidence(code, row, links.around[row, cell], place >= 0, code.color(place) == label)


def patch_evidence(code: Code, joints: Joints, held: BoolArray, right: BoolArray) -> FloatArray:
    """The same (rows, columns), of places that are `held` and of the `right` colour, linked by joints."""
    index = np.arange(held.size).reshape(held.shape)
    start = np.concatenate([index[:, :-1][joints.right], index[:-1][joints.down]])
    end = np.concatenate([index[:, 1:][joints.right], index[1:][joints.down]])
    return _evidence(code, start, end, held.ravel(), (held & right).ravel()).reshape(held.shape)


def _evidence(code: Code, start: IntArray, end: IntArray, placed: BoolArray, right: BoolArray) -> FloatArray:
    """m of n colours right has probability C(n, m) q^m, q of one colour by chance; and a surface could have been laid
    over any place of the code, starting from any of its blocks."""
    from scipy.special import gammaln

    count = len(placed)
    surface = np.arange(count)
    _join(np.ascontiguousarray(start, dtype=np.int64), np.ascontiguousarray(end, dtype=np.int64), surface)
    n, m = np.bincount(surface, placed), np.bincount(surface, placed & right)
    some = np.flatnonzero(n)
    n, m, nats = n[some], m[some], np.full(count, -np.inf)
    log_chance = gammaln(n + 1) - gammaln(m + 1) - gammaln(n - m + 1) - m * np.log(max(code.base - 1, 2))
    log_trials = np.log(len(code.windows)) + np.log(max(int(placed.sum()), 1))
    nats[some] = -(log_chance + log_trials)
    return np.where(placed, nats[surface], -np.inf)


@compiled(numba.void(_INTEGERS, _INTEGERS, numba.types.Array(numba.int64, 1, "C")))
def _join(start: IntArray, end: IntArray, surface: IntArray) -> None:
    """`surface` (N,), 0 .. N - 1 at first <- one number for all that are linked."""
    for k in range(len(start)):
        a, b = start[k], end[k]
        while surface[a] != a:
            surface[a] = a = surface[surface[a]]
        while surface[b] != b:
            surface[b] = b = surface[surface[b]]
        surface[max(a, b)] = min(a, b)
    for k in range(len(surface)):
        surface[k] = surface[surface[k]]


def joined_places(links: Links, place: IntArray, holder: IntArray) -> Joints:
    """Which places of the code, held by blocks, are linked to the next one of their row and of their column."""
    right, down = np.full_like(holder, NONE), np.full_like(holder, NONE)
    held = holder >= 0
    blob = holder[held]
    right[held] = links.neighbour[blob, (0 - place[blob]) % 4]
    down[held] = links.neighbour[blob, (1 - place[blob]) % 4]
    return Joints((right[:, :-1] >= 0) & (right[:, :-1] == holder[:, 1:]), (down[:-1] >= 0) & (down[:-1] == holder[1:]))


def _grid(code: Code, links: Links) -> tuple[IntArray, IntArray, IntArray]:
    return code.cells, links.around, links.around_turn


@compiled(numba.void(*[_WINDOWS] * 3, _INTEGERS, numba.types.Array(numba.boolean, 2, "C")))
def _agree(cells: IntArray, around: IntArray, turn: IntArray, place: IntArray, agree: BoolArray) -> None:
    """`agree` (N, 9) <- which members of each window stand where the block in its middle says."""
    rows, columns = cells.shape
    for n in range(len(place)):
        for cell in range(9):
            there = around[n, cell]
            if cell != 4 and place[n] >= 0 and there >= 0 and place[there] >= 0:
                agree[n, cell] = place[there] == _moved(place[n], cell, turn[n, cell], rows, columns)


def _undisputed(code: Code, links: Links, label: IntArray, place: IntArray) -> IntArray:
    """A place stands against a minority of the neighbours; of a colour that is not the code's, against half as many."""
    kept = np.full_like(place, NONE)
    _keep(*_grid(code, links), label, place, kept)
    return kept


@compiled(numba.void(*[_WINDOWS] * 3, *[_INTEGERS] * 2, _OUT_INTEGERS))
def _keep(
    cells: IntArray, around: IntArray, turn: IntArray, label: IntArray, place: IntArray, kept: IntArray
) -> None:
    rows, columns = cells.shape
    for n in range(len(place)):
        if place[n] < 0:
            continue
        agree, against = 0, 0
        for cell in range(9):
            there = around[n, cell]
            if cell != 4 and there >= 0 and place[there] >= 0:
                if place[there] == _moved(place[n], cell, turn[n, cell], rows, columns):
                    agree += 1
                else:
                    against += 1
        right = label[n] == cells[place[n] // (4 * columns), place[n] // 4 % columns]
        if agree > (1 if right else 2) * against:
            kept[n] = place[n]


def _elected(
    code: Code,
    links: Links,
    label: IntArray,
    place: IntArray,
    said: IntArray,
    votes: IntArray,
    lead: float,
    by_color: bool,
) -> IntArray:
    """`place` (N,), and of blocks without one the place that most windows give them.

    Window n says, `said` (V, N), where its middle stands; all its members are given `votes` (V,) for their places. A
    place needs two votes, and `lead` >= 1 times as many as all others together. `by_color`: one with the block's own
    colour.
    """
    elected = place.copy()
    _elect(*_grid(code, links), label, place, said, votes, lead, by_color, elected)
    return elected


@compiled(
    numba.void(*[_WINDOWS] * 3, *[_INTEGERS] * 2, _WINDOWS, _INTEGERS, numba.float64, numba.boolean, _OUT_INTEGERS)
)
def _elect(
    cells: IntArray,
    around: IntArray,
    turn: IntArray,
    label: IntArray,
    place: IntArray,
    said: IntArray,
    votes: IntArray,
    lead: float,
    by_color: bool,
    elected: IntArray,
) -> None:
    """Boyer and Moore: whoever has more than half of all votes is left, when votes for others cancel them out."""
    rows, columns = cells.shape
    balance, won, cast = np.zeros_like(place), np.zeros_like(place), np.zeros_like(place)
    for counting in (False, True):
        for v in range(len(said)):
            for n in range(len(place)):
                if said[v, n] < 0:
                    continue
                for cell in range(9):
                    there = around[n, cell]
                    if there < 0 or place[there] >= 0:
                        continue
                    where = _moved(said[v, n], cell, turn[n, cell], rows, columns)
                    if where < 0 or (by_color and cells[where // (4 * columns), where // 4 % columns] != label[there]):
                        continue
                    if counting:
                        cast[there] += votes[v]
                        won[there] += votes[v] if where == elected[there] else 0
                    elif where == elected[there]:
                        balance[there] += votes[v]
                    else:
                        balance[there] -= votes[v]
                        if balance[there] < 0:
                            elected[there], balance[there] = where, -balance[there]
    for n in range(len(place)):
        if place[n] < 0 and not (won[n] >= 2 and won[n] > lead * (cast[n] - won[n])):
            elected[n] = NONE
