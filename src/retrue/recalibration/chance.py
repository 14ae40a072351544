"""What wrong matches, a few points and noise make by chance is no evidence."""

from __future__ import annotations

from math import erfc, exp, log, pi, sqrt

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray
from retrue.geometry.robust import CUTOFF, count_between, silenced
from retrue.geometry.two_view import FREE, Residuals
from retrue.recalibration.fit import PoseFit

CHANCE = 3.5  # standard deviations of a sum over points that are there by chance
AGREES, FAR = 3.0, 30.0  # sigma from the epipolar line: where right points lie, and where wrong ones do, too
MOST_NEAR = 0.5  # of the points that are asked: so many agree with a pose by no chance
CHANCE_NATS = 12.0  # what five free parameters find among points that lie anywhere


def without_chance(fit: PoseFit, aside: BoolArray | None) -> PoseFit:
    """Points set aside leave no residual, nor do those off all planes that agree with the pose no more than by chance.

    Wrong matches lie as densely within three sigma of their epipolar line as further from it. With n there and c
    expected, n log(n / c) - (n - c) is the log likelihood ratio of a part that is right; and a pose that is free to
    move finds the place where most of them agree, so that it must be larger than what that freedom makes. Blocks that
    are taken for others of a grid lie on lines of their own, one a row, and the pose finds one of these: `lined_up`.
    """
    free = fit.points.plane_index == FREE
    asked = free if aside is None else free & ~aside
    near, beyond = count_between(fit.found.epipolar, asked, fit.epipolar_noise.level, (AGREES, CUTOFF, FAR))
    chance = max(beyond, 1) * AGREES / (FAR - CUTOFF)
    if 0 < chance < near < MOST_NEAR * np.count_nonzero(asked):
        chance = max(chance, lined_up(fit.found.epipolar[asked] / fit.epipolar_noise.level))
    silent = aside
    if not (near > chance and near * np.log(near / chance) - (near - chance) > CHANCE_NATS):
        silent = free if aside is None else free | aside
    if silent is None or not silent.any():
        return fit
    both, weights = silenced(fit.found.both, fit.robust_weights, silent)
    return PoseFit(fit.pose, fit.points, Residuals(both), *fit.noises, weights)


def lined_up(relative: FloatArray) -> float:
    """How many of residuals, over their noise, lie within three sigma of each other where they lie most densely.

    Of windows like the one about zero, beside it and as far out as half of the residuals lie.

    >>> rows = np.repeat(np.arange(-50.0, 50.0) * 30, 40)
    >>> lined_up(rows)
    40.0
    """
    reach = max(float(np.median(np.abs(relative))), FAR)
    sides = np.arange(AGREES, reach + 2 * AGREES, 2 * AGREES)
    counts = [np.histogram(side * relative, sides)[0] for side in (1, -1)]
    return float(np.max(counts))


def beyond_chance(preferred: FloatArray) -> float:
    """1 for a sum over points that no chance makes, less where a few of them make it."""
    squares = float((preferred**2).sum())
    deviations = float(preferred.sum() / np.sqrt(squares)) if squares > 0 else 0.0
    return min(1.0, (deviations / CHANCE) ** 2)


def deviations_limit(false_alarms: float) -> float:
    """Sigma that so large a share of good rigs exceeds: chi with five degrees of freedom."""
    d = 5.0
    for _ in range(NEWTON_STEPS):  # P(chi > d) = erfc(d / sqrt 2) + sqrt(2 / pi) exp(-d^2 / 2) (d + d^3 / 3)
        density = sqrt(2 / pi) * exp(-(d**2) / 2)
        share = erfc(d / sqrt(2)) + density * (d + d**3 / 3)
        d += share / (density * d**4 / 3) * log(share / false_alarms)
    return d


NEWTON_STEPS = 20
