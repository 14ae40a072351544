"""Codes for a colour grid: arrays in which 3x3 windows differ in many cells, however they are turned."""

from __future__ import annotations

from itertools import combinations
from math import comb

import numpy as np

from retrue.errors import InputError
from retrue.geometry.arrays import IntArray

CELLS = 9
TURNED = (6, 3, 0, 7, 4, 1, 8, 5, 2)  # where each cell of a window comes from when it is turned by a quarter
HOPELESS = 2.0  # expected clashes of a random window with all others: above, no search is started
PATIENCE = 5_000  # dead ends of the search before a smaller distance is tried


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
                return code, distance
    raise InputError(
        f"color grid: expected {rows} x {columns} blocks to have unique windows, "
        f"but {colors} colours do not give as many"
    )


class _Search:
    """Cell by cell, row by row, the least used colours first; back by a cell where none is left.

    Two windows differ in `distance` cells or more exactly when they share no sub-window that leaves out
    `distance` - 1 cells. So each window leaves the keys of all its sub-windows, in all its
    rotations, in one set, and a new window may have none of them.
    """

    def __init__(self, rows: int, columns: int, colors: int, distance: int, lonely: int | None, seed: int) -> None:
        self.rows, self.columns, self.colors, self.distance, self.lonely = rows, columns, colors, distance, lonely
        self.random = np.random.default_rng(seed)
        self.code = np.full((rows, columns), -1, dtype=np.int64)
        self.used = np.zeros(colors)
        self.keys: set[int] = set()
        self.weights, self.bases = _sub_window_keys(colors, distance - 1)
        turned = [np.arange(CELLS)]
        for _ in range(3):
            turned.append(turned[-1][list(TURNED)])
        self.turned = np.stack(turned)

    def run(self) -> IntArray | None:
        cells = self.rows * self.columns
        choices: list[list[int]] = []
        placed: list[list[int]] = []  # the keys that each cell left
        dead_ends = 0
        while len(placed) < cells:
            row, column = divmod(len(placed), self.columns)
            if len(choices) == len(placed):
                choices.append(self._candidates(row, column))
            keys = self._place(row, column, choices[-1])
            if keys is not None:
                placed.append(keys)
                continue
            dead_ends += 1
            choices.pop()
            if not placed or dead_ends > PATIENCE:
                return None
            self._undo(*divmod(len(placed) - 1, self.columns), placed.pop())
        return self.code

    def _candidates(self, row: int, column: int) -> list[int]:
        """Colours that the neighbours allow, the best one last."""
        order = np.argsort(-(self.used + self.random.normal(0.0, 2.0, self.colors)))
        sides = {int(self.code[row - 1, column]) if row else -1, int(self.code[row, column - 1]) if column else -1}
        allowed = [int(k) for k in order if int(k) not in sides]
        touching = self.code[max(row - 1, 0) : row + 1, max(column - 1, 0) : column + 2]
        if self.lonely in allowed and (touching == self.lonely).any():
            allowed.remove(self.lonely)
        return allowed

    def _place(self, row: int, column: int, candidates: list[int]) -> list[int] | None:
        """Put the best candidate that clashes with nothing, and return the keys of the window that it ends."""
        while candidates:
            color = candidates.pop()
            self.code[row, column] = color
            keys: list[int] = []
            if row >= 2 and column >= 2:
                window = self.code[row - 2 : row + 1, column - 2 : column + 1].ravel()[self.turned]
                if np.min(np.sum(window[0] != window[1:], axis=1)) < self.distance:
                    continue
                own = (self.weights @ window[0] + self.bases).tolist()
                if not self.keys.isdisjoint(own):
                    continue
                keys = (self.weights @ window.T + self.bases[:, None]).ravel().tolist()
                self.keys.update(keys)
            self.used[color] += 1
            return keys
        self.code[row, column] = -1
        return None

    def _undo(self, row: int, column: int, keys: list[int]) -> None:
        self.keys.difference_update(keys)
        self.used[self.code[row, column]] -= 1
        self.code[row, column] = -1


def _sub_window_keys(colors: int, left_out: int) -> tuple[IntArray, IntArray]:
    """Weights (M, 9) and bases (M,): weights @ window + bases is one number for each of the M sub-windows."""
    choices = list(combinations(range(CELLS), left_out))
    weights = np.tile(colors ** np.arange(CELLS), (len(choices), 1))
    for row, choice in zip(weights, choices, strict=True):
        row[list(choice)] = 0
    return weights, np.arange(len(choices)) * colors**CELLS
