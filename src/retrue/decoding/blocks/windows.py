"""The code of a grid, and where in it a 3x3 window of colours stands."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from retrue.decoding.blocks.links import NONE
from retrue.errors import InputError
from retrue.geometry.arrays import IntArray
from retrue.geometry.compiling import called, compiled, numba
from retrue.patterns.color_grid import ColorGrid

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


INTEGERS = numba.types.Array(numba.int64, 1, "C", readonly=True)
WINDOWS = numba.types.Array(numba.int64, 2, "C", readonly=True)
OUT_INTEGERS = numba.types.Array(numba.int64, 1, "C")


@compiled(numba.void(WINDOWS, *[INTEGERS] * 3, OUT_INTEGERS))
def _look_up(seen: IntArray, weight: IntArray, keys: IntArray, places: IntArray, place: IntArray) -> None:
    """`place` (N,) <- that of the key that each row of `seen` (N, 9) makes, if all cells with a weight are known."""
    for n in range(len(seen)):
        wanted, known = 0, True
        for cell in range(9):
            wanted += weight[cell] * seen[n, cell]
            known &= weight[cell] == 0 or seen[n, cell] >= 0
        if known:
            first, end = 0, len(keys)
            while first < end:
                middle = (first + end) // 2
                if keys[middle] < wanted:
                    first = middle + 1
                else:
                    end = middle
            if first < len(keys) and keys[first] == wanted:
                place[n] = places[first]


@called
def moved(place: int, cell: int, turn: int, rows: int, columns: int) -> int:
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
