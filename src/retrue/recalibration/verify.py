"""Does a capture still fit a rig? Nothing is changed; the answer is good, drifted or unknown.

The epipolar residual alone cannot say: about some axes a wrong rotation hardly moves it, because the
points trade it for depth. So the capture is asked for the pose that it supports by itself, and that is compared
with the rig's, in the sigma of the difference.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from retrue.correspondences import Correspondences, require_captures
from retrue.errors import DegenerateError, InputError, require_kind
from retrue.geometry.arrays import FloatArray, finite_array
from retrue.geometry.transform import RigidTransform, direction_angle, vector_from_rotation
from retrue.geometry.two_view import POSE_PARAMETERS, TwoViewPose, epipolar_residuals, tangent_basis
from retrue.ranges import check_ranges, ranged
from retrue.rasters import check_captures
from retrue.recalibration.candidates import Estimate, estimate_pose
from retrue.recalibration.fit import PoseFit, Support, refine
from retrue.recalibration.judge import Choice, choose_twin, imprecision, inconsistency, supporting_rays
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.rays import Rays
from retrue.recalibration.reasons import Imprecise, Reason, reason_of
from retrue.recalibration.result import Verification, change, rms, sigma_at, working_distance
from retrue.recalibration.uncertainty import systematic_covariance
from retrue.rig import Rig, require_rig


@dataclass(frozen=True, slots=True)
class VerifyOptions:
    """Limits of `verify`.

    Attributes
    ----------
    false_alarms
        Share of good rigs that may be called drifted.
    rig_sigma_rotation_deg
        How well a rig knows its own rotation, per axis, where its evidence states no covariance.
    rig_sigma_translation_deg
        Likewise for the direction of t.
    max_sigma_rotation_deg
        A capture that knows the rotation no better than this says "unknown" rather than "good".
    max_sigma_translation_deg
        Likewise for the direction of t.
    estimate
        Limits of the estimate itself.
    """

    false_alarms: float = ranged(1e-3, 0, 1)
    rig_sigma_rotation_deg: float = ranged(0.02, 0, 180)
    rig_sigma_translation_deg: float = ranged(0.05, 0, 180)
    max_sigma_rotation_deg: float = ranged(0.25, 0, 180)
    max_sigma_translation_deg: float = ranged(1.5, 0, 180)
    estimate: RecalibrateOptions = field(default_factory=RecalibrateOptions)

    def __post_init__(self) -> None:
        check_ranges(self)


def verify(rig: Rig, captures: Sequence[Correspondences], options: VerifyOptions | None = None) -> Verification:
    """Compare the rig's pose with the one that the captures support by themselves.

    The statistic is d^T C^-1 d, chi-square with five degrees of freedom for a rig that still holds: d is the
    difference in rotation and direction of t, C the covariance of the capture's pose, of the rig's own (where its
    evidence gives one), and what uncertain intrinsics do to the pose.

    Parameters
    ----------
    rig, captures : as in `recalibrate`.

    Raises InputError where there are no captures, CaptureError where their rasters are not the rig's.
    """
    require_rig(rig)
    require_captures(captures)
    check_captures(rig, captures)
    options = options or VerifyOptions()
    require_kind(options, VerifyOptions, "options")
    total = sum(len(capture) for capture in captures)
    try:
        return _verify(rig, captures, total, options)
    except DegenerateError as error:
        return Verification("unknown", str(error), None, total, cause=reason_of(error))


def _verify(rig: Rig, captures: Sequence[Correspondences], total: int, options: VerifyOptions) -> Verification:
    estimate = estimate_pose(rig, captures, options.estimate)
    rays = supporting_rays(estimate, options.estimate)
    choice = choose_twin(estimate.comparison, rig.projector_from_camera, options.estimate)
    fit = _supported_fit(rig, estimate, choice, rays)
    old = rig.projector_from_camera
    epipolar_rms = rms(epipolar_residuals(old, rays.points)[fit.explained])
    difference = pose_difference(fit.pose, old)
    covariance = (
        fit.covariance + systematic_covariance(rig, rays.points, fit, options.estimate) + _rig_covariance(rig, options)
    )
    distance = float(np.sqrt(difference @ np.linalg.solve(covariance, difference)))
    supported = RigidTransform(fit.pose.R, fit.pose.t * np.linalg.norm(old.t))
    depth = working_distance(fit, rays.points, float(np.linalg.norm(old.t)))
    found = change(rig, supported, depth)
    uncertainty = sigma_at(depth, covariance, fit.pose, rig)

    def verdict(word: Literal["good", "drifted", "unknown"], says: str | Reason) -> Verification:
        cause = says if isinstance(says, Reason) else None
        return Verification(
            word,
            str(says),
            epipolar_rms,
            total,
            found,
            distance,
            uncertainty,
            working_distance=depth,
            cause=cause,
            supported_pose=supported,
        )

    # A covariance that is too wide is beyond the reach of its linearisation: no drift can be read from it either.
    cause = inconsistency(fit, rays, estimate, options.estimate) or imprecision(fit, uncertainty, options.estimate)
    if cause is not None:
        return verdict("unknown", cause)
    moved = f"{found.rotation_deg:.3f} deg in rotation, {found.translation_deg:.3f} deg in the direction of t"
    if depth is not None and found.displacement is not None:
        moved += f", {round(found.displacement, 9):.4g} {rig.unit} for points at {depth:.4g} {rig.unit}"
    limit = _distance_limit(options.false_alarms)
    if distance > limit and isinstance(choice, Reason):  # it may have, or this is the twin of a rig that holds
        return verdict("unknown", choice)
    if distance > limit:
        return verdict("drifted", f"the capture supports another pose: {moved}, {distance:.1f} sigma; recalibrate")
    if not (
        distance <= limit
        and uncertainty.rotation_deg <= options.max_sigma_rotation_deg
        and uncertainty.translation_deg <= options.max_sigma_translation_deg
    ):
        return verdict("unknown", Imprecise(uncertainty.rotation_deg, uncertainty.translation_deg))
    return verdict("good", f"the capture supports the rig's pose: {moved}, {distance:.1f} sigma")


def pose_difference(pose: TwoViewPose, old: RigidTransform) -> FloatArray:
    """(5,) from the old pose to `pose`, in the frame of `pose_covariance`; an angle also where t is far off."""
    t = old.t / np.linalg.norm(old.t)
    across = tangent_basis(pose.t).T @ -t
    sine = float(np.linalg.norm(across))
    angle = float(np.arctan2(sine, pose.t @ t))
    if sine > 0:
        across = across * (angle / sine)
    return np.concatenate([vector_from_rotation(pose.R @ old.R.T), across])


def _supported_fit(rig: Rig, estimate: Estimate, choice: Choice | Reason, rays: Rays) -> PoseFit:
    """The pose of the captures on all points: the resolved candidate, else the one nearer to the rig."""
    fits = estimate.comparison.fits
    old = rig.projector_from_camera.t
    chosen = (
        fits[choice.index] if isinstance(choice, Choice) else min(fits, key=lambda f: direction_angle(f.pose.t, old))
    )
    return refine(chosen.pose, Support.of(rays), iterations=2)


def _rig_covariance(rig: Rig, options: VerifyOptions) -> FloatArray:
    """(5, 5) of the rig's own pose: what its evidence states, else what is usual."""
    stated = rig.evidence.get("covariance")
    if stated is None:
        rotation, translation = np.radians([options.rig_sigma_rotation_deg, options.rig_sigma_translation_deg])
        return np.diag([rotation**2] * 3 + [translation**2] * 2)
    covariance = finite_array(stated, (POSE_PARAMETERS, POSE_PARAMETERS), "rig evidence, covariance")
    if not np.linalg.eigvalsh(covariance)[0] >= -1e-12 * np.abs(covariance).max():
        raise InputError("rig evidence, covariance: expected a covariance, found negative eigenvalues")
    return covariance


def _distance_limit(false_alarms: float) -> float:
    from scipy.special import chdtri

    return float(np.sqrt(chdtri(POSE_PARAMETERS, false_alarms)))
