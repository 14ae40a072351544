"""Decide from the evidence: which twin, and whether the answer is to be trusted. NaN refuses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.geometry.arrays import FloatArray
from retrue.geometry.transform import direction_angle
from retrue.geometry.two_view import FREE
from retrue.recalibration.candidates import Comparison
from retrue.recalibration.estimate import Estimate
from retrue.recalibration.evidence import sigma
from retrue.recalibration.fit import PoseFit
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.prepare import Rays
from retrue.recalibration.result import Evidence
from retrue.recalibration.systematic import focal_change

FOLD_DEG = 2.0  # t so near the plane's normal that no covariance holds
FOCAL_SIGMAS = 4.0  # beyond which a changed focal length is believed


@dataclass(frozen=True, slots=True)
class Choice:
    """Which candidate, and what settled it; `index` is None where nothing did."""

    index: int | None
    resolved_by: str


def twin_is_resolved(comparison: Comparison, options: RecalibrateOptions) -> bool:
    """Whether the points off the plane settle which twin it is."""
    return comparison.margin >= options.twin_margin and comparison.deviations >= options.twin_deviations


def choose_twin(comparison: Comparison, old_t: FloatArray, options: RecalibrateOptions) -> Choice:
    """Points off the plane first, the old direction of t where there are too few, else no choice.

    The old direction counts by the odds of two drifts, normally distributed per axis with `prior_drift_deg`.
    """
    if len(comparison.fits) == 1:
        return Choice(0, "the twins coincide")
    if twin_is_resolved(comparison, options):
        return Choice(0, f"{comparison.off_plane} points off the plane (chi-square margin {comparison.margin:.0f})")
    angles = np.degrees([direction_angle(fit.pose.t, old_t) for fit in comparison.fits])
    nearest = int(np.argmin(angles))
    near, far = float(angles[nearest]), float(angles[1 - nearest])
    log_odds = (far**2 - near**2) / (2 * options.prior_drift_deg**2)
    if near <= 3 * options.prior_drift_deg and log_odds >= np.log(options.prior_odds):
        return Choice(nearest, f"the old direction of t ({near:.1f} deg away, the twin {far:.1f} deg)")
    return Choice(
        None,
        f"two poses explain the plane, {near:.0f} and {far:.0f} deg from the old direction of t, and too little lies"
        " off the plane to tell them apart; put an object or a second plane in view",
    )


def supporting_rays(estimate: Estimate, options: RecalibrateOptions) -> Rays:
    """What the final fit rests on: all points, but only those on planes where the others told nothing.

    Points off the plane that do not settle the twin are few, or wrong: those that happen to agree would pull
    the pose where the plane holds it least.
    """
    if twin_is_resolved(estimate.comparison, options):
        return estimate.rays
    return estimate.rays.select(estimate.rays.points.plane_index != FREE)


def inconsistency(fit: PoseFit, rays: Rays, estimate: Estimate, options: RecalibrateOptions) -> str | None:
    """Why the correspondences do not belong to one pose at all; None where they do."""
    share = np.count_nonzero(fit.explained) / len(estimate.rays)
    if not (share >= 1 - options.max_outliers and fit.epipolar_noise.level <= options.max_noise_px):
        return (
            f"{share:.0%} of the correspondences agree with one pose, to {fit.epipolar_noise.level:.2g} px; expected"
            f" {1 - options.max_outliers:.0%} or more, to {options.max_noise_px:g} px: was something moving, have the"
            " intrinsics changed, or is it another rig's picture?"
        )
    if not fit.epipolar_noise.shared <= options.max_structure_px:
        return (
            f"neighbouring residuals share {fit.epipolar_noise.shared:.2g} px that no pose explains; have the"
            " intrinsics changed (zoom, focus)? then calibrate anew"
        )
    for index in range(len(fit.pose.planes)):
        mine = rays.points.plane_index == index
        if not np.mean(fit.explained[mine]) >= 0.5:
            return (
                f"a plane with {np.count_nonzero(mine)} correspondences contradicts the pose of the others; was"
                " something moving, or are pictures of two poses mixed?"
            )
    for device in ("camera", "projector"):
        found = focal_change(rays.points, fit, device)
        told = not found.sigma >= options.max_focal_change / 2  # a single plane takes up any focal length
        if told and not abs(found.amount) <= max(options.max_focal_change, FOCAL_SIGMAS * found.sigma):
            return (
                f"the points ask for a focal length of the {device} that is {found.amount:+.1%} off"
                f" (sigma {found.sigma:.1%}); was it zoomed or refocused? then calibrate anew"
            )
    return None


def objection(
    fit: PoseFit, rays: Rays, estimate: Estimate, evidence: Evidence, options: RecalibrateOptions
) -> str | None:
    """Why a resolved pose is still not to be trusted, and what to do; None where nothing speaks against it."""
    own = sigma(fit.covariance)  # without the systematic part: what the points themselves determine
    if not (
        own.rotation_deg <= options.max_sigma_rotation_deg and own.translation_deg <= options.max_sigma_translation_deg
    ):
        return (
            f"the points know the pose only to {own.rotation_deg:.2g} deg in rotation and {own.translation_deg:.2g} deg"
            " in the direction of t; fill more of the picture, or add captures"
        )
    problem = inconsistency(fit, rays, estimate, options)
    if problem is not None:
        return problem
    if evidence.change is None or not (
        evidence.change.rotation_deg <= options.max_change_deg
        and evidence.change.translation_deg <= options.max_change_deg
    ):
        return (
            f"the pose would have changed by more than {options.max_change_deg:g} deg, which no bump does; is it this"
            " rig's picture? if it was rebuilt, allow for it with --max-change-deg"
        )
    if not twin_is_resolved(estimate.comparison, options):
        normals = fit.pose.planes / np.linalg.norm(fit.pose.planes, axis=1, keepdims=True)
        fold = min(
            (direction_angle(sign * fit.pose.t, fit.pose.R @ n) for n in normals for sign in (1, -1)), default=np.inf
        )
        if not np.degrees(fold) > FOLD_DEG:
            return (
                f"t is within {FOLD_DEG:g} deg of the plane's normal, where a plane does not determine it;"
                " turn the plane, or put objects in view"
            )
    return None
