"""What an explanation costs: its points, priors and planes, and the parts that have an explanation of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, log

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray
from retrue.geometry.robust import CUTOFF, Noise, biweight_loss
from retrue.geometry.two_view import FREE
from retrue.kernels import robust as kernel
from retrue.recalibration.fit import PoseFit
from retrue.recalibration.measured import MISFIT_PX
from retrue.recalibration.parts import A_COPY, Part, of_another_pose
from retrue.recalibration.posterior import Measured, Posterior, same_answer

UNEXPLAINED = 12.0  # of chi-square: what a point costs that a hypothesis does not explain, or has hidden or behind
PARAMETER = 12.0  # of chi-square, what a free parameter costs: its range is some 400 times what the points leave
FEWEST_OF_A_PLANE = 12
SELDOM = 1.7  # of chi-square, 2 log(.7 / .3): a point of a copy, a mirror, or what moved, is the rarer one
RARE = 18.0  # of chi-square, 2 log 8000: so few captures have a copy, where a plane more is nothing strange
APART = 10.0  # times the noise: nearer to the line where two planes meet, either may claim a point


@dataclass(frozen=True, slots=True)
class Floor:
    """The smallest noise of any hypothesis, across and along the epipolar line, with each residual's variance."""

    across: Noise
    along: Noise

    @classmethod
    def of(cls, posteriors: Sequence[Posterior]) -> Floor:
        """Each family's own."""
        fits = [posterior.fit for posterior in posteriors]
        return cls(
            min((fit.epipolar_noise for fit in fits), key=lambda noise: noise.level),
            min((fit.along_noise for fit in fits), key=lambda noise: noise.level),
        )


def costs(posterior: Posterior, floor: Floor) -> FloatArray:
    """(N,) -2 log likelihood of each point, up to a constant, saturated: both residuals in the hypothesis' own noise,
    see `negative_log_likelihood`, over the level of the floor.

    As much as an unexplained point costs one that the hypothesis has behind a device, or hides: surfaces are opaque,
    and planes that alternate all over the picture are not two.
    """
    levels = np.array([[floor.across.level], [floor.along.level]])
    on_plane = posterior.measured.support.blocks >= 0
    over = posterior.losses - np.where(on_plane, np.log(levels**2 + MISFIT_PX**2), 0.0)
    found: FloatArray = np.fmin(over, UNEXPLAINED).sum(axis=0)
    return np.where(posterior.impossible, np.maximum(found, UNEXPLAINED), found)


Explained = tuple[FloatArray, float, list[tuple[float, BoolArray]]]


def explained_costs(posterior: Posterior, floor: Floor, asides: Sequence[Part]) -> Explained:
    """`costs` (N,) where a part of the points may have another explanation; the price of priors and planes; and of each
    such part, with its points (N,).

    A plane has three free parameters, a shifted copy two or three, a plane of its own eight, another pose five, each of
    which a wider range would have fitted as well.
    """
    found = costs(posterior, floor)
    plane = posterior.points.plane_index
    counts = np.bincount(plane[(plane != FREE) & (posterior.fit.robust_weights[1] > 0)], minlength=1)
    price = posterior.prior_cost + 3 * PARAMETER * int(np.count_nonzero(counts >= FEWEST_OF_A_PLANE))
    foreign = [other for other in asides if of_another_pose(other, posterior)]
    others = [(other, anywhere_along(other, posterior)) for other in (*posterior.parts, *foreign)]
    worthy = [one for one in others if (found[one[0].rows].clip(0.0) + one[1]).sum() > price_of(one[0])]
    left = [(other, _costs_of_part(other, posterior, floor, along)) for other, along in worthy]
    parts = list[tuple[float, BoolArray]]()
    while left:  # the part that gains most comes first: another may have the same points
        gains = [np.maximum(found[other.rows] - explained, 0.0) for other, explained in left]
        worth = [float(gain.sum()) - price_of(other) for gain, (other, _) in zip(gains, left, strict=True)]
        best = int(np.argmax(worth))
        if not worth[best] > 0:
            break
        other, _ = left.pop(best)
        found[other.rows] -= gains[best]
        parts.append((price_of(other), other.rows))
    return found, price, parts


def copies_that_pay(posterior: Posterior) -> list[Part]:
    """Those whose points are explained so much better as a copy of a plane that it is worth its price."""
    floor = Floor.of([posterior])
    found = costs(posterior, floor)

    def gain(copy: Part) -> float:
        explained = _costs_of_part(copy, posterior, floor, anywhere_along(copy, posterior))
        return float(np.maximum(found[copy.rows] - explained, 0.0).sum())

    return [part for part in posterior.parts if part.name == A_COPY and gain(part) > price_of(part)]


def mean_cost_across(fit: PoseFit, least: float) -> float:
    """`costs` of a point across its epipolar line only, over that least noise: readings of captures share no planes."""
    level = fit.epipolar_noise.level
    cost = biweight_loss(fit.found.epipolar / level) + 2 * log(level / least)
    return float(np.minimum(cost, UNEXPLAINED).mean())


def price_of(part: Part) -> float:
    """Chi-square that its parameters cost, and that few captures have a copy."""
    return part.parameters * PARAMETER + (RARE if part.name == A_COPY else 0.0)


def scattered(part: Part, measured: Measured) -> float:
    """How much its points alternate with others: the share of its neighbours that are none of it, over chance's.

    What is in one place was not chosen point by point, but along its edge.
    """
    others = 1 - float(part.rows.mean())
    if not (measured.neighbours.size and others > 0):
        return 1.0
    return min((1 - float(part.rows[measured.neighbours[part.rows]].mean())) / others, 1.0)


def price_of_a_point(part: Part, measured: Measured) -> float:
    """Chi-square that each of its points costs for being of the rarer kind.

    Of codes that are off, all are as far as they alternate with others; print alternates by itself.
    """
    if part.name == A_COPY and not measured.textured:
        return SELDOM * max(part.seldom, scattered(part, measured))
    return SELDOM * part.seldom


def anywhere_along(part: Part, posterior: Posterior) -> FloatArray:
    """(rows,) what a point on no plane costs any pose, for it may be anywhere along its line: a copy says where.

    What is in one place is a surface, and its neighbours say it, too. Print repeats in space, and what shows it is told
    by what lies between: see `copies_seen_through`.
    """
    free = posterior.points.plane_index[part.rows] == FREE
    if part.missed.shape[1] == 1 or posterior.measured.textured or not free.any():
        return np.zeros(len(free))
    return np.where(free, UNEXPLAINED * scattered(part, posterior.measured), 0.0)


def _costs_of_part(part: Part, posterior: Posterior, floor: Floor, along: FloatArray) -> FloatArray:
    """(rows,) what its points cost where it explains them; they are no quieter than those of the pose.

    `along` (rows,) is what each costs `anywhere_along` its line.
    """
    explained = price_of_a_point(part, posterior.measured) - along
    if part.missed.shape[1] == 1:
        explained = explained + np.where(posterior.points.plane_index[part.rows] != FREE, UNEXPLAINED, 0.0)
    families = zip(range(part.missed.shape[1]), posterior.fit.noises, (floor.across, floor.along), strict=False)
    for family, noise, least in families:
        quietest, level = hypot(least.level, MISFIT_PX), hypot(part.level, MISFIT_PX)
        if part.level < least.level:  # it gains nothing by that: what real lenses leave over is as large a share of it
            level = part.level * quietest / least.level
        louder = 2 * max(log(max(level, hypot(noise.level, MISFIT_PX)) / quietest), 0.0)
        kernel.add_loss(part.missed, family, level, louder, CUTOFF, UNEXPLAINED, explained)
    return explained


def worth_of(part: Part, posterior: Posterior) -> float:
    """Chi-square that it saves, over leaving its points unexplained, less its price."""
    saved = 2 * UNEXPLAINED - _costs_of_part(part, posterior, Floor.of([posterior]), np.zeros(part.count))
    return float(np.maximum(saved, 0.0).sum()) - price_of(part)


def worth_at_most(count: int, parameters: int, seldom: float) -> float:
    """What so many points of a copy may be worth, if it misses none of them."""
    return count * (2 * UNEXPLAINED - SELDOM * seldom) - parameters * PARAMETER - RARE


def least(posteriors: list[Posterior], asides: Sequence[Part] = ()) -> Posterior:
    """The posterior of least cost; of those that its sigma holds, the one that the lenses as they are fit best."""
    if len(posteriors) == 1:
        return posteriors[0]
    best = least_costly(posteriors, [fit.eased for fit in posteriors], asides)
    alike = [fit for fit in posteriors if fit is best or same_answer(best, fit.pose)]
    return best if len(alike) == 1 else least_costly(alike, alike, asides)


def least_costly(posteriors: list[Posterior], judged: list[Posterior], asides: Sequence[Part]) -> Posterior:
    """The posterior whose form in `judged` costs least."""
    return posteriors[int(np.argmin(total_costs(judged, asides)))]


def total_costs(posteriors: Sequence[Posterior], asides: Sequence[Part] = ()) -> list[float]:
    """-2 log evidence of each, up to a constant, over the noise of the quietest: points, priors, planes and parts."""
    floor, totals = Floor.of(posteriors), list[float]()
    for fit in posteriors:
        found, price, parts = explained_costs(fit, floor, asides)
        totals.append(float(found.sum()) + price + sum(cost for cost, _ in parts))
    return totals


def hidden(posterior: Posterior) -> BoolArray:
    """(N,) explained points on planes, of whose four neighbours two or more lie on another plane, clearly apart."""
    plane, neighbours = posterior.points.plane_index, posterior.measured.neighbours
    if len(posterior.pose.planes) < 2 or not neighbours.size:
        return np.zeros(len(plane), dtype=np.bool_)
    there = (plane != FREE) & (posterior.fit.robust_weights > 0).all(axis=0)
    rows, which = np.nonzero(there[:, None] & there[neighbours] & (plane[neighbours] != plane[:, None]))
    points, n = posterior.points.select(rows), posterior.pose.planes
    apart = n[plane[neighbours[rows, which]]] - n[points.plane_index]
    # A disparity rho moves what the projector sees by about |t - y t3| / depth: its noise is that of a ray over it.
    t, x, y = posterior.pose.t, points.camera_rays, points.projector_rays
    parallax = np.maximum(np.hypot(t[0] - y[:, 0] * t[2], t[1] - y[:, 1] * t[2]), 1e-12)
    sigma = np.hypot(points.camera_sigma, points.projector_sigma) * posterior.fit.along_noise.total / parallax
    foreign = np.abs(x[:, 0] * apart[:, 0] + x[:, 1] * apart[:, 1] + apart[:, 2]) > APART * sigma
    return np.bincount(rows[foreign], minlength=len(plane)) >= 3
