"""Which line of the code each line is: the colours of its neighbours, against every other place in the sequence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.decoding.lines.crossings import NONE
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray

REACH = 3  # lines to either side that tell which one a line is
LEAD = 4.0  # nats over the second best place
LEAST = 5.0  # nats over chance: four lines whose colours are clear, or more


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """Of N crossings: `column` and `row` (N,) of the code, or -1; `lead` (N,) nats over the next best places."""

    column: IntArray
    row: IntArray
    lead: FloatArray


def place_crossings(
    neighbour: IntArray, column_nats: FloatArray, columns: IntArray, row_nats: FloatArray, rows: IntArray
) -> Places:
    """Places of crossings, by the nats (N, K) that the light of their lines speaks for each colour.

    `columns` and `rows` are the sequences; `neighbour` (N, 4) of each crossing to the right, down, to the left and up
    as the code has them.
    """
    window = windows(neighbour)
    column, column_lead = _best(_evidence(window, column_nats, columns))
    row, row_lead = _best(_evidence(window.transpose(0, 2, 1), row_nats, rows))
    lead = np.minimum(column_lead, row_lead)
    sure = lead > LEAD
    column, row = (np.where(sure, place, NONE) for place in (column, row))
    for _ in range(2):
        keep = _agreeing(neighbour, column, row)
        column, row = (np.where(keep, place, NONE) for place in (column, row))
    return Places(column, row, lead)


def place_columns(neighbour: IntArray, nats: FloatArray, columns: IntArray, row: IntArray) -> Places:
    """The same of columns that no line crosses, seen in those rows (N,) of the picture."""
    column, lead = _best(_evidence(windows(neighbour), nats, columns))
    column = np.where(lead > LEAD, column, NONE)
    for _ in range(2):
        column = np.where(_agreeing(neighbour, column, row), column, NONE)
    return Places(column, np.where(column >= 0, row, NONE), lead)


def windows(neighbour: IntArray) -> IntArray:
    """(N, 2 REACH + 1, 2 REACH + 1) the crossings about each, [down, right], or -1."""
    count = len(neighbour)
    padded = np.concatenate([neighbour, np.full((1, 4), NONE)])  # index -1 leads to -1
    side = 2 * REACH + 1
    window = np.full((count, side, side), NONE)
    window[:, REACH, REACH] = np.arange(count)
    for direction, sign in ((0, 1), (2, -1)):
        for k in range(1, REACH + 1):
            before, here = REACH + sign * (k - 1), REACH + sign * k
            window[:, REACH, here] = padded[window[:, REACH, before], direction]
    for direction, sign in ((1, 1), (3, -1)):
        for k in range(1, REACH + 1):
            before, here = REACH + sign * (k - 1), REACH + sign * k
            window[:, here] = padded[window[:, before], direction]
            for side_direction, step in ((0, 1), (2, -1)):  # around a gap
                for j in range(1, REACH + 1):
                    beside = padded[window[:, here, REACH + step * (j - 1)], side_direction]
                    at = window[:, here, REACH + step * j]
                    window[:, here, REACH + step * j] = np.where(at < 0, beside, at)
    return window


def _evidence(window: IntArray, nats: FloatArray, sequence: IntArray) -> FloatArray:
    """Nats (N, len(sequence)) for each place of the middle line, from all lines of a window (N, down, right).

    The crossings of one line in one window see the same line: it counts once, by their mean.
    """
    count, length = len(window), len(sequence)
    seen = np.concatenate([nats, np.zeros((1, nats.shape[1]))])[window]
    there = (window >= 0).sum(axis=1)
    of_line = seen.sum(axis=1) / np.maximum(there, 1)[..., None]
    evidence = np.zeros((count, length))
    for k in range(2 * REACH + 1):
        place = np.arange(length) + k - REACH
        inside = (place >= 0) & (place < length)
        evidence[:, inside] += of_line[:, k, sequence[place[inside]]]
        evidence[:, ~inside] -= np.where(there[:, k] > 0, 1.0, 0.0)[:, None]
    return evidence


def _best(evidence: FloatArray) -> tuple[IntArray, FloatArray]:
    """The best place (N,), and its lead over the second best; none where it is hardly better than chance."""
    if evidence.shape[1] < 2:
        return np.zeros(len(evidence), np.int64), np.full(len(evidence), -np.inf)
    second, best = np.partition(evidence, -2, axis=1)[:, -2:].T
    return evidence.argmax(axis=1), np.where(best > LEAST, best - second, -np.inf)


def _agreeing(neighbour: IntArray, column: IntArray, row: IntArray) -> BoolArray:
    """(N,) crossings with two or more neighbours where the code has them, and more than elsewhere."""
    right, wrong = np.zeros(len(column), np.int64), np.zeros(len(column), np.int64)
    for k, (across, down) in enumerate(((1, 0), (0, 1), (-1, 0), (0, -1))):
        other = neighbour[:, k]
        placed = (other >= 0) & (column[other] >= 0)
        fits = placed & (column[other] == column + across) & (row[other] == row + down)
        right += fits
        wrong += placed & ~fits
    return np.asarray((column >= 0) & (right >= 2) & (right > wrong))
