"""Points, or captures, of another pose than the answer's: those that share one are set aside, and named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from retrue.errors import DegenerateError
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.five_points import best_essentials, sampson_squares
from retrue.geometry.robust import CUTOFF, biweight_level, within_reach_of_mode
from retrue.geometry.two_view import FREE, POSE_PARAMETERS, TwoViewPoints
from retrue.recalibration.candidates import behind
from retrue.recalibration.fit import squared_sigmas
from retrue.recalibration.posterior import Measured, Posterior, fit_posterior
from retrue.recalibration.rays import Rays

FEWEST_OF_A_PART = 15
IN_A_MIRROR = "points in a mirror"
STRIPS, MOST_SAMPLES = 4, 180
CENTRES = 50  # shifts to look for others about
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
    essential, reach : its essential matrix (3, 3), where it has one, and how far from it points agree.
    seldom : the share of its points that are of the rarer kind: of a copy, those that outnumber what it is a copy of.
    """

    name: str
    rows: BoolArray
    parameters: int
    missed: FloatArray
    level: float
    essential: FloatArray | None = None
    reach: float = 0.0
    seldom: float = 1.0

    @property
    def count(self) -> int:
        """How many they are."""
        return int(np.count_nonzero(self.rows))


def unexplained(posterior: Posterior) -> BoolArray:
    """(N,) points that the pose does not explain."""
    noise = posterior.fit.epipolar_noise
    level = float(np.hypot(noise.level, noise.shared))
    wrong = ~(np.abs(posterior.fit.found.epipolar) < CUTOFF * level)
    return wrong | behind(posterior.pose, posterior.points, level)


def homography_residuals(points: TwoViewPoints, homographies: Sequence[FloatArray]) -> FloatArray:
    """(N, 2) what the homography of each point's plane leaves by itself, in the point's own sigma; NaN on none."""
    missed = np.full((len(points), 2), np.nan)
    for index, H in enumerate(homographies):
        mine = points.plane_index == index
        x = np.column_stack([points.camera_rays[mine], np.ones(np.count_nonzero(mine))]) @ H.T
        magnified = np.sqrt(np.abs(np.linalg.det(H) / x[:, 2] ** 3))
        sigma = np.hypot(points.camera_sigma[mine] * magnified, points.projector_sigma[mine])
        missed[mine] = (points.projector_rays[mine] - x[:, :2] / x[:, 2:]) / sigma[:, None]
    return missed


def planes_apart(posterior: Posterior, outside: BoolArray, missed: FloatArray) -> list[Part]:
    """Planes that the pose does not explain: each still has its homography, and what that misses its points by."""
    plane = posterior.points.plane_index
    found: list[Part] = []
    for index in range(len(posterior.pose.planes)):
        members = plane == index
        rows = members & (outside | ~(posterior.fit.robust_weights[1] > 0))
        own = _level(missed[members]) if members.any() else np.inf
        many = np.count_nonzero(rows) > max(FEWEST_OF_A_PART, (1 - MOST_OF_A_PLANE) * np.count_nonzero(members))
        if many or biweight_level(posterior.fit.found.along[members]) > MUCH_LOUDER * own:
            found.append(Part("a plane of its own", members, 8, missed[members], own))
    return found


def shifted_copy(posterior: Posterior, outside: BoolArray) -> Part | None:
    """Unexplained points that one shift, in either picture, puts where a plane has them; None where no many are.

    Repeated texture, or a code that repeats, makes such matches. The shift, of pixels, is the mode of what the points
    ask for.
    """
    points, pose, measured = posterior.points, posterior.pose, posterior.measured
    rows = np.flatnonzero(outside)
    fewest = max(FEWEST_OF_A_PART, int(SHARE_OF_A_PART * len(rows)))
    if len(rows) < fewest or not len(pose.planes):
        return None
    camera, projector = measured.rig.camera, measured.rig.projector
    sigma = np.hypot(points.camera_sigma * camera.K[0, 0], points.projector_sigma * projector.K[0, 0])[rows]
    along = posterior.fit.along_noise
    noise = 4 * float(np.median(sigma) * np.hypot(along.level, along.shared))
    x = np.column_stack([points.camera_rays[rows], np.ones(len(rows))])
    y = np.column_stack([points.projector_rays[rows], np.ones(len(rows))])
    best, shifted, copied = None, np.empty((0, 2)), 0
    for index, n in enumerate(pose.planes):
        H: FloatArray = pose.R + pose.t[:, None] * n
        with np.errstate(all="ignore"):
            back = y @ np.asarray(np.linalg.inv(H), dtype=np.float64).T
            shifts = (
                measured.projector_px[rows] - projector.project(x @ H.T),
                measured.camera_px[rows] - camera.project(back),
            )
        for shift in shifts:
            mode = within_reach_of_mode(shift, CENTRES, noise)
            if not np.count_nonzero(mode) >= fewest or np.abs(np.median(shift[mode], axis=0)).max() < noise:
                continue  # what lies where the plane has it is no copy, and behind a device for another reason
            if best is None or np.count_nonzero(mode) > np.count_nonzero(best):
                best, shifted = mode, np.asarray(shift[mode], dtype=np.float64)
                copied = int(np.count_nonzero((points.plane_index == index) & ~outside))
    if best is None:
        return None
    copy = np.zeros(len(outside), dtype=np.bool_)
    copy[rows[best]] = True
    missed: FloatArray = (shifted - np.median(shifted, axis=0)) / sigma[best, None]
    more = max(0.0, 1 - copied / float(np.count_nonzero(copy)))
    return Part("a shifted copy", copy, 2, missed, _level(missed), seldom=more)


def other_part(posterior: Posterior, outside: BoolArray, rng: np.random.Generator) -> Part | None:
    """The unexplained points that share another pose, where they are more than chance brings together.

    With them those that agree with both poses, unless they lie on a plane that the answer explains.
    """
    rows = np.flatnonzero(outside)
    if len(rows) < FEWEST_OF_A_PART:
        return None
    points = posterior.points.select(rows)
    noise = _noise(points, np.hypot(posterior.fit.epipolar_noise.level, posterior.fit.epipolar_noise.shared))
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
    E = found[0]
    agree = sampson_squares(E, points.camera_rays, points.projector_rays) < (3 * noise) ** 2
    if np.count_nonzero(agree) < max(FEWEST_OF_A_PART, SHARE_OF_A_PART * len(rows)):
        return None
    return part_of_essential(posterior, outside, E, 3 * noise)


def other_parts(posteriors: Sequence[Posterior], rng: np.random.Generator) -> list[Part]:
    """Those of each quiet hypothesis that leaves other points unexplained than those before it."""
    found: list[Part] = []
    asked: list[BoolArray] = []
    quiet = LOUD * min(posterior.fit.epipolar_noise.level for posterior in posteriors)
    for posterior in posteriors[:MOST_ASKED]:
        if posterior.fit.epipolar_noise.level > quiet:
            continue
        outside = unexplained(posterior)
        if any(np.count_nonzero(outside & ~known) < ALIKE * np.count_nonzero(outside) for known in asked):
            continue
        asked.append(outside)
        part = other_part(posterior, outside, rng)
        if part is not None:
            found.append(part)
    return found


def most_unexplained(parts: Sequence[Part], posterior: Posterior) -> Part | None:
    """The largest part that is not of the hypothesis itself."""
    outside = unexplained(posterior)
    return max((part for part in parts if _of_another_pose(part, outside)), key=lambda one: one.count, default=None)


def part_of_essential(posterior: Posterior, outside: BoolArray, E: FloatArray, reach: float) -> Part:
    """The points that agree with E (3, 3) to within `reach`, and do not lie on a plane that the pose explains."""
    points = posterior.points
    loose = outside | (points.plane_index == FREE) | ~(posterior.fit.robust_weights[1] > 0)
    squares = sampson_squares(E, points.camera_rays, points.projector_rays)
    rows = loose & (squares < reach**2)
    missed: FloatArray = np.sqrt(squares[rows, None]) / _sigma(points.select(rows))[:, None]
    level = max(posterior.fit.epipolar_noise.level, _level(missed))
    return Part("another pose", rows, POSE_PARAMETERS, missed, level, E, reach)


def set_aside(measured: Measured, part: Part) -> Measured:
    """The same without the points of that part: they stay in their rows and leave no residual."""
    return replace(measured, aside=part.rows if measured.aside is None else part.rows | measured.aside)


def parts_apart(posterior: Posterior, part: Part | None, missed: FloatArray) -> list[Part]:
    """What the pose does not explain, though it has an explanation: planes, and those of `part` among all points."""
    outside = unexplained(posterior)
    found = planes_apart(posterior, outside, missed)
    if part is not None and part.essential is not None:
        same = part_of_essential(posterior, outside, part.essential, part.reach)
        found += [same] if _of_another_pose(same, outside) else []
    return found


def _of_another_pose(part: Part, outside: BoolArray) -> bool:
    """Whether most of a part is unexplained: else its pose is that of the hypothesis."""
    return int(np.count_nonzero(part.rows & outside)) > MOST_OF_A_PLANE * part.count


def differing_capture(measured: Measured, rays: Rays, answer: Posterior) -> tuple[int, float] | None:
    """The capture whose own pose is furthest from the joint one, in its own sigma; None where there is only one.

    Infinitely far is one that was set aside whole: hardly a point of it agrees with the joint pose.
    """
    captures = int(rays.capture.max()) + 1
    if captures < 2:
        return None
    prior = replace(answer.prior, kept=None, together=None)  # each follows the lenses' errors in its own way
    furthest = (0, 0.0)
    for capture in range(captures):
        mine = rays.capture == capture
        if np.count_nonzero(mine & answer.fit.explained) < FEWEST_OF_A_PART <= np.count_nonzero(mine):
            return capture, np.inf
        part = replace(measured, aside=None).select(mine)  # all of them may be of another pose
        try:
            own = fit_posterior(part, answer.parameters, prior, 4)
            deviations = float(np.sqrt(squared_sigmas(answer.pose, own.pose, own.covariance)))
        except DegenerateError:  # it says nothing by itself
            continue
        if deviations > furthest[1]:
            furthest = capture, deviations
    return furthest


def _sigma(points: TwoViewPoints) -> FloatArray:
    """(N,) of each match, in the unit of the rays."""
    return np.hypot(points.camera_sigma, points.projector_sigma)


def _level(missed: FloatArray) -> float:
    return biweight_level(missed.ravel())


def _noise(points: TwoViewPoints, level: float) -> float:
    return float(np.median(_sigma(points))) * float(level)
