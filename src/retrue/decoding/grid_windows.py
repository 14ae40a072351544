"""Where in the code each block stands: every 3x3 window looked up, all windows voting, links that must agree."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from retrue.decoding.grid_links import NONE, Links
from retrue.decoding.grid_surface import Joints
from retrue.errors import InputError
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.compiling import compiled, numba
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

    def moved(self, place: IntArray, offset: IntArray, turn: IntArray) -> IntArray:
        """Place of the block at `offset` (row, column) in the frame of the block at `place`, or -1 outside."""
        place, down, right, turn = np.broadcast_arrays(place, offset[..., 0], offset[..., 1], turn)
        result = np.empty(place.shape, dtype=np.int64)
        _moved(*(np.ravel(a) for a in (place, down, right, turn)), self.rows, self.columns, result.reshape(-1))
        return result

    def color(self, place: IntArray) -> IntArray:
        """Colour index that the code has at each place; -1 for none."""
        row, column, _ = self.split(np.maximum(place, 0))
        return np.where(place >= 0, self.cells[row, column], NONE)

    def find(self, seen: IntArray, without: int | None = None) -> IntArray:
        """Place of each window (N, 9) of colour indices, one cell left out if asked; -1 where none or several fit."""
        weight, keys, places = self.tables[without]
        if len(keys) == 0:
            return np.full(len(seen), NONE)
        wanted = seen @ weight
        first = np.searchsorted(keys, wanted)
        found = keys[np.minimum(first, len(keys) - 1)] == wanted
        return np.where(found & (seen[:, weight > 0] >= 0).all(axis=1), places[np.minimum(first, len(keys) - 1)], NONE)

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


@compiled(numba.void(*[_INTEGERS] * 4, numba.int64, numba.int64, numba.types.Array(numba.int64, 1, "C")))
def _moved(
    place: IntArray, down: IntArray, right: IntArray, turn: IntArray, rows: int, columns: int, result: IntArray
) -> None:
    for i in range(len(place)):
        rotation, cell = place[i] % 4, place[i] // 4
        row = cell // columns + down[i] * COSINE[rotation] + right[i] * SINE[rotation]
        column = cell % columns + right[i] * COSINE[rotation] - down[i] * SINE[rotation]
        inside = place[i] >= 0 and 0 <= row < rows and 0 <= column < columns
        result[i] = (row * columns + column) * 4 + (rotation - turn[i]) % 4 if inside else NONE


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
    voters = [(exact, EXACT_VOTE)]
    open_rows = np.flatnonzero((exact < 0) & ((seen >= 0).sum(axis=1) >= 8))
    for cell in range(9) if len(open_rows) else ():
        corrected = np.full(len(seen), NONE)
        corrected[open_rows] = code.find(seen[open_rows], without=cell)
        voters.append((corrected, CORRECTED_VOTE))
    place = _vote(code, links, voters)
    for _ in range(4):
        place = _drop_disputed(code, links, label, place)
        grown = _grow(code, links, label, place)
        if np.array_equal(grown, place):
            break
        place = grown
    return _drop_disputed(code, links, label, place)


def agreeing_links(code: Code, links: Links, place: IntArray) -> tuple[BoolArray, BoolArray]:
    """(N, 9) which members of each window stand where the centre says, and which stand elsewhere."""
    expected = code.moved(place[:, None], OFFSETS, links.around_turn)
    there = np.where(links.around >= 0, place[links.around], NONE)
    known = (place[:, None] >= 0) & (there >= 0)
    known[:, 4] = False
    return known & (expected == there), known & (expected != there)


def neighbours_colors(
    code: Code, links: Links, label: IntArray, clear: BoolArray, place: IntArray
) -> tuple[IntArray, IntArray]:
    """How many of the eight neighbours of each block (N,) stand where it says and have the colour that the code has
    there; and how many are `clear`ly of another colour, wherever they stand."""
    expected = code.moved(place[:, None], OFFSETS, links.around_turn)
    there = links.around >= 0
    seen = np.where(there, label[links.around], NONE)
    right = there & (expected >= 0) & (seen == code.color(expected))
    agree, _ = agreeing_links(code, links, place)
    wrong = there & (expected >= 0) & ~right & clear[links.around]
    wrong[:, 4] = False
    return (agree & right).sum(axis=1), wrong.sum(axis=1)


def surface_evidence(code: Code, links: Links, label: IntArray, place: IntArray) -> FloatArray:
    """By how many nats the surface of each block (N,), held by agreeing links, matches the code beyond chance."""
    agree, _ = agreeing_links(code, links, place)
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
    log_chance = gammaln(n + 1) - gammaln(m + 1) - gammaln(n - m + 1) - m * np.log(max(code.base - 1, 2))
    log_trials = np.log(len(code.windows)) + np.log(max(int(placed.sum()), 1))
    return np.where(placed, -(log_chance + log_trials)[surface], -np.inf)


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


def _vote(code: Code, links: Links, voters: list[tuple[IntArray, int]]) -> IntArray:
    blocks: list[IntArray] = []
    places: list[IntArray] = []
    weights: list[NDArray[np.int64]] = []
    for centre, weight in voters:
        decoded = np.flatnonzero(centre >= 0)
        target = links.around[decoded]
        place = code.moved(centre[decoded][:, None], OFFSETS, links.around_turn[decoded])
        use = (target >= 0) & (place >= 0)
        blocks.append(target[use])
        places.append(place[use])
        weights.append(np.full(int(use.sum()), weight))
    block, place, weight = np.concatenate(blocks), np.concatenate(places), np.concatenate(weights)
    return _majority(len(links.around), block, place, weight, lead=2.0)


def _majority(count: int, block: IntArray, place: IntArray, weight: NDArray[np.int64], lead: float) -> IntArray:
    """Place with the most votes of each block, where it has two, and `lead` times as many as all others together."""
    result = np.full(count, NONE)
    if len(block) == 0:
        return result
    span = int(place.max()) + 1
    ballot, inverse = np.unique(block * span + place, return_inverse=True)
    votes = np.bincount(inverse, weight)
    owner = ballot // span
    cast = np.bincount(owner, votes, count)
    wins = (votes >= 2) & (votes > lead * (cast[owner] - votes))
    result[owner[wins]] = ballot[wins] % span
    return result


def _drop_disputed(code: Code, links: Links, label: IntArray, place: IntArray) -> IntArray:
    """A place stands against a minority of the neighbours; of a colour that is not the code's, against half as many."""
    agree, against = agreeing_links(code, links, place)
    right = code.color(place) == label
    keep = agree.sum(axis=1) > np.where(right, 1, 2) * against.sum(axis=1)
    return np.where(keep, place, NONE)


def _grow(code: Code, links: Links, label: IntArray, place: IntArray) -> IntArray:
    """Places of blocks without one, as two or more neighbours say and their own colour confirms."""
    target = links.around
    said = code.moved(place[:, None], OFFSETS, links.around_turn)
    use = (target >= 0) & (said >= 0)
    use &= np.where(use, place[target] < 0, False) & (code.color(said) == np.where(use, label[target], NONE))
    block, where = target[use], said[use]
    grown = _majority(len(place), block, where, np.ones(len(block), np.int64), lead=1.0)
    return np.where(place >= 0, place, grown)
