"""What the captures themselves say of the pose, before anybody judges it.

Split off planes -> the twin poses that each allows -> refine each on all points -> compare them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from retrue.correspondences import Correspondences
from retrue.errors import DegenerateError
from retrue.geometry.arrays import FloatArray, IntArray
from retrue.geometry.planar_pose import PlanarPose, planar_pose_candidates, twin_pose
from retrue.geometry.robust import CUTOFF
from retrue.geometry.robust_homography import HYPOTHESES, MOST_HYPOTHESES, largest_plane, local_noise
from retrue.geometry.transform import direction_angle, rotation_angle
from retrue.geometry.two_view import FREE, TwoViewPoints, TwoViewPose, planes_of_pose
from retrue.recalibration.fit import PoseFit, Support, chi_square, evaluate, gather, refine
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.rays import Rays, rays_of_captures
from retrue.recalibration.reasons import NoPlane, PointsNotSpread, TooFewPoints, Undecidable
from retrue.recalibration.result import share_behind
from retrue.rig import Rig

COMPARED_POINTS = 4000  # enough to tell the twins apart; the chosen one is then refined on all
GATHERED_POINTS = 800  # enough to bring a start near
STARTING_PLANES = 3
MOSTLY = 0.5
SAME_POSE = np.radians(0.5)
PLANARITY_PX = 0.25  # how far a real board or wall is off a plane, at least, in projector pixels


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Both candidates on the same points.

    Attributes
    ----------
    rays : the points that the candidates were refined on, with the plane of each.
    fits : the best supported candidate and its strongest rival; a single one where the twins coincide.
    margin : by how much chi-square of the points off the second's plane, and of all points, prefers the first.
    deviations : the same off the plane in standard deviations of a sum over points that are there by chance.
    off_plane : number of points off that plane.
    """

    rays: Rays
    fits: tuple[PoseFit, ...]
    margin: float
    deviations: float
    off_plane: int


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """All rays, with the plane of each, and both candidates."""

    rays: Rays
    comparison: Comparison


def estimate_pose(rig: Rig, captures: Sequence[Correspondences], options: RecalibrateOptions) -> Estimate:
    """The pose and its strongest rival, from nothing but the captures and the intrinsics.

    Raises DegenerateError, with what to do, where there are too few points, no plane, or no pose.
    """
    rng = np.random.default_rng(options.seed)
    rays = rays_of_captures(rig, captures, options.max_points, rng)
    _check_spread(rays, options)
    rays, homographies = with_planes(rays, float(rig.projector.K[0, 0]), options, rng)
    if not homographies:
        raise Undecidable(NoPlane(len(rays)))
    return Estimate(rays, compare_candidates(rays, homographies, rng))


def with_planes(
    rays: Rays, projector_focal_px: float, options: RecalibrateOptions, rng: np.random.Generator
) -> tuple[Rays, list[FloatArray]]:
    """Split the planes off each capture; indices run on from one capture to the next, largest first within each."""
    plane_index = np.full(len(rays), FREE)
    homographies: list[FloatArray] = []
    points = rays.points
    for capture in range(int(rays.capture.max(initial=-1)) + 1):
        mine = np.flatnonzero(rays.capture == capture)
        if len(mine) < options.min_points:
            continue
        x, y = points.camera_rays[mine], points.projector_rays[mine]
        noise = np.clip(2 * local_noise(x, y, rng) * projector_focal_px, PLANARITY_PX, options.max_noise_px)
        noise = float(noise) / projector_focal_px
        found, index = split_planes(x, y, noise, min_points=options.min_points, max_planes=options.max_planes, rng=rng)
        plane_index[mine] = np.where(index == FREE, FREE, index + len(homographies))
        homographies += found
    return replace(rays, points=replace(points, plane_index=plane_index)), homographies


def split_planes(
    camera_rays: FloatArray,
    projector_rays: FloatArray,
    noise: float,
    *,
    min_points: int,
    max_planes: int,
    rng: np.random.Generator,
) -> tuple[list[FloatArray], IntArray]:
    """Homographies of the planes, largest first, and the plane of each point, `FREE` where on none.

    Parameters
    ----------
    camera_rays, projector_rays : (N, 2) normalised.
    noise : standard deviation per axis of a point about its plane, in normalised units of the projector.
    min_points : fewest points on a plane; a plane also holds a twentieth of the points, or it is chance.
    """
    plane_index = np.full(len(camera_rays), FREE)
    homographies: list[FloatArray] = []
    left = np.arange(len(camera_rays))
    fewest = max(min_points, len(camera_rays) // 20)
    while len(homographies) < max_planes and len(left) >= fewest:
        thorough = MOST_HYPOTHESES if not homographies else HYPOTHESES  # without a first plane there is no answer
        found = largest_plane(camera_rays[left], projector_rays[left], noise, fewest, rng, thorough)
        if found is None:
            break
        plane_index[left[found.inliers]] = len(homographies)
        homographies.append(found.homography)
        left = left[~found.inliers]
    return homographies, plane_index


def compare_candidates(rays: Rays, homographies: list[FloatArray], rng: np.random.Generator) -> Comparison:
    """Refine the twins of the largest planes on all points, and order them by what the points say.

    Before refining, the wrong twin can look the better one; so nothing is compared before. Raises
    DegenerateError where no plane gives a pose.
    """
    rays = rays.thinned(COMPARED_POINTS, rng)
    points, support = rays.points, Support.of(rays)
    few = rays.thinned(GATHERED_POINTS, rng).points
    fits: list[PoseFit] = []
    for start in _starts(points, homographies):
        try:
            near = gather(start, few)
            if not any(same_pose(near, fit.pose) for fit in fits):
                fits.append(refine(near, support, iterations=3))
        except DegenerateError:
            continue
    fits = [fit for fit in fits if share_behind(fit, points) <= MOSTLY] or fits  # a mirrored pose is no rival
    if not fits:
        raise DegenerateError("pose: no plane determines it; turn the plane, or move it further to the side")
    reference = min(fits, key=lambda fit: float(fit.epipolar_noise.variance.mean()))
    first = min(fits, key=lambda fit: float(chi_square(fit, reference).sum()))
    rivals = [fit for fit in fits if not same_pose(fit.pose, first.pose)]
    rivals += _twins(first, support, homographies)  # as it stands: refining may lead it away, or back
    if not rivals:
        return Comparison(rays, (first,), 0.0, 0.0, 0)
    return min((_compared(rays, first, rival) for rival in rivals), key=lambda found: found.margin)


def _compared(rays: Rays, first: PoseFit, rival: PoseFit) -> Comparison:
    """What prefers the first: points off the plane that the rival fits, because that plane fits both."""
    points = rays.points
    near = np.abs(rival.found.along) < CUTOFF * first.along_noise.level  # not by its own, wider noise
    fitted = points.plane_index[near]
    if len(fitted) == 0:  # it was led away: the plane that it came from tells nothing all the same
        fitted = points.plane_index[points.plane_index != FREE]
    own_plane = int(np.argmax(np.bincount(fitted)))
    off = points.plane_index != own_plane
    preferred = chi_square(rival, first) - chi_square(first, first)
    squares = float((preferred[off] ** 2).sum())
    margin = min(float(preferred[off].sum()), float(preferred.sum()))
    deviations = float(preferred[off].sum() / np.sqrt(squares)) if squares > 0 else 0.0
    return Comparison(rays, (first, rival), margin, deviations, int(np.count_nonzero(off)))


def same_pose(a: TwoViewPose, b: TwoViewPose) -> bool:
    """Whether two poses are one solution, found twice."""
    return rotation_angle(a.R @ b.R.T) < SAME_POSE and direction_angle(a.t, b.t) < SAME_POSE


def _starts(points: TwoViewPoints, homographies: list[FloatArray]) -> list[TwoViewPose]:
    """Twins of the planes with the most points, with all planes seen from each."""
    counts = [int(np.count_nonzero(points.plane_index == plane)) for plane in range(len(homographies))]
    starts: list[TwoViewPose] = []
    for plane in sorted(range(len(counts)), key=lambda plane: -counts[plane])[:STARTING_PLANES]:
        rays = points.camera_rays[points.plane_index == plane]
        try:
            twins = planar_pose_candidates(homographies[plane], [*rays.mean(axis=0), 1.0])
        except DegenerateError:
            continue
        starts += [_start(twin, homographies) for twin in twins]
    return starts


def _start(pose: PlanarPose, homographies: list[FloatArray]) -> TwoViewPose:
    t = pose.translation_over_distance / np.linalg.norm(pose.translation_over_distance)
    return TwoViewPose(pose.R, t, planes_of_pose(pose.R, t, homographies))


def _twins(fit: PoseFit, support: Support, homographies: list[FloatArray]) -> list[PoseFit]:
    """The twin of a refined pose on its largest plane, not refined: that would only lead back."""
    points = support.points
    planes = points.plane_index[points.plane_index != FREE]
    largest = int(np.argmax(np.bincount(planes)))
    n = fit.pose.planes[largest]
    length = float(np.linalg.norm(n))
    x = [*points.camera_rays[points.plane_index == largest].mean(axis=0), 1.0]
    try:
        start = _start(twin_pose(PlanarPose(fit.pose.R, fit.pose.t * length, n / length), x), homographies)
    except DegenerateError:
        return []
    return [] if same_pose(start, fit.pose) else [evaluate(start, support)]


def _check_spread(rays: Rays, options: RecalibrateOptions) -> None:
    if len(rays) < options.min_points:
        raise Undecidable(TooFewPoints(len(rays), options.min_points))
    for name, points in (("camera", rays.points.camera_rays), ("projector", rays.points.projector_rays)):
        largest, smallest = _spread(points)
        if not largest > 1e-9:
            raise Undecidable(PointsNotSpread(name, "place"))
        if not smallest > 1e-6 * largest:
            raise Undecidable(PointsNotSpread(name, "line"))


def _spread(points: FloatArray) -> tuple[float, float]:
    """Standard deviations along the widest and the narrowest direction."""
    centred = points - points.mean(axis=0)
    low, high = np.linalg.eigvalsh(centred.T @ centred / max(len(points) - 1, 1))
    return float(np.sqrt(max(high, 0.0))), float(np.sqrt(max(low, 0.0)))
