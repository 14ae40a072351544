"""Points, or captures, of another pose than the answer's: those that share one are set aside, and named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from retrue.errors import DegenerateError
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.five_points import best_essentials, poses_of_essential, sampson_squares
from retrue.geometry.robust import CUTOFF, biweight_level, quantile
from retrue.geometry.transform import skew
from retrue.geometry.two_view import FREE, POSE_PARAMETERS, TwoViewPoints, TwoViewPose, epipolar_residuals
from retrue.kernels import triangulation as kernel
from retrue.recalibration.candidates import behind
from retrue.recalibration.chance import FAR
from retrue.recalibration.fit import gather
from retrue.recalibration.posterior import Measured, Posterior

FEWEST_OF_A_PART = 15
A_COPY, IN_A_MIRROR, ELSEWHERE = "a shifted copy", "points in a mirror", "elsewhere"
MOST_COPIES = 3
STRIPS, MOST_SAMPLES = 4, 180
MOST_ASKED = 4  # hypotheses
ALIKE = 0.1  # of the points
SHARE_OF_A_PART = 0.3  # of the unexplained points; five free choices among wrong matches bring few together
LOUD = 1.5  # times the noise that a plane by itself leaves: a pose that explains what does not belong together
MUCH_LOUDER = 3.0  # likewise, of a plane that belongs to another pose; real lenses make it twice as loud
MOST_OF_A_PLANE = 0.5  # of its points, that the pose explains though the plane belongs to another


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Points that share another explanation than the pose.

    A reflected scene has an essential matrix of its own, what moved has one, too; a plane has its homography.

    Attributes
    ----------
    rows : (N,) which.
    parameters : how many free ones it has.
    missed : (rows, 1 or 2) residuals that it leaves, across the epipolar line or both, in the points' own sigma.
    level : their noise.
    essential, reach, lens : its essential matrix (3, 3), where it has one, how far from it points agree, and the change
        of lenses (8,) through which it was found.
    seldom : the share of its points that are of the rarer kind: of a copy, those that outnumber what it is a copy of.
    seen_through : whether the pose explains most of it, though it lies between the points of what it is a copy of.
    """

    name: str
    rows: BoolArray
    parameters: int
    missed: FloatArray
    level: float
    essential: FloatArray | None = None
    reach: float = 0.0
    lens: FloatArray | None = None
    seldom: float = 1.0
    seen_through: bool = False

    @property
    def count(self) -> int:
        """How many they are."""
        return int(np.count_nonzero(self.rows))


def agreeing(posterior: Posterior) -> BoolArray:
    """(N,) points on their epipolar lines, also those that are set aside."""
    missed = epipolar_residuals(posterior.pose, posterior.points)
    return np.abs(missed) < CUTOFF * posterior.fit.epipolar_noise.total


def agreeing_with_both(posterior: Posterior, parts: Sequence[Part | None]) -> BoolArray:
    """(N,) points set aside as some of another pose that agree with this one, too: they contradict neither."""
    rows = [part.rows for part in parts if part is not None and part.essential is not None]
    return agreeing(posterior) & np.any([np.zeros(len(posterior.points), dtype=np.bool_), *rows], axis=0)


def homography_residuals(points: TwoViewPoints, homographies: Sequence[FloatArray]) -> FloatArray:
    """(N, 2) what the homography of each point's plane leaves by itself, in the point's own sigma; NaN on none."""
    missed = np.empty((len(points), 2))
    stack = np.array(homographies, dtype=np.float64).reshape(-1, 3, 3)
    rays = np.ascontiguousarray(points.camera_rays), np.ascontiguousarray(points.projector_rays)
    sigmas = np.ascontiguousarray(points.camera_sigma), np.ascontiguousarray(points.projector_sigma)
    kernel.missed(stack, np.ascontiguousarray(points.plane_index), *rays, *sigmas, missed)
    return missed


def plane_around(plane: IntArray, neighbours: IntArray) -> IntArray:
    """(N,) the plane that three of four neighbours (N, 4) of a point share; FREE where they share none."""
    around = np.sort(plane[neighbours], axis=1)  # three of four alike: those in the middle are, and one beside them
    first, shared, third, last = around.T
    return np.where((shared == third) & ((shared == first) | (shared == last)), shared, FREE)


def noise_of_planes(
    points: TwoViewPoints, homographies: Sequence[FloatArray], neighbours: IntArray, levels: Sequence[float]
) -> BoolArray:
    """(N,) points off all planes that may be the noise of one: it has their neighbours, and they are not far from it.

    A surface shows more than one of its points, and what is bent leaves its neighbours' plane little by little; noise
    has long tails, often along one axis. `neighbours` (N, 4) are the nearest points; `levels`, how loud each plane is.
    """
    plane, loud = points.plane_index, np.array(levels)
    found = np.zeros(len(plane), dtype=np.bool_)
    if not (len(homographies) and neighbours.size):
        return found
    rows = np.flatnonzero((plane == FREE) & ((own := plane_around(plane, neighbours)) != FREE))
    missed = homography_residuals(replace(points, plane_index=np.where(plane == FREE, own, plane)), homographies)
    beside = neighbours[rows]
    there = (plane[beside] == own[rows, None])[..., None]
    around_it = np.where(there, missed[beside], 0.0).sum(axis=1) / there.sum(axis=1)
    distance, alone = np.hypot(*missed[rows].T), np.hypot(*(missed[rows] - around_it).T)
    found[rows] = (distance < FAR * loud[own[rows]]) & (alone > CUTOFF * loud[own[rows]])
    return found


def plane_levels(measured: Measured) -> list[float]:
    """Noise that the homography of each plane leaves by itself."""
    plane = measured.support.points.plane_index
    planes = range(int(plane.max(initial=FREE)) + 1)
    return [biweight_level(measured.homography_residuals[plane == index].ravel()) for index in planes]


def planes_apart(posterior: Posterior) -> dict[int, Part]:
    """Planes that the pose does not explain, by number: each still has its homography, and what that misses them by."""
    plane, missed = posterior.points.plane_index, posterior.measured.homography_residuals
    found = dict[int, Part]()
    for index in range(len(posterior.pose.planes) if len(missed) else 0):
        members = plane == index
        rows = members & (posterior.unexplained | ~(posterior.fit.robust_weights[1] > 0))
        own = level_of(missed[members]) if members.any() else np.inf
        many = np.count_nonzero(rows) > max(FEWEST_OF_A_PART, (1 - MOST_OF_A_PLANE) * np.count_nonzero(members))
        if many or biweight_level(posterior.fit.found.along[members]) > MUCH_LOUDER * own:
            found[index] = Part("a plane of its own", members, 8, missed[members], own)
    return found


def other_part(posterior: Posterior, outside: BoolArray, rng: np.random.Generator) -> Part | None:
    """The unexplained points that share another pose, where they are more than chance brings together.

    With them those that agree with both poses, unless they lie on a plane that the answer explains.
    """
    rows = np.flatnonzero(outside)
    if len(rows) < FEWEST_OF_A_PART:
        return None
    points = posterior.points.select(rows)
    noise = float(quantile(sigma_of(points), 0.5) * posterior.fit.epipolar_noise.total)
    scored = rng.permutation(len(rows))[:600]
    across, down = (np.argsort(axis) for axis in points.camera_rays.T)

    def draw(count: int) -> IntArray:  # a part holds together: from a strip of the picture, upright or lying
        strip = max(5, len(rows) // STRIPS)
        start = rng.integers(0, len(rows) - strip + 1, (count, 1))
        places = start + rng.integers(0, strip, (count, 5))
        upright = np.arange(count)[:, None] % 2 == 0
        return np.where(upright, across[places], down[places]).astype(np.int64)

    found = best_essentials(points.camera_rays, points.projector_rays, [noise], draw, scored, MOST_SAMPLES)
    if not found:
        return None
    agree = sampson_squares(found[0], points.camera_rays, points.projector_rays) < (3 * noise) ** 2
    E = _of_all(found[0], points.select(agree))
    agree = sampson_squares(E, points.camera_rays, points.projector_rays) < (3 * noise) ** 2
    if np.count_nonzero(agree) < max(FEWEST_OF_A_PART, SHARE_OF_A_PART * len(rows)):
        return None
    return part_of_essential(posterior, outside, E, 3 * noise)


def _of_all(E: FloatArray, points: TwoViewPoints) -> FloatArray:
    """The essential matrix (3, 3) of all those points, from that of five of them."""
    anywhere = replace(points, plane_index=np.full(len(points), FREE))
    try:
        pose = gather(TwoViewPose(*poses_of_essential(E)[0]), anywhere)
    except DegenerateError:
        return E
    return skew(pose.t) @ pose.R


def other_parts(posteriors: Sequence[Posterior], rng: np.random.Generator) -> list[Part]:
    """Those of each quiet hypothesis that leaves other points unexplained than those before it."""
    found: list[Part] = []
    asked: list[BoolArray] = []
    quiet = LOUD * min((posterior.fit.epipolar_noise.level for posterior in posteriors), default=0.0)
    for posterior in posteriors[:MOST_ASKED]:
        if posterior.fit.epipolar_noise.level > quiet:
            continue
        copies = [part.rows for part in posterior.parts if part.name == A_COPY]  # they have an explanation
        outside = posterior.unexplained & ~np.any(copies, axis=0) if copies else posterior.unexplained
        if any(np.count_nonzero(outside & ~known) < ALIKE * np.count_nonzero(outside) for known in asked):
            continue
        asked.append(outside)
        part = other_part(posterior, outside, rng)
        if part is not None:
            found.append(part)
    return found


def most_unexplained(parts: Sequence[Part], posterior: Posterior) -> Part | None:
    """The largest part that is not of the hypothesis itself."""
    return max((part for part in parts if of_another_pose(part, posterior)), key=lambda one: one.count, default=None)


def part_of_essential(
    posterior: Posterior, outside: BoolArray, E: FloatArray, reach: float, lens: FloatArray | None = None
) -> Part:
    """The points that agree with E (3, 3) to within `reach`, and do not lie on a plane that the pose explains.

    Through the posterior's lenses, or those (8,) through which E was found.
    """
    lens = posterior.parameters.lens if lens is None else lens
    points = posterior.measured.seen(lens)
    loose = outside | (points.plane_index == FREE) | ~(posterior.fit.robust_weights[1] > 0)
    squares = sampson_squares(E, points.camera_rays, points.projector_rays)
    rows = loose & (squares < reach**2)
    missed: FloatArray = np.sqrt(squares[rows, None]) / sigma_of(points.select(rows))[:, None]
    level = max(posterior.fit.epipolar_noise.level, level_of(missed))
    return Part("another pose", rows, POSE_PARAMETERS, missed, level, E, reach, lens)


def set_aside(measured: Measured, part: Part) -> Measured:
    """The same without the points of that part: they stay in their rows and leave no residual."""
    return replace(measured, aside=part.rows if measured.aside is None else part.rows | measured.aside)


def parts_apart(posterior: Posterior, part: Part | None) -> list[Part]:
    """What the pose does not explain, though it has an explanation: planes, and those of `part` among all points."""
    found = [*posterior.planes_apart.values()]
    if part is not None and part.essential is not None:
        same = part_of_essential(posterior, posterior.unexplained, part.essential, part.reach, part.lens)
        found += [same] if of_another_pose(same, posterior) else []
    return found


def belongs_to(posterior: Posterior, part: Part) -> bool:
    """Whether the pose explains most of that part, which is then none beside it but its own."""
    return 2 * int(np.count_nonzero(part.rows & ~posterior.unexplained)) > part.count


def of_another_pose(part: Part, posterior: Posterior) -> bool:
    """Whether it is a part of what is unexplained, larger than chance makes: else its pose is the hypothesis' own.

    Or the one with t the other way, which has all that is before the devices on its lines, but behind them.
    """
    outside = posterior.unexplained
    fewest = max(FEWEST_OF_A_PART, SHARE_OF_A_PART * int(np.count_nonzero(outside)))
    level = posterior.fit.epipolar_noise.level
    turned = outside & agreeing(posterior) & behind(posterior.pose, posterior.points, level)
    return int(np.count_nonzero(part.rows & outside & ~turned)) >= fewest


def sigma_of(points: TwoViewPoints) -> FloatArray:
    """(N,) of each match, in the unit of the rays."""
    return np.hypot(points.camera_sigma, points.projector_sigma)


def level_of(missed: FloatArray) -> float:
    return biweight_level(missed.ravel())
