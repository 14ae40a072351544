"""What wrong matches, a few points and noise make by chance is no evidence."""

from __future__ import annotations

from math import erfc, exp, log, pi, sqrt

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray
from retrue.geometry.nearest import nearest_of_all
from retrue.geometry.robust import CUTOFF, count_between, silenced
from retrue.geometry.two_view import FREE, Residuals, behind
from retrue.recalibration.fit import PoseFit

CHANCE = 3.5  # standard deviations of a sum over points that are there by chance
AGREES, FAR = 3.0, 30.0  # sigma from the epipolar line: where right points lie, and where wrong ones do, too
MOST_NEAR = 0.5  # of the points that are asked: so many agree with a pose by no chance
WIDE = 120.0  # sigma: how deep few wrong matches lie, more of them tell
FEWEST_INTERVALS = 2  # of inverse depth; fewer wrong matches tell of no depth
NEIGHBOURS = 4
MOST_STRAYS = 2  # where one is expected: of no more than two, the half or more are there by chance
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


def strays(fit: PoseFit, aside: BoolArray | None) -> BoolArray:
    """(N,) points off all planes that lie on their epipolar lines by chance, as their depth tells.

    Few wrong matches do, but where they make a depth that nothing near them has, they turn the pose more than all right
    points: nothing else holds it there. Those further from their lines say how many to expect at which inverse depth,
    over what the neighbours of a point have (Efron's local false discovery rate, 2001): in intervals where one is
    expected, two or fewer are none. Nor is any point behind a device.
    """
    free = fit.points.plane_index == FREE
    asked = np.flatnonzero(free if aside is None else free & ~aside)
    relative = np.abs(fit.found.epipolar[asked]) / fit.epipolar_noise.level
    near, beyond = asked[relative < CUTOFF], asked[(relative >= CUTOFF) & (relative < WIDE)]
    found = np.zeros(len(free), dtype=np.bool_)
    found[near] = behind(fit.pose, fit.points, fit.epipolar_noise.level)[near]
    each = round((WIDE - CUTOFF) / CUTOFF)  # so many beyond for one that is expected
    if len(beyond) < FEWEST_INTERVALS * each or len(near) < 2 * NEIGHBOURS:
        return found
    x, inverse_depth = fit.points.camera_rays, _inverse_depths(fit)
    own = nearest_of_all(x[near], x[near], NEIGHBOURS + 1)[1][:, 1:]
    over = inverse_depth[near] - np.median(inverse_depth[near][own], axis=1)
    others = nearest_of_all(x[near], x[beyond], NEIGHBOURS)[1]
    wrong = np.sort(inverse_depth[beyond] - np.median(inverse_depth[near][others], axis=1))
    interval = np.searchsorted(wrong[each::each], over)
    found[near] |= np.bincount(interval)[interval] <= MOST_STRAYS
    return found


def _inverse_depths(fit: PoseFit) -> FloatArray:
    """(N,) rho of y x (R x + rho t) = 0, least squares: of the camera's depth in units of |t|, below 0 behind it."""
    x, y = (np.column_stack([rays, np.ones(len(rays))]) for rays in (fit.points.camera_rays, fit.points.projector_rays))
    a, b = np.cross(y, x @ fit.pose.R.T), np.cross(y, fit.pose.t)
    return np.asarray(-(a * b).sum(axis=1) / np.maximum((b * b).sum(axis=1), 1e-300))
