"""What a quadric cannot follow of a surface, told from noise: the lack of fit of each window of a smoothed cloud.

A quadric that is fitted to a window is off in its middle by noise, and by what the surface does that no quadric does: a
crease, a tight bend. A quartic through the same window follows more of that. So their contrast in the middle has noise
of known size, and beyond it a lack of fit, b. Let q be its mean square over half the window, in units of that of noise.
With b^2 = beta times noise, q is noncentral chi-square of n degrees of freedom over n,

    mean q = 1 + beta,    variance of q = 2 (1 + 2 beta) / n,

here a gamma density of those two moments. How often each beta occurs, the cloud tells itself: maximum likelihood of
the mixture, by expectation and maximisation. So does it tell the noise, that of windows in which beta is 0. What is
expected of b^2 then, by q, is an empirical Bayes estimate: on planes hardly anything, however large q is by chance.
Bends all over a cloud are not told from neighbours that err alike: what is the least everywhere counts as noise.

Sources: Robbins, "An empirical Bayes approach to statistics", Berkeley Symposium 3, 1956; Laird, "Nonparametric maximum
likelihood estimation of a mixing distribution", Journal of the American Statistical Association 73, 1978.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, cast

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray

SHOWN = 1 / 2.2
"""Share of b^2, mean over a window, that the contrast shows of a crease: the least; of a slow bend it shows all."""
LEAST, LEAST_SIZE = 0.2, 0.2533
"""Share of the contrasts that tells the noise at first, and that quantile of the size of normal numbers."""
BETAS: FloatArray = np.append(0.0, np.geomspace(0.25, 300, 40))
AT_FIRST = 0.5  # of the windows that fit; as many do not, by any beta alike
BINS: FloatArray = np.geomspace(1e-3, 1e3, 481)
ROUNDS, ROUNDS_OF_NOISE = 5, 12
FEWEST = 500
"""Windows that tell how often each beta occurs; of fewer it is as at first."""


@dataclass(frozen=True, slots=True, eq=False)
class LackOfFit:
    """Of the windows about each cell, (H, W).

    Attributes
    ----------
    variance : what is expected of b^2, in the unit of the values squared; infinite where there is no window.
    fits : whether b is 0 rather than not.
    """

    variance: FloatArray
    fits: BoolArray


def centre_filter(half: int, degree: int) -> FloatArray:
    """(2 half + 1,) weights of equally spaced values in the value of their polynomial in the middle.

    >>> (35 * centre_filter(2, 2)).round(9).tolist()
    [-3.0, 12.0, 17.0, 12.0, -3.0]
    """
    x = np.arange(-half, half + 1) / half
    return np.asarray(np.linalg.pinv(x[:, None] ** np.arange(0, degree + 1, 2))[0], np.float64)


def lack_of_fit(values: FloatArray, variance: FloatArray, whole: BoolArray, half: int) -> LackOfFit:
    """Of windows of 2 half + 1 cells a side over `values` (H, W), finite everywhere.

    Parameters
    ----------
    variance : (H, W) mean of the values' own, over the window about each cell.
    whole : (H, W) where there is such a window; elsewhere values and variances do not matter.
    """
    mean, second, fourth = _parts(half)
    noise = np.where(whole, variance, 1.0) * _share_of_noise(half)
    contrast = filtered(values, mean, fourth) + filtered(values, fourth, mean) + filtered(values, second, second)
    size: FloatArray = np.where(whole, np.abs(contrast) / np.sqrt(noise), 0.0)
    told = size[whole]
    enough = len(told) >= FEWEST
    level = float(np.quantile(told, LEAST) / LEAST_SIZE) ** 2 if enough else 1.0
    around = np.full(_side_around(half), 1 / _side_around(half))
    counted = filtered(whole.astype(np.float64), around, around)
    squares = filtered(size**2, around, around)
    with np.errstate(invalid="ignore", divide="ignore"):
        q = np.clip(np.where(whole, squares / (counted * level), 1.0), BINS[0], BINS[-1])
    table = _Posterior.of(q[whole], _samples(half), ROUNDS_OF_NOISE if enough else 0)
    beta, fits = table.at(q)
    return LackOfFit(np.where(whole, level * table.noise * noise * beta / SHOWN, np.inf), whole & (fits > 0.5))


@dataclass(frozen=True, slots=True, eq=False)
class _Posterior:
    """By q at BINS: what is expected of beta, and how likely it is 0; and the noise, of that which q is in units of."""

    beta: FloatArray
    fits: FloatArray
    noise: float

    @classmethod
    def of(cls, q: FloatArray, samples: float, rounds: int) -> _Posterior:
        edges = np.sqrt(BINS[1:] * BINS[:-1])
        count = np.bincount(np.searchsorted(edges, q), minlength=len(BINS)).astype(np.float64)
        often = np.append(AT_FIRST, np.full(len(BETAS) - 1, (1 - AT_FIRST) / (len(BETAS) - 1)))
        noise = 1.0
        likely = _posterior(BINS, often, samples)
        for _ in range(rounds):
            for _ in range(ROUNDS):
                often = count @ likely / count.sum()
                likely = _posterior(BINS / noise, often, samples)
            fitting = count * likely[:, 0]
            if fitting.sum() > 0:
                noise = float(fitting @ BINS / fitting.sum())
            likely = _posterior(BINS / noise, often, samples)
        return cls(likely @ BETAS, likely[:, 0], noise)

    def at(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        logs, bins = np.log(q), np.log(BINS)
        return np.interp(logs, bins, self.beta), np.interp(logs, bins, self.fits)


def _posterior(q: FloatArray, often: FloatArray, samples: float) -> FloatArray:
    """(len(q), len(BETAS)) how likely each beta is, that `often` are so."""
    from scipy.special import gammaln

    mean, variance = 1 + BETAS, 2 * (1 + 2 * BETAS) / samples
    shape, scale = mean**2 / variance, variance / mean
    with np.errstate(divide="ignore"):
        logs = (shape - 1) * np.log(q)[:, None] - q[:, None] / scale - shape * np.log(scale) - gammaln(shape)
        logs += np.log(often)
    likely = np.exp(logs - logs.max(axis=1, keepdims=True))
    return np.asarray(likely / likely.sum(axis=1, keepdims=True), np.float64)


def _parts(half: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Filters of a line: its mean, what a parabola adds to that in the middle, and what a quartic adds to this."""
    mean = np.full(2 * half + 1, 1 / (2 * half + 1))
    parabola = centre_filter(half, 2)
    quartic = centre_filter(half, 4) if half > 1 else parabola
    return mean, parabola - mean, quartic - parabola


@cache
def _share_of_noise(half: int) -> float:
    """Variance of the contrast, of white noise of 1."""
    return float((_contrast(half) ** 2).sum())


@cache
def _samples(half: int) -> float:
    """Degrees of freedom of a mean square of the contrast about a cell; of white noise."""
    side, whole = _side_around(half), 8 * half
    power = np.abs(np.fft.rfft2(_contrast(half), (whole, whole))) ** 2
    alike = np.fft.irfft2(power, (whole, whole))
    apart = np.abs(np.fft.fftfreq(whole, 1 / whole))
    pairs = np.maximum(1 - apart / side, 0) / side
    return float(1 / (pairs @ (alike / alike[0, 0]) ** 2 @ pairs))


def _contrast(half: int) -> FloatArray:
    mean, second, fourth = _parts(half)
    return np.outer(mean, fourth) + np.outer(fourth, mean) + np.outer(second, second)


def _side_around(half: int) -> int:
    """Cells along half a window."""
    return 2 * (half // 2) + 1


def filtered(values: FloatArray, down: FloatArray, across: FloatArray) -> FloatArray:
    """(H, W) values, weighted along both axes; 0 beyond the border."""
    from scipy import ndimage

    along = cast("Any", ndimage).correlate1d(values, down, axis=0, mode="constant")
    return cast("Any", ndimage).correlate1d(along, across, axis=1, mode="constant")
