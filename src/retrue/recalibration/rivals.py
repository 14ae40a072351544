"""Other explanations of the captures, and by how much log evidence the best one beats each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from math import log1p

import numpy as np

from retrue.correspondences import Correspondences
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.nearest import nearest_of_all
from retrue.geometry.robust import CUTOFF
from retrue.geometry.transform import direction_angle, rotation_angle
from retrue.geometry.two_view import FREE, TwoViewPose
from retrue.recalibration.candidates import same_pose, twins_of
from retrue.recalibration.chance import CHANCE, beyond_chance
from retrue.recalibration.costs import Explained, Floor, explained_costs, least, least_costly, mean_cost_across
from retrue.recalibration.light import light_costs, log_irradiance
from retrue.recalibration.parts import Part
from retrue.recalibration.posterior import Measured, Posterior, posterior_at, same_answer
from retrue.recalibration.rays import Rays
from retrue.rig import Rig

NEAREST_DEG = 1.0  # a move below this is none: nearer to the old pose says no more
LIGHT_TRUST = 2.0  # of neighbours' own likelihood, who tell more of slow changes than as many pairs alone would
LIGHT_MATTERS = 300.0  # nats of points and move: what light alone does not turn
ROUGH = 0.3  # of chi-square: what bows and lenses that no model holds make of a point on a plane


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


def nearest_points(rays: Rays) -> IntArray:
    """(N, 4) rows of each point's nearest neighbours in its own capture's picture; its own row for lack of any."""
    found = np.repeat(np.arange(len(rays))[:, None], 4, axis=1)
    for capture in range(int(rays.capture.max(initial=-1)) + 1):
        mine = np.flatnonzero(rays.capture == capture)
        if len(mine) > 4:
            x = rays.points.camera_rays[mine]
            found[mine] = mine[nearest_of_all(x, x, 5)[1][:, 1:]]
    return found


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
            best = least_costly(alike, alike, asides)
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


def evidence_across(posterior: Posterior, other: Posterior) -> float:
    """Nats of points, across their epipolar lines, for one of two readings of the same captures.

    Counted is what is more than no model holds of a point.
    """
    fits = posterior.fit, other.fit
    least_noise = min(fit.epipolar_noise.level for fit in fits)
    own, others = (mean_cost_across(fit, least_noise) for fit in fits)
    count = min(len(posterior.points), len(other.points))
    return 0.5 * count * float(np.sign(others - own)) * max(abs(others - own) - ROUGH, 0.0)


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
