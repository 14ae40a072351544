"""Robust statistics: how large noise is among values of which many may be wrong, and what each value weighs then.

Each residual is modelled as independent noise plus a slow error that neighbours share (a bowed
plane, what a lens model leaves over, a smoothed code). Both levels are estimated from the residuals: a
thousand neighbours with one common error then weigh like one, and the reported sigma says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.kernels import robust as kernel

MAD_TO_SIGMA = 1.4826
"""Sigma of a normal distribution, in medians of the absolute deviation."""
MEDIAN_DISTANCE = 1.1774
"""Median length of two independent normal components, in their sigma."""
QUARTILE = 0.3186  # the absolute value that a quarter of a standard normal stays below
CUTOFF = 6.0  # of the noise; Tukey's biweight there keeps 98 % of the efficiency of least squares
CONSISTENCY = 0.8924  # E[w r^2] / E[w] of a standard normal under that biweight
COVARIANCE_FACTOR = 0.9651  # E[w] E[psi^2] / E[psi']^2 likewise: inverse information to covariance
SMALLEST_LEVEL = 1e-9  # of the nominal sigma: exact points
STEPS = 4
ENOUGH_VALUES = 4000  # to start from


@dataclass(frozen=True, slots=True, eq=False)
class Noise:
    """One family of residuals: its level as a multiple of the nominal sigma, and each residual's variance.

    Attributes
    ----------
    level : standard deviation of the independent part.
    shared : standard deviation of the part that the points of a block share.
    variance : (N,) effective variance: sums of squares over it are chi-square.
    alikeness : by how much neighbouring blocks, being alike, raise that of the shared part.
    """

    level: float
    shared: float
    variance: FloatArray
    alikeness: float = 1.0

    @property
    def total(self) -> float:
        """Standard deviation of both parts together."""
        return float(np.hypot(self.level, self.shared))

    @property
    def variance_of_blocks(self) -> FloatArray:
        """(N,) the same if each block erred by itself."""
        return self.level**2 + (self.variance - self.level**2) / self.alikeness


def biweight(relative: FloatArray) -> FloatArray:
    """Tukey's weight (1 - (r / 6)^2)^2; zero from 6 on, and for NaN.

    >>> biweight(np.array([0.0, 3.0, 7.0, np.nan])).tolist()
    [1.0, 0.5625, 0.0, 0.0]
    """
    inside = 1 - (relative / CUTOFF) ** 2
    return np.fmax(inside, 0.0) ** 2


def count_between(
    values: FloatArray, rows: BoolArray, level: float, bounds: tuple[float, float, float]
) -> tuple[int, int]:
    """Of those rows (N,) of values over their level, how many are smaller, whatever their sign, than the first bound,
    and how many lie between the others."""
    counts = np.empty(2, dtype=np.int64)
    kernel.count_between(values, rows.view(np.uint8), level, *bounds, counts)
    return int(counts[0]), int(counts[1])


def silenced(families: FloatArray, weights: FloatArray, rows: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Copies of families (K, N) of values and of their weights, those rows (N,) NaN, and without weight."""
    values, left = np.empty(families.shape), np.empty(weights.shape)
    kernel.silence(families, weights, rows.view(np.uint8), values, left)
    return values, left


def gather_weights(
    both: FloatArray, plane_index: IntArray, planes: int, floor: float, reach: float
) -> tuple[FloatArray, float, float]:
    """Weights (2, N) over the variance of residuals (2, N), each plane's at its own level, of the rest within reach.

    Returns them, the least of the levels (or `floor`, where there is no plane), and the new reach: a third of the last
    one, or the median of the rest where that is less, but not below the least level.
    """
    weights, levels, room = np.empty(both.shape), np.empty(planes + 1), np.empty(both.size)
    limits = MAD_TO_SIGMA, CUTOFF, SMALLEST_LEVEL
    places = both, plane_index, planes, floor, reach
    reach = cast("float", kernel.gather_weights(*places, *limits, room, levels, weights))
    return weights, float(levels[1:].min()) if planes else floor, reach


def biweight_loss(relative: FloatArray) -> FloatArray:
    """Tukey's loss: r^2 near zero, 12 from 6 on, and for NaN.

    >>> biweight_loss(np.array([0.1, 7.0, np.nan])).round(6).tolist()
    [0.009997, 12.0, 12.0]
    """
    inside = 1 - (relative / CUTOFF) ** 2
    return CUTOFF**2 / 3 * (1 - np.fmax(inside, 0.0) ** 3)


def total_loss(values: FloatArray, noise: Noise) -> float:
    """Sum of that loss over the level, in the variance of each value: a chi-square that saturates."""
    return cast("float", kernel.loss(values, noise.level, noise.variance, CUTOFF))


def median_level(values: FloatArray) -> float:
    """Standard deviation from the median absolute value; not below that of exact points.

    >>> round(median_level(np.array([1.0, -2.0, 3.0, 40.0])), 4)
    3.7065
    """
    return max(MAD_TO_SIGMA * quantile(np.abs(values), 0.5), SMALLEST_LEVEL)


def quantile(values: FloatArray, share: float) -> float:
    """The value that a share of the others stays below, linear in between; zero of nothing. By selection, not sorting.

    >>> quantile(np.array([4.0, 1.0, 2.0, 3.0]), 0.5)
    2.5
    """
    if len(values) == 0:
        return 0.0
    place = share * (len(values) - 1)
    low = int(place)
    high = min(low + 1, len(values) - 1)
    chosen = np.partition(values, (low, high))
    below, above = float(chosen[low]), float(chosen[high])
    return below + (place - low) * (above - below) if below < above else below


def biweight_level(values: FloatArray, correction: float = 1.0) -> float:
    """Standard deviation under Tukey's biweight, squares times `correction` for spent degrees of freedom.

    It starts from the nearest quarter of the values, so that half may be wrong, and more; NaN does not count.

    >>> values = np.concatenate([np.random.default_rng(0).normal(0, 2, 600), np.full(400, 1e3)])
    >>> bool(1.8 < biweight_level(values) < 2.2)
    True
    """
    every = max(1, len(values) // ENOUGH_VALUES)
    start = cast("float", kernel.absolute_quantile(values, every, 0.25, np.empty(len(values) // every + 1))) / QUARTILE
    return reweighted_level(values, max(start, SMALLEST_LEVEL), correction)


def reweighted_level(values: FloatArray, start: float, correction: float = 1.0) -> float:
    """The same from a start of one's own."""
    inflation = correction / CONSISTENCY
    return cast("float", kernel.reweighted_level(values, start, CUTOFF, inflation, SMALLEST_LEVEL, STEPS))


def grid_blocks(points: FloatArray, group: IntArray, per_side: int) -> IntArray:
    """(N,) number of the block, one of a grid over the points (N, 2) of each group, that each lies in; -1 in group -1.

    >>> grid_blocks(np.array([[0.0, 0.0], [0.4, 0.9], [1.0, 1.0], [5.0, 5.0]]), np.array([0, 0, 0, -1]), 2).tolist()
    [0, 2, 3, -1]
    """
    blocks = np.empty(len(points), dtype=np.int64)
    extent = np.empty((int(group.max(initial=-1)) + 1, 4))
    kernel.number_blocks(np.ascontiguousarray(points), np.ascontiguousarray(group), per_side, extent, blocks)
    return blocks


def noises_and_weights(
    families: FloatArray, levels: Sequence[float], blocks: IntArray, per_side: int
) -> tuple[list[Noise], FloatArray]:
    """Of families (K, N) of values, each over its level, the noise that blocks (K, N) share, and `biweight` (K, N).

    The scatter of block means is split into what independent noise explains and what it does not. With n points of
    independent level s in each block, Q = sum n mean^2 / s^2 is chi-square with one degree of freedom a block; what it
    exceeds that by is the shared part (DerSimonian and Laird 1986). Where neighbouring blocks are alike, a slow error
    runs through them, and they tell less than as many that err each by itself. Block -1 stands for no residual. Blocks
    are those of `grid_blocks`, so many per side.
    """
    weights, variances = np.empty(families.shape), np.empty(families.shape)
    groups = int(blocks.max(initial=-1)) // per_side**2 + 1
    number, total = np.empty((2, groups * per_side**2 + 1))  # the last stays empty: it is block -1
    noises: list[Noise] = []
    for values, level, mine, own, variance in zip(families, levels, blocks, weights, variances, strict=True):
        shared = cast("float", kernel.shared_part(values, level, CUTOFF, mine, number, total, own, variance))
        if shared > 0:
            alikeness = cast("float", kernel.alikeness(number, total, shared, per_side))
            noises.append(Noise(level, shared, level**2 + (variance - level**2) * alikeness, alikeness))
        else:
            noises.append(Noise(level, shared, variance))
    return noises, weights
