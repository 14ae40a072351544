"""The code of a grid, and where in it each blob stands: every 3x3 window looked up, all of them voting."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from retrue.decoding.blocks.links import NONE, Links
from retrue.errors import InputError
from retrue.geometry.arrays import IntArray
from retrue.kernels import places as kernel
from retrue.patterns.color_grid import ColorGrid

WINDOW = 9  # blocks, three rows of three
EXACT_VOTE, CORRECTED_VOTE = 3, 1
ROUNDS = 4  # of growing from agreeing neighbours


class Code:
    """The code of a grid, and its windows in all four rotations, to look up.

    A place is one number, (row * columns + column) * 4 + rotation: where a block stands, and by how many
    quarter turns its own frame is rotated against the code's.
    """

    def __init__(self, pattern: ColorGrid) -> None:
        self.colors = np.asarray(pattern.code, dtype=np.int64)
        self.base = len(pattern.colors)
        self.rows, self.columns = self.colors.shape
        if min(self.rows, self.columns) < 3:
            raise InputError(f"color grid: expected 3 x 3 blocks or more, found {self.rows} x {self.columns}")
        self.windows = 4 * (self.rows - 2) * (self.columns - 2)
        row, column = np.mgrid[1 : self.rows - 1, 1 : self.columns - 1]
        places = self.place(row, column, 0).ravel()
        members = np.lib.stride_tricks.sliding_window_view(self.colors, (3, 3))
        # A frame turned by a quarter has the code's right side below: its rows are the code's columns.
        turned = [np.rot90(members, rotation, (2, 3)).reshape(-1, WINDOW) for rotation in range(4)]
        colors = np.concatenate(turned)
        places = np.concatenate([places + rotation for rotation in range(4)])
        weight = self.base ** np.arange(WINDOW)
        keys = colors @ weight
        self.tables = [_table(keys, weight, places)]
        for left_out in range(WINDOW):
            others = np.where(np.arange(WINDOW) == left_out, 0, weight)
            self.tables.append(_table(keys - colors[:, left_out] * weight[left_out], others, places))

    @property
    def flat(self) -> tuple[IntArray, int, int]:
        """Colours (rows columns,) of all blocks, rows, columns."""
        return self.colors.ravel(), self.rows, self.columns

    def place(self, row: IntArray, column: IntArray, rotation: IntArray | int) -> IntArray:
        return (row * self.columns + column) * 4 + rotation

    def split(self, place: IntArray) -> tuple[IntArray, IntArray, IntArray]:
        """Row, column and rotation of places."""
        return place // (4 * self.columns), place // 4 % self.columns, place % 4

    def color(self, place: IntArray) -> IntArray:
        """Colour index that the code has at each place; -1 for none."""
        return np.where(place >= 0, self.colors.ravel()[np.maximum(place, 0) // 4], NONE)

    def find(self, around: IntArray, label: IntArray, left_out: int | None = None) -> IntArray:
        """Place of each window of blobs `around` (N, 9) of colours `label`, one member left out if asked; -1 where none
        or several fit."""
        weight, keys, places = self.tables[0 if left_out is None else 1 + left_out]
        place = np.empty(len(around), np.int64)
        kernel.look_up(around, label, weight, keys, places, place)
        return place


def _table(keys: IntArray, weight: IntArray, places: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Weights (9,) that made the `keys` of windows, those that only one window has, in order, and their places."""
    order = np.argsort(keys)
    keys = keys[order]
    step = np.concatenate([[True], keys[1:] != keys[:-1], [True]])
    alone = step[1:] & step[:-1]
    return weight, keys[alone], places[order[alone]]


@lru_cache(maxsize=4)
def code_of(pattern: ColorGrid) -> Code:
    """The tables of a pattern, made once."""
    return Code(pattern)


def place_blocks(code: Code, links: Links, label: IntArray) -> IntArray:
    """Place (N,) of each blob or -1: by votes of the windows that hold it, then from agreeing neighbours."""
    count = len(label)
    said, votes = np.full((1 + WINDOW, count), NONE), np.array([EXACT_VOTE] + [CORRECTED_VOTE] * WINDOW)
    said[0] = code.find(links.around, label)
    unread = np.flatnonzero((said[0] < 0) & ((links.around >= 0).sum(axis=1) >= WINDOW - 1))
    around = links.around[unread]
    for left_out in range(WINDOW) if len(unread) else ():
        said[1 + left_out, unread] = code.find(around, label, left_out)
    place = _elected(code, links, label, np.full(count, NONE), said, votes, lead=2.0, by_color=False)
    for _ in range(ROUNDS):
        place = _undisputed(code, links, label, place)
        grown = _elected(code, links, label, place, place[None], np.ones(1, np.int64), lead=1.0, by_color=True)
        if np.array_equal(grown, place):
            break
        place = grown
    return _undisputed(code, links, label, place)


def _undisputed(code: Code, links: Links, label: IntArray, place: IntArray) -> IntArray:
    """A place stands against a minority of the neighbours; of a colour that is not the code's, against half as many."""
    kept = np.empty_like(place)
    kernel.keep_undisputed(*code.flat, links.around, links.around_turn, label, place, kept)
    return kept


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
    """`place` (N,), and of blobs without one the place that most windows give them.

    Window n says, `said` (V, N), where its middle stands; all its members are given `votes` (V,) for their places. A
    place needs two votes, and `lead` >= 1 times as many as all others together. `by_color`: one with the block's own
    colour.
    """
    elected, room = place.copy(), np.zeros((3, len(place)), np.int64)
    kernel.elect(*code.flat, links.around, links.around_turn, label, place, said, votes, lead, by_color, room, elected)
    return elected
