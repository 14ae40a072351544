"""The twin poses that the planes allow, each refined on all points, and which of them the points support."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from retrue.errors import DegenerateError
from retrue.geometry.arrays import FloatArray, IntArray
from retrue.geometry.planar_pose import PlanarPose, planar_pose_candidates, twin_pose
from retrue.geometry.robust_homography import local_noise
from retrue.geometry.transform import direction_angle, rotation_angle
from retrue.geometry.two_view import FREE, TwoViewPoints, TwoViewPose, planes_of_pose
from retrue.recalibration.evidence import share_behind
from retrue.recalibration.fit import CUTOFF, PoseFit, chi_square, evaluate, gather, picture_blocks, refine
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.planes import split_planes
from retrue.recalibration.prepare import Rays

COMPARED_POINTS = 4000  # enough to tell the twins apart; the chosen one is then refined on all
GATHERED_POINTS = 1500  # enough to bring a start near
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


def compare_candidates(rays: Rays, homographies: list[FloatArray], rng: np.random.Generator) -> Comparison:
    """Refine the twins of the largest planes on all points, and order them by what the points say.

    Before refining, the wrong twin can look the better one; so nothing is compared before. Raises
    DegenerateError where no plane gives a pose.
    """
    rays = rays.thinned(COMPARED_POINTS, rng)
    points, blocks = rays.points, picture_blocks(rays.points.camera_rays, rays.capture)
    few = rays.thinned(GATHERED_POINTS, rng).points
    fits: list[PoseFit] = []
    for start in _starts(points, homographies):
        try:
            near = gather(start, few)
            if not any(same_pose(near, fit.pose) for fit in fits):
                fits.append(refine(near, points, blocks, iterations=3))
        except DegenerateError:
            continue
    fits = [fit for fit in fits if share_behind(fit, points) <= MOSTLY] or fits  # a mirrored pose is no rival
    if not fits:
        raise DegenerateError("pose: no plane determines it; turn the plane, or move it further to the side")
    reference = min(fits, key=lambda fit: float(fit.epipolar_noise.variance.mean()))
    first = min(fits, key=lambda fit: float(_point_chi_square(fit, reference).sum()))
    rivals = [fit for fit in fits if not same_pose(fit.pose, first.pose)]
    rivals += _twins(first, points, blocks, homographies)  # as it stands: refining may lead it away, or back
    if not rivals:
        return Comparison(rays, (first,), 0.0, 0.0, 0)
    return min((_compared(rays, first, rival) for rival in rivals), key=lambda found: found.margin)


def _compared(rays: Rays, first: PoseFit, rival: PoseFit) -> Comparison:
    """What prefers the first: points off the plane that the rival fits, because that plane fits both."""
    points = rays.points
    near = np.abs(rival.found.along) < CUTOFF * first.along_noise.level  # not by its own, wider noise
    fitted = points.plane_index[rival.found.rows[near]]
    if len(fitted) == 0:  # it was led away: the plane that it came from tells nothing all the same
        fitted = points.plane_index[points.plane_index != FREE]
    own_plane = int(np.argmax(np.bincount(fitted)))
    off = points.plane_index != own_plane
    preferred = _point_chi_square(rival, first) - _point_chi_square(first, first)
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


def _twins(fit: PoseFit, points: TwoViewPoints, blocks: IntArray, homographies: list[FloatArray]) -> list[PoseFit]:
    """The twin of a refined pose on its largest plane, not refined: that would only lead back."""
    planes = points.plane_index[points.plane_index != FREE]
    largest = int(np.argmax(np.bincount(planes)))
    n = fit.pose.planes[largest]
    length = float(np.linalg.norm(n))
    x = [*points.camera_rays[points.plane_index == largest].mean(axis=0), 1.0]
    try:
        start = _start(twin_pose(PlanarPose(fit.pose.R, fit.pose.t * length, n / length), x), homographies)
    except DegenerateError:
        return []
    return [] if same_pose(start, fit.pose) else [evaluate(start, points, blocks)]


def _point_chi_square(fit: PoseFit, reference: PoseFit) -> FloatArray:
    """(N,) both residuals of each point."""
    epipolar, along = chi_square(fit, reference)
    epipolar[fit.found.rows] += along
    return epipolar
