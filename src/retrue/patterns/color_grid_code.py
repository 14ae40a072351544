"""Codes for a colour grid: arrays in which 3x3 windows differ in many cells, however they are turned."""

from __future__ import annotations

from functools import lru_cache
from math import comb

import numpy as np

from retrue.errors import InputError
from retrue.geometry.arrays import IntArray

CELLS = 9
TURNED = (6, 3, 0, 7, 4, 1, 8, 5, 2)  # where each cell of a window comes from when it is turned by a quarter
HOPELESS = 2.0  # expected clashes of a random window with all others: above, no search is started
PATIENCE = 5_000  # dead ends of the search before a smaller distance is tried


@lru_cache(maxsize=16)  # it takes as long as decoding a picture
def make_code(rows: int, columns: int, colors: int, seed: int, lonely: int | None = None) -> tuple[IntArray, int]:
    """Code (rows, columns) of colour indices, and the least distance of its windows: the largest that can be had.

    `lonely` is the colour that never touches itself, not even at a corner.
    """
    windows = 4 * (rows - 2) * (columns - 2)
    for distance in range(CELLS, 0, -1):
        ball = sum(comb(CELLS, k) * (colors - 1) ** k for k in range(distance))
        if windows * ball < HOPELESS * colors**CELLS:
            code = _Search(rows, columns, colors, distance, lonely, seed).run()
            if code is not None:
                code.flags.writeable = False
                return code, distance
    raise InputError(
        f"color grid: expected {rows} x {columns} blocks to have unique windows, "
        f"but {colors} colours do not give as many"
    )


class _Search:
    """Cell by cell, row by row, the least used colours first; back by a cell where none is left."""

    def __init__(self, rows: int, columns: int, colors: int, distance: int, lonely: int | None, seed: int) -> None:
        self.rows, self.columns, self.colors, self.distance, self.lonely = rows, columns, colors, distance, lonely
        self.random = np.random.default_rng(seed)
        self.code = np.full((rows, columns), -1, dtype=np.int64)
        self.used = np.zeros(colors)
        # Column 4 k + r: the k-th window, turned by r quarters; in the smallest numbers, which compare quickest.
        self.windows = np.zeros((CELLS, 4 * (rows - 2) * (columns - 2)), np.min_scalar_type(colors))
        turned = [np.arange(CELLS)]
        for _ in range(3):
            turned.append(turned[-1][list(TURNED)])
        self.turned = np.stack(turned, axis=1)

    def run(self) -> IntArray | None:
        cells = self.rows * self.columns
        choices: list[list[int]] = []
        placed = dead_ends = 0
        while placed < cells:
            if len(choices) == placed:
                choices.append(self._candidates(*divmod(placed, self.columns)))
            if self._place(*divmod(placed, self.columns), choices[-1]):
                placed += 1
                continue
            dead_ends += 1
            choices.pop()
            if not placed or dead_ends > PATIENCE:
                return None
            placed -= 1
            before = divmod(placed, self.columns)
            self.used[self.code[before]] -= 1
            self.code[before] = -1
        return self.code

    def _candidates(self, row: int, column: int) -> list[int]:
        """Colours that the neighbours allow, the best one last."""
        order = np.argsort(-(self.used + self.random.normal(0.0, 2.0, self.colors))).tolist()
        sides = {int(self.code[row - 1, column]) if row else -1, int(self.code[row, column - 1]) if column else -1}
        allowed = [k for k in order if k not in sides]
        touching = self.code[max(row - 1, 0) : row + 1, max(column - 1, 0) : column + 2]
        if self.lonely in allowed and (touching == self.lonely).any():
            allowed.remove(self.lonely)
        return allowed

    def _place(self, row: int, column: int, candidates: list[int]) -> bool:
        """Put the best candidate whose window, if it ends one, is far enough from all before and from itself turned."""
        own = 4 * ((row - 2) * (self.columns - 2) + column - 2) if row >= 2 and column >= 2 else None
        while candidates:
            self.code[row, column] = color = candidates.pop()
            if own is not None:
                window = self.code[row - 2 : row + 1, column - 2 : column + 1].ravel()
                turned = self.windows[:, own : own + 4]
                turned[:] = window[self.turned]
                others = (self.windows[:, : own + 4] != turned[:, :1]).sum(axis=0, dtype=np.uint8)
                others[own] = CELLS  # itself, unturned
                if others.min() < self.distance:
                    continue
            self.used[color] += 1
            return True
        self.code[row, column] = -1
        return False
