"""Poses that the captures allow: those of planes, of five points, and the old one, each refined on all points."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from retrue.errors import DegenerateError
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray, mean_point
from retrue.geometry.five_points import best_essentials, poses_of_essential
from retrue.geometry.planar_pose import PlanarPose, planar_pose_candidates, twin_pose
from retrue.geometry.robust import CUTOFF, quantile
from retrue.geometry.robust_homography import HYPOTHESES, MOST_HYPOTHESES, largest_plane, local_noise
from retrue.geometry.two_view import (
    FREE,
    TwoViewPoints,
    TwoViewPose,
    behind,
    planes_of_pose,
)
from retrue.recalibration.fit import PoseFit, Support, gather, refine, same_pose
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.rays import Rays
from retrue.recalibration.reasons import PointsNotSpread, TooFewPoints, Undecidable
from retrue.rig import Rig

PLANARITY_PX = 0.25  # how far a real board or wall is off a plane, at least, in projector pixels
GATHERED_POINTS = 500  # enough to bring a start near
STARTING_PLANES = 3
FOREMOST = 4  # hypotheses that are fitted with their lenses; the others explain much less
SCORED_POINTS = 500
MOST = 0.5  # of the points: a pose that fewer share may be held together by planes
SEARCHES = 6  # with each noise, of poses that planes do not lead
FEWEST_FREE = 30  # points off all planes, below which five points tell nothing that planes do not


def check_spread(rays: Rays, options: RecalibrateOptions) -> None:
    """Undecidable where there are too few points, or all on a line."""
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
    low, high = np.linalg.eigvalsh(np.cov(np.ascontiguousarray(points.T)))
    return float(np.sqrt(max(high, 0.0))), float(np.sqrt(max(low, 0.0)))


def with_planes(
    rays: Rays,
    rig: Rig,
    options: RecalibrateOptions,
    rng: np.random.Generator,
    turned: BoolArray | None = None,
) -> tuple[Rays, list[FloatArray]]:
    """Split the planes off each capture; indices run on from one capture to the next, largest first within each.

    Rows (N,) that are `turned`, as a mirror shows them, lie on none. The noise about a plane is of both devices: one
    pixel of the camera is, from afar, f_projector / f_camera of the projector. Where neighbours do not tell it, and
    none is found at the least that it may be, the most is tried.
    """
    camera_focal_px, projector_focal_px = float(rig.camera.K[0, 0]), float(rig.projector.K[0, 0])
    loudest_px = options.max_noise_px * float(np.hypot(1, projector_focal_px / camera_focal_px))
    limits: dict[str, Any] = {"min_points": options.min_points, "max_planes": options.max_planes, "rng": rng}
    plane_index = np.full(len(rays), FREE)
    homographies: list[FloatArray] = []
    points = rays.points
    for capture in range(int(rays.capture.max(initial=-1)) + 1):
        of_it = rays.capture == capture
        mine = np.flatnonzero(of_it if turned is None else of_it & ~turned)
        if len(mine) < options.min_points:
            continue
        x, y = (np.take(seen, mine, axis=0) for seen in (points.camera_rays, points.projector_rays))
        told_px = max(2 * local_noise(x, y, rng) * projector_focal_px, PLANARITY_PX)
        found, index = split_planes(x, y, min(told_px, options.max_noise_px) / projector_focal_px, **limits)
        if not found and told_px > options.max_noise_px:
            found, index = split_planes(x, y, min(told_px, loudest_px) / projector_focal_px, **limits)
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
        x, y = (np.take(seen, left, axis=0) for seen in (camera_rays, projector_rays))
        found = largest_plane(x, y, noise, fewest, rng, thorough)
        if found is None and not homographies:  # where most neighbours are wrong, noise is less than they say
            noise /= 2
            apart = rng.spawn(1)[0]  # scenes without planes draw what they did
            found = largest_plane(camera_rays, projector_rays, noise, fewest, apart, thorough)
        if found is None:
            break
        plane_index[left[found.inliers]] = len(homographies)
        homographies.append(found.homography)
        left = left[~found.inliers]
    return homographies, plane_index


def starting_poses(
    points: TwoViewPoints, homographies: list[FloatArray], old: TwoViewPose, noise: float, rng: np.random.Generator
) -> list[TwoViewPose]:
    """Both poses of each large plane, the old one, and the best of five points, with all planes seen from each.

    Parameters
    ----------
    points : of all captures, with their planes.
    homographies : of the planes.
    old : where the rig was.
    noise : of a match, in the unit of the rays.
    """
    starts = [pose for _, pose in twins_of_planes(points, homographies)]
    starts.append(_seen(old.R, old.t, homographies))
    free = np.flatnonzero(points.plane_index == FREE)
    if len(free) >= FEWEST_FREE:
        starts += of_five_points(points, free, homographies, noise, rng)
    return starts


def twins_of_planes(points: TwoViewPoints, homographies: list[FloatArray]) -> list[tuple[int, TwoViewPose]]:
    """Both poses of each large plane, with that plane's number; all planes seen from each."""
    counts = np.bincount(points.plane_index[points.plane_index != FREE], minlength=len(homographies))
    found: list[tuple[int, TwoViewPose]] = []
    largest: list[int] = np.argsort(-counts)[:STARTING_PLANES].tolist()
    for plane in largest:
        rays = np.take(points.camera_rays, np.flatnonzero(points.plane_index == plane), axis=0)
        try:
            twins = planar_pose_candidates(homographies[plane], [*mean_point(rays), 1.0])
        except DegenerateError:
            continue
        found += [(plane, _seen(pose.R, pose.translation_over_distance, homographies)) for pose in twins]
    return found


def of_five_points(
    points: TwoViewPoints, free: IntArray, homographies: list[FloatArray], noise: float, rng: np.random.Generator
) -> list[TwoViewPose]:
    """The best of samples from everywhere, half of each off all planes, with points in front of both devices."""

    def draw(count: int) -> IntArray:
        rows = rng.integers(0, len(points), (count, 5))
        rows[::2, :3] = free[rng.integers(0, len(free), (len(rows[::2]), 3))]  # wrong matches lie off all planes, too
        return rows

    scored = rng.choice(len(points), min(SCORED_POINTS, len(points)), replace=False)
    nominal = quantile(np.hypot(points.camera_sigma, points.projector_sigma), 0.5)
    noises = [noise]
    while noises[-1] > 0.3 * nominal:  # what is wrong may lie near, and make neighbours look noisy
        noises.append(noises[-1] / 3)
    few, found = points.select(scored), list[TwoViewPose]()
    for E in best_essentials(points.camera_rays, points.projector_rays, noises, draw, scored):
        poses = [TwoViewPose(R, t) for R, t in poses_of_essential(E)]
        best = max(poses, key=lambda pose: -np.count_nonzero(behind(pose, few, 1.0)))
        found.append(_seen(best.R, best.t, homographies))
    return found


def poses_of_no_plane(
    support: Support, homographies: list[FloatArray], noises: tuple[float, float], rng: np.random.Generator
) -> list[TwoViewPose]:
    """The foremost of many samples of five points, refined as if no point lay on a plane; all planes seen from each.

    What is curved or wrong may pass for planes, and lead every other start away; `noises` are of a match, as
    `match_noise` has them. None where the points determine no such pose.
    """
    points = replace(support.points, plane_index=np.full(len(support.points), FREE))
    everywhere, starts = np.arange(len(points)), list[TwoViewPose]()
    for noise in noises * SEARCHES:
        starts += of_five_points(points, everywhere, [], noise, rng)
    try:
        fits = refined_poses(starts, replace(support, points=points), rng)
    except DegenerateError:
        return []
    return [_seen(fit.pose.R, fit.pose.t, homographies) for fit in foremost(fits, points)]


def refined_poses(starts: list[TwoViewPose], support: Support, rng: np.random.Generator) -> list[PoseFit]:
    """Each start gathered on few points, then refined on all; the same pose once.

    Raises DegenerateError where no start is left.
    """
    few = points = support.points
    if len(points) > GATHERED_POINTS:
        few = points.select(np.sort(rng.choice(len(points), GATHERED_POINTS, replace=False)))
    gathered: list[TwoViewPose] = []
    fits: list[PoseFit] = []
    for start in starts:
        try:
            near = gather(start, few, gathered)
            if not any(same_pose(near, pose) for pose in gathered):
                gathered.append(near)
                fits.append(refine(near, support, iterations=1))
        except DegenerateError:
            continue
    if not fits:
        raise DegenerateError("pose: the points do not determine it; show more of a scene, or have a plane in view")
    return fits


def foremost(fits: list[PoseFit], points: TwoViewPoints) -> list[PoseFit]:
    """The few that explain the most points."""
    level = min(fit.epipolar_noise.level for fit in fits)

    def unexplained(fit: PoseFit) -> int:
        wrong = ~(np.abs(fit.found.epipolar) < CUTOFF * level)
        return int(np.count_nonzero(wrong | behind(fit.pose, points, level)))

    return sorted(fits, key=unexplained)[:FOREMOST]


def twins_of(pose: TwoViewPose, points: TwoViewPoints) -> list[TwoViewPose]:
    """The twin of a pose on each of its planes, the other planes where that twin has them."""
    found: list[TwoViewPose] = []
    homographies = [pose.R + pose.t[:, None] * n for n in pose.planes]
    for plane, n in enumerate(pose.planes):
        mine = points.plane_index == plane
        length = float(np.linalg.norm(n))
        if not (mine.any() and length > 0):
            continue
        x = [*mean_point(points.camera_rays[mine]), 1.0]
        try:
            twin = twin_pose(PlanarPose(pose.R, pose.t * length, n / length), x)
        except DegenerateError:
            continue
        seen = _seen(twin.R, twin.translation_over_distance, homographies)
        if not any(same_pose(seen, other) for other in (pose, *found)):
            found.append(seen)
    return found


def match_noise(points: TwoViewPoints, rng: np.random.Generator) -> tuple[float, float]:
    """Noise of a match in the unit of the rays that starts allow for, and what neighbours say of it.

    It is not below a share of what the points say of themselves.
    """
    nominal = quantile(np.hypot(points.camera_sigma, points.projector_sigma), 0.5)
    local = local_noise(points.camera_rays, points.projector_rays, rng)
    return max(2 * local, 0.3 * nominal), local


def _seen(R: FloatArray, t: FloatArray, homographies: list[FloatArray]) -> TwoViewPose:
    t = t / np.linalg.norm(t)
    return TwoViewPose(R, t, planes_of_pose(R, t, homographies))
