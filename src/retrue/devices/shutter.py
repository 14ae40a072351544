"""When a camera exposes which rows: told from frames in which black and white follow each other.

Row y (0 the first, 1 the last) of frame n is exposed from start + n * period + readout * y on, for `exposure` seconds, on
the clock of the projector. A row of a frame in which a picture comes on at time c holds the share

    share = clip((start + n * period + readout * y + exposure - c) / exposure, 0, 1)

of the new picture's light, and what is left of the old one's. Least squares over all bands of all such frames tell start,
period, readout, exposure and the camera's gamma; no driver need know any of them, and no clock of the camera is asked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares

from retrue.devices.references import BANDS, References
from retrue.geometry.arrays import FloatArray, Image

PROBES = 24  # pixels of each band by which frames are told apart
FEWEST_PROBES = 6
LIT = 0.4  # of the contrast of the best pixels: what is darker says little
SATURATED = 252
MARGIN = 0.03  # of a period, that a row's exposure must be clear of a change
GAMMAS = (1.0, 2.2)
STEPS = 24  # of a period, of each of the three times, where the search begins
WORST_FIT = 0.06  # of white over black, root mean square: a camera that exposes in another way


@dataclass(frozen=True, eq=False)
class Probes:
    """Pixels, in the middle row of each band, in which the projector's light is seen best.

    Attributes
    ----------
    index : (BANDS, PROBES) of flattened pixels.
    lit : (BANDS,) whether there are enough of them.
    black, white : (BANDS, PROBES, channels) what they look like.
    height : rows of the picture.
    """

    index: np.ndarray
    lit: np.ndarray
    black: FloatArray
    white: FloatArray
    height: int

    @cached_property
    def edges(self) -> FloatArray:
        """(BANDS, 2) first and last row of each band, as shares of the picture."""
        parts = np.array_split(np.arange(self.height), BANDS)
        return np.array([(part[0], part[-1]) for part in parts]) / max(self.height - 1, 1)

    @cached_property
    def middle(self) -> FloatArray:
        """(BANDS,) where the probes are, as a share of the picture's height."""
        return self.edges.mean(axis=1)

    def of(self, levels: Image) -> FloatArray:
        """(BANDS, PROBES, channels)."""
        return levels.reshape(-1, 1 if levels.ndim == 2 else levels.shape[2])[self.index].astype(np.float64)

    def light(self, seen: FloatArray, gamma: float) -> FloatArray:
        """(..., BANDS, PROBES) 0 in black, 1 in white, and linear in the light between them."""
        black, white = ((end / 255) ** gamma for end in (self.black, self.white))
        top, span = ((seen / 255) ** gamma - black).sum(axis=-1), (white - black).sum(axis=-1)
        return np.where(self.lit[:, None], top / np.where(self.lit[:, None], span, 1.0), 0.0)


def find_probes(references: References) -> Probes:
    """Those of a rig, from what its white and black look like."""
    white, black = (
        picture.reshape(*picture.shape[:2], -1).astype(np.float64) for picture in (references.white, references.black)
    )
    height, width = white.shape[:2]
    contrast = (white - black).sum(axis=2)
    contrast[white.max(axis=2) > SATURATED] = 0
    rows = [int(np.mean(part)) for part in np.array_split(np.arange(height), BANDS)]
    least = LIT * np.percentile(contrast[rows], 95)
    index, lit = np.zeros((BANDS, PROBES), np.intp), np.zeros(BANDS, bool)
    for band, row in enumerate(rows):
        good = np.flatnonzero(contrast[row] >= least) if least > 0 else np.zeros(0, np.intp)
        lit[band] = len(good) >= FEWEST_PROBES
        if lit[band]:
            index[band] = row * width + good[np.linspace(0, len(good) - 1, PROBES).round().astype(int)]
    ends = [picture.reshape(height * width, -1)[index] for picture in (black, white)]
    return Probes(index, lit, ends[0], ends[1], height)


@dataclass(frozen=True, slots=True)
class Shutter:
    """When each row is exposed; times in seconds.

    Attributes
    ----------
    start : when the first row of frame 0 begins to be exposed. `period` : from frame to frame.
    readout : from the first row to the last; negative where it runs upwards.
    exposure : of each row.
    gamma : picture = light ^ (1 / gamma).
    lag : (least, most) from the begin of a frame to its arrival. `spread` : by which that varies, in periods.
    """

    start: float
    period: float
    readout: float
    exposure: float
    gamma: float = 1.0
    lag: tuple[float, float] = (0.0, 0.0)
    spread: float = 0.1

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

    def whole(self, number: int, edges: FloatArray, on: float, off: float) -> np.ndarray:
        """(BANDS,) whether all rows of each band hold nothing but what was shown from `on` to `off`."""
        begin, margin = self.begins(number, edges), MARGIN * self.period
        return ((begin >= on + margin) & (begin + self.exposure <= off - margin)).all(axis=1)

    def seen_by(self, on: float, edges: FloatArray) -> float:
        """When every band has been exposed as a whole to what came on then."""
        margin = MARGIN * self.period
        offset = np.sort(self.readout * edges, axis=1)
        number = np.ceil((on + margin - self.start - offset[:, 0]) / self.period - 1e-9)
        return float((self.start + number * self.period + offset[:, 1]).max() + self.exposure + margin)


@dataclass(frozen=True, slots=True, eq=False)
class Change:
    """Black that follows white, or white black, as a camera saw it.

    Attributes
    ----------
    at : when it came on. `white` : whether it is white that did.
    arrivals : of the last frame before it shows, of those in which it shows, and of the first that shows nothing else.
    seen : (frames, BANDS, PROBES, channels) their probes.
    """

    at: float
    white: bool
    arrivals: Sequence[float]
    seen: FloatArray


def fit_shutter(changes: Sequence[Change], probes: Probes, period: float) -> Shutter | None:
    """The shutter that explains those changes best; None where none does."""
    best: tuple[float, FloatArray, list[np.ndarray]] | None = None
    lit = probes.lit
    if not changes or not lit.any():
        return None
    rows = probes.middle[lit]

    def observed(gamma: float) -> list[FloatArray]:
        """Share of the new picture, (frames, bands) of each change."""
        light = [probes.light(change.seen, gamma)[:, lit].mean(axis=-1) for change in changes]
        return [one if change.white else 1 - one for one, change in zip(light, changes, strict=True)]

    def steps(change: Change) -> list[np.ndarray]:
        """Ways to number the frames: none lost, or lost as their arrivals tell."""
        gaps = np.maximum(np.round(np.diff(change.arrivals) / period), 1).astype(int)
        by_time = np.concatenate([[0], np.cumsum(gaps)])
        none_lost = np.arange(len(change.arrivals))
        return [none_lost] if np.array_equal(by_time, none_lost) else [none_lost, by_time]

    def numbered(start: float, readout: float, exposure: float, seen: Sequence[FloatArray]) -> tuple[float, list]:
        """Misfit, with the numbers of frames that suit it best."""
        total, numbers = 0.0, list[np.ndarray]()
        for change, share in zip(changes, seen, strict=True):
            middle = np.floor((change.at - start) / period)
            options = [middle + first + way for way in steps(change) for first in range(-4, 2)]
            offered = np.array(options)
            begin = start + period * offered[..., None] + readout * rows
            model = np.clip((begin + exposure - change.at) / exposure, 0, 1)
            misfit = np.minimum(np.square(model - share), 0.25).mean(axis=(1, 2))
            total += float(misfit.min())
            numbers.append(offered[int(misfit.argmin())])
        return total, numbers

    grid = (np.arange(STEPS) + 0.5) / STEPS * period
    for gamma in GAMMAS:
        seen = observed(gamma)
        misfits = _misfits(changes, seen, steps, rows, period, grid)
        for start, readout, exposure in misfits:
            misfit, numbers = numbered(start, readout, exposure, seen)
            if best is None or misfit < best[0]:
                best = misfit, np.array([start, period, readout, exposure, gamma]), numbers
    assert best is not None
    guess, numbers = best[1], best[2]

    def residuals(values: FloatArray) -> FloatArray:
        start, length, readout, exposure, gamma = values
        parts = list[FloatArray]()
        for change, share, number in zip(changes, observed(gamma), numbers, strict=True):
            begin = start + length * number[:, None] + readout * rows
            parts.append((np.clip((begin + exposure - change.at) / exposure, 0, 1) - share).ravel())
        return np.concatenate(parts)

    scale = np.array([period, 1e-3 * period, period, period, 1.0])
    least = np.array([-np.inf, 0.98 * period, -1.2 * period, 1e-3 * period, 0.5])
    most = np.array([np.inf, 1.02 * period, 1.2 * period, 1.2 * period, 4.0])
    fitted = least_squares(
        residuals, np.clip(guess, least, most), bounds=(least, most), x_scale=scale, loss="soft_l1", f_scale=0.05
    )
    start, length, readout, exposure, gamma = (float(value) for value in fitted.x)
    apart = residuals(fitted.x)
    if not np.sqrt(np.mean(np.minimum(np.square(apart), 0.25))) <= WORST_FIT:
        return None
    lags = np.concatenate(
        [np.array(change.arrivals) - (start + length * number) for change, number in zip(changes, numbers, strict=True)]
    )
    mixed = np.concatenate([((share > 0.1) & (share < 0.9)).any(axis=1) for share in observed(gamma)])
    lags = lags[mixed] if mixed.any() else lags  # of the others the number is not sure
    spread = max(0.1, 1.5 * float(np.std(lags)) / length)
    return Shutter(start, length, readout, exposure, gamma, (float(lags.min()), float(lags.max())), spread)


def _misfits(
    changes: Sequence[Change], seen: Sequence[FloatArray], steps: object, rows: FloatArray, period: float, grid: FloatArray
) -> list[tuple[float, float, float]]:
    """The few best starts of a search: (start, readout, exposure)."""
    start = grid[:, None, None]
    readout = np.concatenate([-grid[1::3], [0.0], grid[1::3]])[None, :, None]
    exposure = grid[None, None, ::2]
    total = np.zeros(np.broadcast_shapes(start.shape, readout.shape, exposure.shape))
    few = np.unique(np.linspace(0, len(rows) - 1, 8).round().astype(int))
    for change, share in zip(changes, seen, strict=True):
        best = np.full(total.shape, np.inf)
        for way in steps(change):  # type: ignore[operator]
            for first in range(-4, 2):
                misfit = np.zeros(total.shape)
                number = np.floor((change.at - start) / period) + first
                for step, bands in zip(way, share, strict=True):
                    for band in few:
                        begin = start + period * (number + step) + readout * rows[band]
                        misfit += np.square(np.clip((begin + exposure - change.at) / exposure, 0, 1) - bands[band])
                best = np.minimum(best, misfit / (len(way) * len(few)))
        total += np.minimum(best, 0.25)
    order = np.argsort(total, axis=None)[:12]
    where = np.unravel_index(order, total.shape)
    return [
        (float(start[a, 0, 0]), float(readout[0, b, 0]), float(exposure[0, 0, c])) for a, b, c in zip(*where, strict=True)
    ]
