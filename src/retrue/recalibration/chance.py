"""What wrong matches, a few points and noise make by chance is no evidence."""

from __future__ import annotations

from math import erfc, exp, log, pi, sqrt
from typing import Any

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.nearest import nearest_of_all
from retrue.geometry.robust import CUTOFF, count_between, quantile, silenced
from retrue.geometry.two_view import FREE, Residuals, behind
from retrue.recalibration.fit import PoseFit

CHANCE = 3.5  # standard deviations of a sum over points that are there by chance
AGREES, FAR = 3.0, 30.0  # sigma from the epipolar line: where right points lie, and where wrong ones do, too
MOST_NEAR = 0.5  # of the points that are asked: so many agree with a pose by no chance
WIDE, ENOUGH = 120.0, 100  # sigma; matches: how deep few wrong ones lie, so many more of them tell
NEIGHBOURS = 4
ODDS = 2.0  # of chance over what the others explain
CHANCE_NATS = 12.0  # what five free parameters find among points that lie anywhere


def without_chance(fit: PoseFit, aside: BoolArray | None, lone: BoolArray | None = None) -> PoseFit:
    """Points set aside leave no residual, nor do those off all planes that agree with the pose no more than by chance.

    Wrong matches lie as densely within three sigma of their epipolar line as further from it. With n there and c
    expected, n log(n / c) - (n - c) is the log likelihood ratio of a part that is right; and a pose that is free to
    move finds the place where most of them agree, so that it must be larger than what that freedom makes. Blocks that
    are taken for others of a grid lie on lines of their own, one a row, and the pose finds one of these: `lined_up`.
    A plane's own noise, `lone`, lies about where the plane has it: near the lines of one of its twins, if not of both.
    """
    free = fit.points.plane_index == FREE
    if lone is not None:
        aside = lone if aside is None else lone | aside
    asked = free if aside is None else free & ~aside
    near, beyond = count_between(fit.found.epipolar, asked, fit.epipolar_noise.level, (AGREES, CUTOFF, FAR))
    chance = max(beyond, 1) * AGREES / (FAR - CUTOFF)
    if 0 < chance < near < MOST_NEAR * np.count_nonzero(asked):
        chance = max(chance, lined_up(fit.found.epipolar[asked] / fit.epipolar_noise.level))
    silent = aside
    if not (near > chance and nats_beyond_chance(near, chance) > CHANCE_NATS):
        silent = free if aside is None else free | aside
    if silent is None or not silent.any():
        return fit
    both, weights = silenced(fit.found.both, fit.robust_weights, silent)
    return PoseFit(fit.pose, fit.points, Residuals(both), *fit.noises, weights, fit.noise_shape)


def lined_up(relative: FloatArray) -> float:
    """How many of residuals, over their noise, lie within three sigma of each other where they lie most densely.

    Of windows like the one about zero, beside it and as far out as half of the residuals lie.

    >>> rows = np.repeat(np.arange(-50.0, 50.0) * 30, 40)
    >>> lined_up(rows)
    40.0
    """
    distance = np.abs(relative)
    windows = int(np.ceil((max(quantile(distance, 0.5), FAR) - AGREES) / (2 * AGREES)))
    window = (distance - AGREES) / (2 * AGREES)
    inside = np.flatnonzero((window >= 0) & (window < windows))
    counts = np.bincount(window[inside].astype(np.int64) + windows * (relative[inside] > 0), minlength=1)
    return float(counts.max())


def beyond_chance(preferred: FloatArray) -> float:
    """1 for a sum over points that no chance makes, less where a few of them make it."""
    squares = float((preferred**2).sum())
    deviations = float(preferred.sum() / np.sqrt(squares)) if squares > 0 else 0.0
    return min(1.0, (deviations / CHANCE) ** 2)


def deviations_limit(false_alarms: float) -> float:
    """Sigma that so large a share of good rigs exceeds: chi with five degrees of freedom."""
    d = max(5.0, sqrt(-2 * log(false_alarms)))
    for _ in range(NEWTON_STEPS):
        density = sqrt(2 / pi) * exp(-(d**2) / 2)
        share = share_beyond(d)
        step = share / (density * d**4 / 3) * log(share / false_alarms)
        d += step
        if abs(step) < ROUNDING * d:
            break
    return d


def share_beyond(d: float) -> float:
    """P(chi > d) of five degrees of freedom: erfc(d / sqrt 2) + sqrt(2 / pi) exp(-d^2 / 2) (d + d^3 / 3)."""
    return erfc(d / sqrt(2)) + sqrt(2 / pi) * exp(-(d**2) / 2) * (d + d**3 / 3)


def deviations_of_mixture(weights: FloatArray, deviations: FloatArray) -> float:
    """Sigma of one part that are exceeded as seldom as those of a mixture are, `deviations` by that of each part alone.

    >>> round(deviations_of_mixture(np.array([1.0, 0.0]), np.array([4.0, 1.0])), 2)
    4.0
    >>> round(deviations_of_mixture(np.array([0.9, 0.1]), np.array([8.0, 1.0])), 2)
    3.06
    """
    share = float(sum(weight * share_beyond(d) for weight, d in zip(weights, deviations, strict=True)))
    return deviations_limit(share) if 1e-300 < share < 1 - 1e-9 else float(deviations.min())


NEWTON_STEPS, ROUNDING = 20, 1e-15


def strays(fit: PoseFit, aside: BoolArray | None) -> BoolArray:
    """(N,) points off all planes that lie on their epipolar lines by chance, as their depth tells.

    Few wrong matches do, but where they make a depth that nothing near them has, they turn the pose more than all right
    points: nothing else holds it there. Those further from their lines say how many to expect at which inverse depth,
    over what the most alike neighbour of a point has: `outlying`. Nor is any point behind a device.
    """
    free = fit.points.plane_index == FREE
    asked = np.flatnonzero(free if aside is None else free & ~aside)
    relative = np.abs(fit.found.epipolar[asked]) / fit.epipolar_noise.level
    near, far = asked[relative < CUTOFF], np.sort(relative[relative >= CUTOFF])
    found = np.zeros(len(free), dtype=np.bool_)
    found[near] = behind(fit.pose, fit.points, fit.epipolar_noise.level)[near]
    if len(far) == 0 or len(near) < 2 * NEIGHBOURS:
        return found
    reach = max(WIDE, float(far[:ENOUGH][-1]))
    inverse_depth, x = _inverse_depths(fit, near), fit.points.camera_rays
    beyond = asked[(relative >= CUTOFF) & (relative <= reach)]
    depth_beyond = _inverse_depths(fit, beyond)
    beyond, depth_beyond = beyond[depth_beyond > 0], depth_beyond[depth_beyond > 0]
    own = nearest_of_all(x[near], x[near], NEIGHBOURS + 1)[1][:, 1:]
    others = nearest_of_all(x[near], x[beyond], NEIGHBOURS)[1]
    over = _over_most_alike(inverse_depth, inverse_depth[own])
    wrong = _over_most_alike(depth_beyond, inverse_depth[others])
    share = CUTOFF / (reach - CUTOFF)
    for side in (1, -1):
        found[near] |= outlying(side * over, side * wrong, share)
    return found


def nats_beyond_chance(found: Any, expected: Any) -> Any:
    """Log likelihood ratio of that many, of whatever origin, over as many as chance leads to expect (Poisson).

    >>> float(nats_beyond_chance(3.0, 3.0)), round(float(nats_beyond_chance(4.0, 1.0)), 2)
    (0.0, 2.55)
    """
    return found * np.log(found / expected) - (found - expected)


def outlying(over: FloatArray, wrong: FloatArray, share: float) -> BoolArray:
    """(N,) the outermost of `over`, of which chance explains more than the others do; of it, `share` of `wrong` is due.

    Right points thin out outwards at least as the square of their distance, which is known from the next one inwards:
    a few that stand off by themselves are there by chance, if chance can make so many.

    >>> right, wrong = np.array([0.01, -0.02, 0.03, 0.9]), np.linspace(0.0, 2.0, 20)
    >>> outlying(right, wrong, 0.02).tolist()
    [False, False, False, True]
    """
    order = np.argsort(-over)
    out = over[order]
    out = out[: int(np.searchsorted(-out, 0.0))]  # on this side
    count = np.arange(1, len(out) + 1)
    expected = share * (len(wrong) - np.searchsorted(np.sort(wrong), out) + 0.5)  # the half is Jeffreys'
    inwards = np.append(out[1:], out[-1:])
    right = (count + 1) * (inwards / out) ** 2
    there = (ODDS * right < expected) & (nats_beyond_chance(count, expected) < CHANCE_NATS)
    found = np.zeros(len(over), dtype=np.bool_)
    found[order[: int(np.max(count[there], initial=0))]] = True
    return found


def _over_most_alike(inverse_depth: FloatArray, neighbours: FloatArray) -> FloatArray:
    """(N,) how much larger an inverse depth is than that of its `neighbours` (N, K) which is most like it."""
    over = inverse_depth[:, None] - neighbours
    return np.take_along_axis(over, np.abs(over).argmin(axis=1)[:, None], axis=1)[:, 0]


def _inverse_depths(fit: PoseFit, rows: IntArray) -> FloatArray:
    """(rows,) rho of y x (R x + rho t) = 0, least squares: of the camera's depth in |t|, below 0 behind it."""
    x, y = (np.ascontiguousarray(rays[rows].T) for rays in (fit.points.camera_rays, fit.points.projector_rays))
    t = fit.pose.t
    turned = fit.pose.R[:, :2] @ x + fit.pose.R[:, 2:]

    def crossed(v: FloatArray) -> tuple[FloatArray, ...]:
        return y[1] * v[2] - v[1], v[0] - y[0] * v[2], y[0] * v[1] - y[1] * v[0]

    a, b = crossed(turned), crossed(t)
    both, square = (sum(p * q for p, q in zip(one, b, strict=True)) for one in (a, b))
    return np.asarray(-both / np.maximum(square, 1e-300))
