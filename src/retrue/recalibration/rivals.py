"""Other explanations of the captures, and by how much log evidence the best one beats each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from math import hypot, log, log1p

import numpy as np

from retrue.correspondences import Correspondences
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.nearest import nearest_of_all
from retrue.geometry.robust import CUTOFF, Noise, biweight_level, biweight_loss
from retrue.geometry.transform import direction_angle, rotation_angle
from retrue.geometry.two_view import FREE, TwoViewPose
from retrue.recalibration.candidates import same_pose, twins_of
from retrue.recalibration.chance import CHANCE, beyond_chance
from retrue.recalibration.light import light_costs, log_irradiance
from retrue.recalibration.measured import MISFIT_PX
from retrue.recalibration.parts import A_COPY, Part, of_another_pose
from retrue.recalibration.posterior import Measured, Posterior, posterior_at, same_answer
from retrue.recalibration.rays import Rays
from retrue.rig import Rig

UNEXPLAINED = 12.0  # of chi-square: what a point costs that a hypothesis does not explain, or has hidden or behind
NEAREST_DEG = 1.0  # a move below this is none: nearer to the old pose says no more
LIGHT_TRUST = 2.0  # of neighbours' own likelihood, who tell more of slow changes than as many pairs alone would
LIGHT_MATTERS = 300.0  # nats of points and move: what light alone does not turn
PARAMETER = 12.0  # of chi-square, what a free parameter costs: its range is some 400 times what the points leave
FEWEST_OF_A_PLANE = 12
SELDOM = 1.7  # of chi-square, 2 log(.7 / .3): a point of a copy, a mirror, or what moved, is the rarer one
RARE = 18.0  # of chi-square, 2 log 8000: so few captures have a copy, where a plane more is nothing strange
ROUGH = 0.3  # of chi-square: what bows and lenses that no model holds make of a point on a plane
APART = 10.0  # times the noise: nearer to the line where two planes meet, either may claim a point


@dataclass(frozen=True, slots=True, eq=False)
class Rival:
    """Another explanation of the captures, and by how much the answer beats it.

    Attributes
    ----------
    name : what it is.
    posterior : its own.
    points, light, move : log evidence (nats) for the answer: of the points, of the light, of how far each is from the
        old pose.
    """

    name: str
    posterior: Posterior
    points: float
    light: float
    move: float

    @property
    def margin(self) -> float:
        """Log evidence for the answer, all in all."""
        return self.points + self.light + self.move


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


def has_copies(posterior: Posterior) -> bool:
    """Whether some points are explained so much better as a copy of a plane that it is worth its price."""
    floor = Floor.of([posterior])
    found = costs(posterior, floor)

    def gain(copy: Part) -> float:
        explained = _costs_of_part(copy, posterior, floor, anywhere_along(copy, posterior))
        return float(np.maximum(found[copy.rows] - explained, 0.0).sum())

    return any(gain(part) > price_of(part) for part in posterior.parts if part.name == A_COPY)


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
    explained = part.seldom * SELDOM - along
    if part.missed.shape[1] == 1:
        explained = explained + np.where(posterior.points.plane_index[part.rows] != FREE, UNEXPLAINED, 0.0)
    families = zip(part.missed.T, posterior.fit.noises, (floor.across, floor.along), strict=False)
    for missed, noise, least in families:
        quietest, level = hypot(least.level, MISFIT_PX), hypot(part.level, MISFIT_PX)
        if part.level < least.level:  # it gains nothing by that: what real lenses leave over is as large a share of it
            level = part.level * quietest / least.level
        louder = 2 * max(log(max(level, hypot(noise.level, MISFIT_PX)) / quietest), 0.0)
        explained = explained + np.minimum(biweight_loss(missed / level) + louder, UNEXPLAINED)
    return explained


def least(posteriors: list[Posterior], asides: Sequence[Part] = ()) -> Posterior:
    """The posterior of least cost; of those that its sigma holds, the one that the lenses as they are fit best."""
    if len(posteriors) == 1:
        return posteriors[0]
    best = _least(posteriors, [fit.eased for fit in posteriors], asides)
    alike = [fit for fit in posteriors if fit is best or same_answer(best, fit.pose)]
    return best if len(alike) == 1 else _least(alike, alike, asides)


def _least(posteriors: list[Posterior], judged: list[Posterior], asides: Sequence[Part]) -> Posterior:
    return posteriors[int(np.argmin(total_costs(judged, asides)))]


def total_costs(posteriors: Sequence[Posterior], asides: Sequence[Part] = ()) -> list[float]:
    """-2 log evidence of each, up to a constant, over the noise of the quietest: points, priors, planes and parts."""
    floor, totals = Floor.of(posteriors), list[float]()
    for fit in posteriors:
        found, price, parts = explained_costs(fit, floor, asides)
        totals.append(float(found.sum()) + price + sum(cost for cost, _ in parts))
    return totals


def nearest_points(rays: Rays) -> IntArray:
    """(N, 4) rows of each point's nearest neighbours in its own capture's picture; its own row for lack of any."""
    found = np.repeat(np.arange(len(rays))[:, None], 4, axis=1)
    for capture in range(int(rays.capture.max(initial=-1)) + 1):
        mine = np.flatnonzero(rays.capture == capture)
        if len(mine) > 4:
            x = rays.points.camera_rays[mine]
            found[mine] = mine[nearest_of_all(x, x, 5)[1][:, 1:]]
    return found


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


def ranked(
    posteriors: list[Posterior],
    measured: Measured,
    few: Rays,
    light: Light | None,
    old: TwoViewPose,
    asides: Sequence[Part],
    rng: np.random.Generator,
) -> tuple[Posterior, tuple[Rival, ...]]:
    """The hypothesis that none other beats in evidence, and those others; its twins are among them, as they stand.

    `asides` are of other poses, whichever hypothesis is right.
    """
    best, beaten = least(posteriors, asides), list[tuple[float, Posterior, tuple[Rival, ...]]]()
    while True:
        rivals = rivals_of(best, posteriors, measured, few, light, old, asides, rng)
        strongest = min(rivals, key=lambda rival: rival.margin, default=None)
        if strongest is None or not strongest.margin < 0:
            return best, rivals
        beaten.append((strongest.margin, best, rivals))
        best = strongest.posterior
        alike = [fit for fit in posteriors if same_answer(best, fit.pose)]
        if alike and not any(best is fit for fit in posteriors):  # a twin as it stands, which was also fitted
            best = _least(alike, alike, asides)
        if any(best is one for _, one, _ in beaten):  # each beats another in turn: the one that is beaten by least
            return max(beaten, key=lambda one: one[0])[1:]


def rivals_of(
    best: Posterior,
    posteriors: list[Posterior],
    measured: Measured,
    few: Rays,
    light: Light | None,
    old: TwoViewPose,
    asides: Sequence[Part],
    rng: np.random.Generator,
) -> tuple[Rival, ...]:
    """The strongest at each pose, the best one's twins among them."""
    others = [("another pose", fit, fit.eased) for fit in posteriors if not same_answer(best, fit.pose)]
    # One that eases into the best is that, and stands as it is.
    others = [(name, fit, fit if same_answer(best, eased.pose) else eased) for name, fit, eased in others]
    for twin in twins_of(best.pose, best.points):
        if not (same_answer(best, twin) or any(same_pose(twin, fit.pose) for _, fit, _ in others)):
            fit = posterior_at(measured, replace(best.parameters, pose=twin), best.prior)
            others.append(("the twin", fit, fit))
    moved = move_nats(move_deg(best.pose, old))
    found = [
        Rival(name, fit, _point_evidence(best, fit, eased, asides), 0.0, move_nats(move_deg(fit.pose, old)) - moved)
        for name, fit, eased in others
    ]
    near = [index for index, rival in enumerate(found) if rival.margin < LIGHT_MATTERS]
    if light is not None and near:
        seen = light.evidence(best, [found[index].posterior for index in near], few, rng)
        for index, nats in zip(near, seen, strict=True):
            found[index] = replace(found[index], light=nats)
    return _strongest_of_each_pose(found)


def _strongest_of_each_pose(rivals: list[Rival]) -> tuple[Rival, ...]:
    """A pose that was fitted with and without a part of the points is one rival."""
    kept: list[Rival] = []
    for rival in sorted(rivals, key=lambda one: one.margin):
        if not any(same_pose(rival.posterior.pose, other.posterior.pose) for other in kept):
            kept.append(rival)
    return tuple(kept)


def _point_evidence(best: Posterior, rival: Posterior, eased: Posterior, asides: Sequence[Part]) -> float:
    """Nats, of the points and of what has to be taken for a part of its own.

    A sum that a few points make, as chance would have it, counts less. Of a plane that both fit, the difference counts
    that is larger than what no model explains of a real wall, nor a slow error that one of them takes for a bow. Points
    that are parts in both tell neither, but for what these parts cost. Parts cost what they cost; those that have few
    points off that plane, no more than they gain over the other.
    """
    shared, floor = _shared_plane(best, rival), Floor.of([best, rival])
    explained = cache(partial(explained_costs, asides=asides))  # hardly any is eased: most are asked for twice or more
    lost, price, parts = _cheapest([explained(fit, floor) for fit in (rival, eased)], ~shared)
    held, own_price, own_parts = _cheapest([explained(fit, floor) for fit in (best, best.eased)], ~shared)
    given, own = (np.any([np.zeros_like(shared), *(rows for _, rows in one)], axis=0) for one in (parts, own_parts))
    elsewhere = (lost - held)[~(shared | given & own)]
    counts = beyond_chance(elsewhere)
    told = float(elsewhere.sum()) * counts + min(price - own_price, 0.0)
    gained = np.where(shared, 0.0, counts * (held - lost))
    told += sum(_counted(cost, rows & ~shared, np.where(own, 0.0, gained)[rows]) for cost, rows in parts)
    told -= sum(_counted(cost, rows & ~shared, np.where(given, 0.0, -gained)[rows]) for cost, rows in own_parts)
    if shared.any():  # lenses may follow what is slow, or be what makes it: of both, what tells less
        pairs = dict.fromkeys([(best, rival), (best.eased, eased)])  # one, where none is eased
        told += min((_of_shared(*pair, explained, shared) for pair in pairs), key=abs)
    return 0.5 * told


def _counted(price: float, given: BoolArray, gained: FloatArray) -> float:
    """What a part of the points `given` (N,) costs: of so few that chance makes it, no more than it gains."""
    return price if np.count_nonzero(given) >= CHANCE**2 else min(price, max(float(gained.sum()), 0.0))


def _of_shared(
    best: Posterior, rival: Posterior, explained: Callable[[Posterior, Floor], Explained], shared: BoolArray
) -> float:
    floor = Floor.of([best, rival])
    lost, held = (explained(fit, floor)[0] for fit in (rival, best))
    mean = float((lost - held)[shared].mean())
    unheld = ROUGH + _slow(rival if mean > 0 else best)
    return np.count_nonzero(shared) * float(np.sign(mean)) * max(abs(mean) - unheld, 0.0)


def _cheapest(found: list[Explained], rows: BoolArray) -> Explained:
    """Of a pose as it is and eased, which costs less at those rows (N,)."""
    return min(found, key=lambda one: float(one[0][rows].sum()) + one[1] + sum(cost for cost, _ in one[2]))


def _slow(posterior: Posterior) -> float:
    """By how much the part of its noise that neighbours share raises the cost of each point."""
    noises = posterior.fit.epipolar_noise, posterior.fit.along_noise
    return sum(log1p(noise.shared**2 / noise.level**2) for noise in noises)


def _shared_plane(best: Posterior, rival: Posterior) -> BoolArray:
    """(N,) points of the plane that both fit, if there is one: twins do."""
    plane = rival.points.plane_index
    near = plane != FREE
    for values, noise in zip(rival.fit.found.both, (best.fit.epipolar_noise, best.fit.along_noise), strict=True):
        near = near & (np.abs(values) < CUTOFF * noise.level)
    if not near.any():
        return near
    shared = plane == int(np.argmax(np.bincount(plane[near])))
    if np.count_nonzero(near & shared) * 2 < np.count_nonzero(shared):
        return np.zeros_like(near)
    return shared & ~rival.impossible


def move_deg(pose: TwoViewPose, old: TwoViewPose) -> float:
    """How far a pose is from the old one: the angles of the rotation and of the direction of t together."""
    return float(np.degrees(np.hypot(rotation_angle(pose.R @ old.R.T), direction_angle(pose.t, old.t))))


def move_nats(degrees: float) -> float:
    """-log prior of a move: moves of any size alike, so that its density falls with the fifth power of the size."""
    return 5 * float(np.log(max(degrees, NEAREST_DEG)))


def plane_levels(measured: Measured) -> list[float]:
    """Noise that the homography of each plane leaves by itself."""
    plane = measured.support.points.plane_index
    planes = range(int(plane.max(initial=FREE)) + 1)
    return [biweight_level(measured.homography_residuals[plane == index].ravel()) for index in planes]


@dataclass(frozen=True, slots=True, eq=False)
class Light:
    """What the projector adds at each ray, (N,); its class; the place in the projector's raster, (N, 2)."""

    light: FloatArray
    light_class: IntArray
    raster: FloatArray

    def evidence(self, best: Posterior, others: list[Posterior], few: Rays, rng: np.random.Generator) -> list[float]:
        """Nats that the light gives the best hypothesis over each other, of the points on planes."""
        points, plane = few.points, few.points.plane_index
        found = np.zeros(len(others))
        for capture in range(int(few.capture.max(initial=-1)) + 1):
            mine = (plane != FREE) & (best.fit.robust_weights[1] > 0) & (few.capture == capture)
            for index, other in enumerate(others):  # of what only one of the two explains, light tells nothing
                rows = np.flatnonzero(mine & (other.fit.robust_weights[1] > 0))
                predictions = [
                    log_irradiance(points.projector_rays[rows], fit.pose.R, fit.pose.t, fit.pose.planes[plane[rows]])
                    for fit in (best, other)
                ]
                where = points.camera_rays[rows], self.raster[rows]
                light_cost = light_costs(self.light[rows], self.light_class[rows], *where, predictions, rng)
                if light_cost is not None:
                    found[index] += 0.5 * LIGHT_TRUST * (light_cost[1] - light_cost[0])
        return found.tolist()


def light_of(rig: Rig, captures: Sequence[Correspondences], rays: Rays) -> Light | None:
    """What the captures say of the projector's light at each ray; None where none says anything."""
    if all(capture.light is None for capture in captures):
        return None
    light, light_class = np.full(len(rays), np.nan), np.zeros(len(rays), dtype=np.int64)
    raster = np.zeros((len(rays), 2))
    for index, capture in enumerate(captures):
        mine = np.flatnonzero(rays.capture == index)
        raster[mine] = 2 * (capture.projector_px[rays.row[mine]] + 0.5) / np.array(rig.projector.size) - 1
        if capture.light is not None:
            light[mine] = capture.light[rays.row[mine]]
        if capture.light_class is not None:
            light_class[mine] = capture.light_class[rays.row[mine]]
    return Light(light, light_class, raster)
