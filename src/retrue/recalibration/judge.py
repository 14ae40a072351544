"""Decide from the evidence: which twin, and whether the answer is to be trusted. NaN refuses.

Wrong matches contradict the pose each in its own way. Points that contradict it alike are a surface, seen with other
intrinsics or from another pose; and two planes that alternate all over the picture are one plane, seen from two poses.
Every limit is named in `RecalibrateOptions`, and every refusal is a type of its own in `reasons`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.robust import CUTOFF
from retrue.geometry.transform import RigidTransform, direction_angle, rotation_angle
from retrue.geometry.two_view import FREE, epipolar_residuals
from retrue.recalibration.candidates import Comparison, Estimate
from retrue.recalibration.fit import PoseFit
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.rays import Rays
from retrue.recalibration.reasons import (
    FocalLengthChanged,
    ImplausibleChange,
    Imprecise,
    NearFold,
    PlaneAndRestContradict,
    PlaneContradicts,
    PlanesInterleave,
    PointsBehind,
    PointsDisagree,
    Reason,
    ResidualsHaveStructure,
    SurfaceContradicts,
    TwinsUnresolved,
)
from retrue.recalibration.result import Evidence, PoseChange, PoseSigma, share_behind, sigma
from retrue.recalibration.uncertainty import FocalChange, focal_changes

CLEARLY_TURNED_DEG = 5.0
APART = 10.0  # times the noise: nearer to the line where two planes meet, either may claim a point
ENOUGH_POINTS = 2000
LARGE = 0.25  # share of a capture's points on planes
ALIKE = 0.25  # residuals of two neighbours, apart by less than this share of the larger
ALIKE_BY_CHANCE = 0.25  # share of independent ones that are; 1/8 where uniform
TOO_FAR = 2.2  # times the largest believable move: what the old direction of t rules out


@dataclass(frozen=True, slots=True)
class Choice:
    """Which candidate, and what settled it."""

    index: int
    resolved_by: str


def twin_is_resolved(comparison: Comparison, options: RecalibrateOptions) -> bool:
    """Whether the points off the plane settle which twin it is."""
    return comparison.margin >= options.twin_margin and comparison.deviations >= options.twin_deviations


def choose_twin(comparison: Comparison, old: RigidTransform, options: RecalibrateOptions) -> Choice | Reason:
    """By points off the plane; else by what lies behind a device; else by the old direction of t.

    The old direction decides only where one candidate is a believable move from it, the other much too far, and
    the old rotation does not speak clearly for the other.
    """
    if len(comparison.fits) == 1:
        return Choice(0, "the twins coincide")
    if twin_is_resolved(comparison, options):
        return Choice(0, f"{comparison.off_plane} points off the plane (chi-square margin {comparison.margin:.0f})")
    behind = [share_behind(fit, comparison.rays.points) for fit in comparison.fits]
    possible = [index for index, share in enumerate(behind) if share <= options.max_behind]
    if not possible:
        return PointsBehind(min(behind))
    if len(possible) == 1:
        return Choice(possible[0], f"cheirality (the twin has {max(behind):.0%} of the plane behind a device)")
    angles = np.degrees([direction_angle(fit.pose.t, old.t) for fit in comparison.fits])
    nearest = int(np.argmin(angles))
    near, far = float(angles[nearest]), float(angles[1 - nearest])
    turned = np.degrees([rotation_angle(fit.pose.R @ old.R.T) for fit in comparison.fits])
    contradicted = turned[nearest] > CLEARLY_TURNED_DEG and turned[1 - nearest] < turned[nearest] / 4
    believable = near <= options.max_unchecked_change_deg and far >= TOO_FAR * options.max_unchecked_change_deg
    if believable and not contradicted:
        return Choice(nearest, f"the old direction of t ({near:.1f} deg away, the twin {far:.1f} deg)")
    angle = min(_angle_to_fold(fit) for fit in comparison.fits)
    return TwinsUnresolved(near, far) if angle > options.min_fold_deg else NearFold(angle)


def supporting_rays(estimate: Estimate, options: RecalibrateOptions) -> Rays:
    """What the final fit rests on: all points, but only those on planes where the others told nothing.

    Points off the plane that do not settle the twin are few, or wrong: those that happen to agree would pull
    the pose where the plane holds it least.
    """
    if twin_is_resolved(estimate.comparison, options):
        return estimate.rays
    return estimate.rays.select(estimate.rays.points.plane_index != FREE)


def inconsistency(fit: PoseFit, rays: Rays, estimate: Estimate, options: RecalibrateOptions) -> Reason | None:
    """Why the correspondences do not belong to one pose at all; None where they do."""
    share = np.count_nonzero(fit.explained) / len(estimate.rays)
    level = float(np.maximum(fit.epipolar_noise.level, fit.along_noise.level))
    if not (share >= 1 - options.max_outliers and level <= options.max_noise_px):
        return PointsDisagree(share, 1 - options.max_outliers, level, options.max_noise_px)
    behind = share_behind(fit, rays.points)
    if not behind <= options.max_behind:
        return PointsBehind(behind)
    if not fit.epipolar_noise.shared <= options.max_structure_px:
        return ResidualsHaveStructure(fit.epipolar_noise.shared)
    for index in range(len(fit.pose.planes)):
        mine = rays.points.plane_index == index
        if not np.mean(fit.explained[mine]) >= 0.5:
            return PlaneContradicts(int(np.count_nonzero(mine)))
    share = interleaved_share(fit, rays)
    if not share <= options.max_interleaved:
        return PlanesInterleave(share)
    for device, found in focal_changes(rays.points, fit).items():
        limit = max(options.max_focal_change, options.focal_deviations * found.sigma)
        if _is_told(found, options) and not abs(found.amount) <= limit:
            return FocalLengthChanged(device, found.amount, found.sigma)
    comparison = estimate.comparison
    if comparison.margin <= -options.twin_margin and comparison.deviations <= -options.twin_deviations:
        return PlaneAndRestContradict(comparison.off_plane)
    share = contradicting_share(fit, estimate.rays)
    if not share <= options.max_contradicting:
        return SurfaceContradicts(share)
    return None


def _checks_intrinsics(fit: PoseFit, rays: Rays, options: RecalibrateOptions) -> bool:
    return all(_is_told(found, options) for found in focal_changes(rays.points, fit).values())


def _is_told(found: FocalChange, options: RecalibrateOptions) -> bool:
    return not found.sigma >= options.max_focal_change / 4  # a single plane takes up any focal length


def imprecision(fit: PoseFit, total: PoseSigma | None, options: RecalibrateOptions) -> Imprecise | None:
    """Whether the points determine the pose too poorly for a linearised covariance to hold.

    The limits are for what the points themselves say; with the systematic part in `total`, it may be twice that.
    """
    for known, factor in ((sigma(fit.covariance), 1), (total, 2)):
        if known is not None and not (
            known.rotation_deg <= factor * options.max_sigma_rotation_deg
            and known.translation_deg <= factor * options.max_sigma_translation_deg
        ):
            return Imprecise(known.rotation_deg, known.translation_deg)
    return None


def objection(
    fit: PoseFit, rays: Rays, estimate: Estimate, evidence: Evidence, options: RecalibrateOptions
) -> Reason | None:
    """Why a resolved pose is still not to be trusted; None where nothing speaks against it."""
    change = evidence.change
    reason = imprecision(fit, evidence.sigma, options) or inconsistency(fit, rays, estimate, options)
    if reason is not None:
        return reason
    if change is not None and not _is_within(change, options.max_change_deg):
        return ImplausibleChange(change.rotation_deg, change.translation_deg, options.max_change_deg, True)
    limit = options.max_unchecked_change_deg
    if change is not None and not _is_within(change, limit) and not _checks_intrinsics(fit, rays, options):
        return ImplausibleChange(change.rotation_deg, change.translation_deg, limit, False)
    if not twin_is_resolved(estimate.comparison, options):
        angle = _angle_to_fold(fit)
        if not angle > options.min_fold_deg:
            return NearFold(angle)
    return None


def _is_within(change: PoseChange, limit_deg: float) -> bool:
    return change.rotation_deg <= limit_deg and change.translation_deg <= limit_deg


def _angle_to_fold(fit: PoseFit) -> float:
    """Degrees between t and the nearest normal of a plane, either way round."""
    normals = fit.pose.planes / np.linalg.norm(fit.pose.planes, axis=1, keepdims=True)
    angles = [direction_angle(sign * fit.pose.t, fit.pose.R @ n) for n in normals for sign in (1, -1)]
    return float(np.degrees(min(angles, default=np.inf)))


def contradicting_share(fit: PoseFit, rays: Rays) -> float:
    """Share of all points that contradict the pose, and as their neighbours among such points do."""
    step = max(1, len(rays) // ENOUGH_POINTS)
    points, capture = rays.points.select(slice(None, None, step)), rays.capture[::step]
    residual = epipolar_residuals(fit.pose, points)
    wrong = ~(np.abs(residual) < CUTOFF * float(np.hypot(fit.epipolar_noise.level, fit.epipolar_noise.shared)))
    alike = 0
    for index in range(int(capture.max(initial=-1)) + 1):
        mine = np.flatnonzero(wrong & (capture == index))
        if len(mine) < 2:
            continue
        r, other = residual[mine], residual[mine][_nearest(points.camera_rays[mine])]
        alike += int(np.count_nonzero(np.abs(r - other) < ALIKE * np.maximum(np.abs(r), np.abs(other))))
    excess = (alike - ALIKE_BY_CHANCE * np.count_nonzero(wrong)) / (1 - ALIKE_BY_CHANCE)
    return max(float(excess), 0.0) / max(len(points), 1)


def interleaved_share(fit: PoseFit, rays: Rays) -> float:
    """Share of the points on large planes whose nearest neighbour lies on another one, clearly apart from theirs there.

    Surfaces meet along lines, so that few points have such a neighbour; each plane of a mixture is everywhere.
    """
    rows = np.flatnonzero(rays.points.plane_index != FREE)
    rows = rows[:: max(1, len(rows) // ENOUGH_POINTS)]
    foreign = counted = 0
    for capture in range(int(rays.capture.max(initial=-1)) + 1):
        mine = rows[rays.capture[rows] == capture]
        mine = mine[_on_large_planes(rays.points.plane_index[mine])]
        if len(mine) < 2:
            continue
        x = rays.points.camera_rays[mine]
        plane = rays.points.plane_index[mine]
        if (plane == plane[0]).all():  # there is no other one
            counted += len(mine)
            continue
        other = plane[_nearest(x)]
        apart: BoolArray = _apart(fit, x, plane, other) > APART * _noise(fit, rays, mine)
        foreign += int(np.count_nonzero((other != plane) & apart))
        counted += len(mine)
    return foreign / max(counted, 1)


def _on_large_planes(plane: IntArray) -> BoolArray:
    """(N,) points of planes with a quarter of all: a mixture has two of them, scattered points none."""
    counts = np.bincount(plane)
    return counts[plane] >= LARGE * len(plane)


def _nearest(x: FloatArray) -> IntArray:
    """(N,) row of each point's nearest neighbour."""
    from scipy.spatial import KDTree

    return cast(IntArray, KDTree(x).query(x, 2)[1])[:, 1]


def _apart(fit: PoseFit, x: FloatArray, plane: IntArray, other: IntArray) -> FloatArray:
    """(N,) how far apart the projector rays to the two planes are, along one camera ray."""
    rays = np.column_stack([x, np.ones(len(x))])
    first, second = (_seen(fit, rays, (rays * fit.pose.planes[index]).sum(axis=1)) for index in (plane, other))
    return np.linalg.norm(first - second, axis=1)


def _seen(fit: PoseFit, rays: FloatArray, disparity: FloatArray) -> FloatArray:
    points = rays @ fit.pose.R.T + disparity[:, None] * fit.pose.t
    return points[:, :2] / points[:, 2:]


def _noise(fit: PoseFit, rays: Rays, rows: IntArray) -> FloatArray:
    """(N,) noise of a point in the projector, in the unit of its rays."""
    sigma = np.hypot(rays.points.camera_sigma[rows], rays.points.projector_sigma[rows])
    return sigma * float(np.hypot(fit.along_noise.level, fit.along_noise.shared))
