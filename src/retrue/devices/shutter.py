"""When a camera exposes which rows.

Row y (0 the first, 1 the last) of frame n is exposed from

    start + n * period + readout * y

on, for `exposure` seconds, on the clock of the projector. A row of a frame in which a picture comes on at time c holds
the share

    share = clip((start + n * period + readout * y + exposure - c) / exposure, 0, 1)

of the new picture's light, and what is left of the old one's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from retrue.geometry.arrays import FloatArray

MARGIN = 0.03  # of a period, that a row's exposure must be clear of a change
TOUCHED = 0.02  # share of a row's light from which a picture counts as in it


@dataclass(frozen=True, slots=True)
class Shutter:
    """When each row is exposed; times in seconds.

    Attributes
    ----------
    start : when the first row of frame 0 begins to be exposed. `period` : from frame to frame.
    readout : from the first row to the last; negative where it runs upwards.
    exposure : of each row.
    gamma : picture = light ^ (1 / gamma).
    lags : from the begin of some frames to their arrival.
    """

    start: float
    period: float
    readout: float
    exposure: float
    gamma: float = 1.0
    lags: tuple[float, ...] = (0.0,)

    @property
    def lag(self) -> tuple[float, float]:
        """The least and the most."""
        return min(self.lags), max(self.lags)

    def begins(self, number: int, rows: FloatArray) -> FloatArray:
        """When those rows (0 to 1) of that frame begin to be exposed.

        >>> Shutter(1.0, 0.1, 0.05, 0.02).begins(2, np.array([0, 0.5, 1])).round(3).tolist()
        [1.2, 1.225, 1.25]
        """
        return self.start + number * self.period + self.readout * rows

    def shares(self, number: int, rows: FloatArray, changes: FloatArray) -> FloatArray:
        """(rows, pictures) share of each row's light that is of each picture, which come on at those times.

        >>> Shutter(1.0, 0.1, 0.05, 0.02).shares(0, np.array([0, 1]), np.array([-np.inf, 1.015])).round(3).tolist()
        [[0.75, 0.25], [0.0, 1.0]]
        """
        begin = self.begins(number, rows)[:, None]
        ends = np.append(changes[1:], np.inf)
        return np.clip(np.minimum(ends, begin + self.exposure) - np.maximum(changes, begin), 0, None) / self.exposure

    def whole(self, number: int, edges: FloatArray, on: float, off: float) -> NDArray[np.bool_]:
        """(BANDS,) whether all rows of each band hold nothing but what was shown from `on` to `off`."""
        begin, margin = self.begins(number, edges), MARGIN * self.period
        return np.asarray(((begin >= on + margin) & (begin + self.exposure <= off - margin)).all(axis=1))

    def seen_by(self, on: float, edges: FloatArray, whole: NDArray[np.bool_], sights: NDArray[np.intp]) -> float:
        """When those bands have been exposed as a whole to what came on then, and so many frames hold some of it.

        >>> edges, alone = np.array([[0, 0.2]]), np.array([True])
        >>> shutter = Shutter(1.0, 0.1, 0.05, 0.02)
        >>> [round(shutter.seen_by(1.1 - 0.01, edges, alone, np.array([count])), 4) for count in (0, 1, 2)]
        [1.133, 1.133, 1.2058]
        """
        margin, touched = MARGIN * self.period, 2 * TOUCHED * self.exposure
        offset, middle = np.sort(self.readout * edges, axis=1), self.readout * edges.mean(axis=1)
        number = np.ceil((on + margin - self.start - offset[:, 0]) / self.period - 1e-9)
        done = self.start + number * self.period + offset[:, 1] + self.exposure + margin
        first = np.floor((on + touched - self.exposure - self.start - middle) / self.period) + 1
        last = np.maximum(self.start + (first + sights - 1) * self.period + middle, on) + touched
        return float(np.max([np.where(whole, done, on), np.where(sights > 0, last, on)]))
