"""The shutter of a camera, told from frames in which black and white follow each other.

The share of the new picture in each band of each frame around a change is that of `shutter`; least squares over all of
them tell start, period, readout, exposure and gamma. No driver need know any of them, and no clock of the camera is
asked: the numbers of the frames are those that suit best.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, cast

import numpy as np
from scipy.optimize import least_squares  # pyright: ignore[reportUnknownVariableType]

from retrue.devices.probes import Probes
from retrue.devices.shutter import Shutter
from retrue.geometry.arrays import FloatArray

GAMMAS = (1.0, 2.2)
STEPS = 24  # of a period, of each of the three times, where the search begins
BEFORE = range(-4, 2)  # frames from that in which a change falls to the last one that does not show it
FEW_BANDS = 8  # in the search
OUTLIER = 0.25  # squared share: a band that is off by more counts no more
USUAL_READOUT, USUAL_EXPOSURE = 0.3, 0.5  # of a period; what holds where no frame tells
WEAK, TOLD = 0.1, 1.0  # weight of that, and of an exposure that the camera tells, against one band of one frame
RARE = 0.02  # squared share, at which a frame that was lost unseen costs: else it would explain what is not there
MOST_STEPS = 40
WORST_FIT = 0.06  # of white over black, root mean square: a camera that exposes in another way


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


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """A change as the fit needs it; times from the first change on.

    Attributes
    ----------
    share : (frames, bands) of the new picture.
    ways : in which its frames may be numbered, from 0. `rare` : where one was lost, and no arrival tells of it.
    """

    at: float
    arrivals: FloatArray
    share: FloatArray
    ways: list[FloatArray]
    rare: list[FloatArray]


@dataclass(frozen=True, slots=True, eq=False)
class _Usual:
    """(readout, exposure) where no frame tells them, and how much that counts."""

    times: FloatArray
    weights: FloatArray

    def off(self, readout: float, exposure: float) -> FloatArray:
        return self.weights * (np.array([readout, exposure]) - self.times)


def fit_shutter(
    changes: Sequence[Change], probes: Probes, period: float, exposure_ms: float | None = None
) -> Shutter | None:
    """The shutter that explains those changes best; None where none does.

    `period` is about right: off by less than a third of itself from the first change to the last. `exposure_ms`, as the
    camera tells it, holds where no change falls into an exposure.
    """
    if not changes or not probes.lit.any():
        return None
    rows = probes.middle[probes.lit]
    told = USUAL_EXPOSURE if exposure_ms is None else min(exposure_ms / 1000 / period, 1.0)
    usual = _Usual(np.array([USUAL_READOUT, told]) * period, np.array([WEAK, WEAK if exposure_ms is None else TOLD]))
    seen_at = lru_cache(maxsize=2)(partial(_seen, changes, probes, period))  # a slope asks four times with one gamma
    tried = [
        (*_numbered(seen, rows, period, times, usual), np.array([times[0], period, *times[1:], gamma]))
        for gamma in GAMMAS
        for seen in [seen_at(gamma)]
        for times in _beginnings(seen, rows, period, usual)
    ]
    _, numbers, guess = min(tried, key=lambda one: one[0])

    def residuals(values: FloatArray) -> FloatArray:
        start, length, readout, exposure, gamma = values
        parts = [
            (_share(start + length * number[:, None] + readout * rows, exposure, seen.at) - seen.share).ravel()
            for seen, number in zip(seen_at(float(gamma)), numbers, strict=True)
        ]
        unusual = usual.off(readout, exposure) / period
        return np.concatenate([*parts, unusual, [WEAK * np.log(gamma)]])

    least = np.array([-np.inf, 0.98 * period, -1.2 * period, 1e-3 * period, 0.5])
    most = np.array([np.inf, 1.02 * period, 1.2 * period, 1.2 * period, 4.0])
    scale = np.array([period, 1e-3 * period, period, period, 1.0])
    how: dict[str, Any] = {"x_scale": scale, "loss": "soft_l1", "f_scale": 0.05, "max_nfev": MOST_STEPS}
    found = cast("Any", least_squares(residuals, np.clip(guess, least, most), bounds=(least, most), **how))
    fitted = cast("FloatArray", found.x)
    if not np.sqrt(np.mean(np.minimum(np.square(residuals(fitted)[:-3]), OUTLIER))) <= WORST_FIT:
        return None
    start, length, readout, exposure, gamma = (float(value) for value in fitted)
    seen = seen_at(gamma)
    lags = np.concatenate([one.arrivals - (start + length * number) for one, number in zip(seen, numbers, strict=True)])
    mixed = np.concatenate([((one.share > 0.1) & (one.share < 0.9)).any(axis=1) for one in seen])
    lags = lags[mixed] if mixed.any() else lags  # of the others the number is not sure
    late: list[float] = lags.tolist()
    return Shutter(changes[0].at + start, length, readout, exposure, gamma, tuple(late))


def _seen(changes: Sequence[Change], probes: Probes, period: float, gamma: float) -> list[_Seen]:
    first, found = changes[0].at, list[_Seen]()
    for change in changes:
        light = probes.light(change.seen, gamma)[:, probes.lit].mean(axis=-1)
        arrivals = np.array(change.arrivals) - first
        none_lost = np.arange(len(arrivals), dtype=np.float64)
        by_time = np.concatenate([[0.0], np.cumsum(np.maximum(np.round(np.diff(arrivals) / period), 1))])
        ways = [none_lost] if np.array_equal(none_lost, by_time) else [none_lost, by_time]
        rare = [none_lost + (none_lost > after) for after in none_lost[:-1]]
        found.append(_Seen(change.at - first, arrivals, light if change.white else 1 - light, ways, rare))
    return found


def _share(begin: FloatArray, exposure: FloatArray | float, at: float) -> FloatArray:
    """Of the light of rows that begin to be exposed then, what is of a picture that comes on at that time."""
    return np.clip((begin + exposure - at) / exposure, 0, 1)


def _numbered(
    seen: Sequence[_Seen], rows: FloatArray, period: float, times: tuple[float, float, float], usual: _Usual
) -> tuple[float, list[FloatArray]]:
    """Misfit with that start, readout and exposure, and the numbers of frames that suit them best."""
    start, readout, exposure = times
    total, numbers = 0.0, list[FloatArray]()
    for one in seen:
        middle = np.floor((one.at - start) / period)
        offered = np.array([middle + first + way for way in (*one.ways, *one.rare) for first in BEFORE])
        model = _share(start + period * offered[..., None] + readout * rows, exposure, one.at)
        misfit = np.minimum(np.square(model - one.share), OUTLIER).mean(axis=(1, 2))
        misfit[len(one.ways) * len(BEFORE) :] += RARE
        total += float(misfit.min())
        numbers.append(offered[int(misfit.argmin())])
    lags = [one.arrivals[0] - period * number[0] for one, number in zip(seen, numbers, strict=True)]
    unusual = np.append(usual.off(readout, exposure), WEAK * float(np.std(lags))) / period
    return total + float(np.square(unusual).sum()), numbers


def _beginnings(
    seen: Sequence[_Seen], rows: FloatArray, period: float, usual: _Usual
) -> list[tuple[float, float, float]]:
    """Where the search may begin: of each start, the best readout and exposure."""
    grid = (np.arange(STEPS) + 0.5) / STEPS * period
    start = grid[:, None, None]
    readout = np.concatenate([-grid[1::3], [0.0], grid[1::3]])[None, :, None]
    exposure = grid[None, None, ::2]
    off = np.stack(np.broadcast_arrays(readout - usual.times[0], exposure - usual.times[1]), axis=-1)
    total = np.square(usual.weights * off / period).sum(axis=-1)
    total = np.repeat(total, len(grid), axis=0)
    few = np.unique(np.linspace(0, len(rows) - 1, FEW_BANDS).round().astype(int))
    for one in seen:
        best = np.full(total.shape, OUTLIER)
        for way in one.ways:
            for first in BEFORE:
                begin = start + period * (np.floor((one.at - start) / period) + first)
                misfit = np.zeros(total.shape)
                for step, bands in zip(way, one.share, strict=True):
                    for band in few:
                        model = _share(begin + period * step + readout * rows[band], exposure, one.at)
                        misfit += np.square(model - bands[band])
                best = np.minimum(best, misfit / (len(way) * len(few)))
        total += best
    chosen = total.reshape(len(grid), -1).argmin(axis=1)
    places = cast("tuple[Any, Any]", np.unravel_index(chosen, total.shape[1:]))
    return [
        (float(begin), float(readout[0, row, 0]), float(exposure[0, 0, time]))
        for begin, row, time in zip(grid, places[0], places[1], strict=True)
    ]
