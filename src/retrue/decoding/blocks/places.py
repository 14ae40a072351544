"""Where in the code each block stands: every 3x3 window looked up, all windows voting, links that must agree."""

from __future__ import annotations

import numpy as np

from retrue.decoding.blocks.links import NONE, Links
from retrue.decoding.blocks.windows import INTEGERS, OUT_INTEGERS, WINDOWS, Code, moved
from retrue.geometry.arrays import IntArray
from retrue.geometry.compiling import compiled, numba

EXACT_VOTE, CORRECTED_VOTE = 3, 1


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


def _undisputed(code: Code, links: Links, label: IntArray, place: IntArray) -> IntArray:
    """A place stands against a minority of the neighbours; of a colour that is not the code's, against half as many."""
    kept = np.full_like(place, NONE)
    _keep(code.cells, links.around, links.around_turn, label, place, kept)
    return kept


@compiled(numba.void(*[WINDOWS] * 3, *[INTEGERS] * 2, OUT_INTEGERS))
def _keep(cells: IntArray, around: IntArray, turn: IntArray, label: IntArray, place: IntArray, kept: IntArray) -> None:
    rows, columns = cells.shape
    for n in range(len(place)):
        if place[n] < 0:
            continue
        agree, against = 0, 0
        for cell in range(9):
            there = around[n, cell]
            if cell != 4 and there >= 0 and place[there] >= 0:
                if place[there] == moved(place[n], cell, turn[n, cell], rows, columns):
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
    _elect(code.cells, links.around, links.around_turn, label, place, said, votes, lead, by_color, elected)
    return elected


@compiled(numba.void(*[WINDOWS] * 3, *[INTEGERS] * 2, WINDOWS, INTEGERS, numba.float64, numba.boolean, OUT_INTEGERS))
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
                    where = moved(said[v, n], cell, turn[n, cell], rows, columns)
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
