"""Decide from the evidence: which twin, and whether the answer is to be trusted. NaN refuses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.geometry.arrays import FloatArray
from retrue.geometry.transform import direction_angle
from retrue.recalibration.candidates import Comparison
from retrue.recalibration.fit import PoseFit
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.result import Evidence

FOLD_DEG = 2.0  # t so near the plane's normal that no covariance holds


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


def inconsistency(fit: PoseFit, options: RecalibrateOptions) -> str | None:
    """Why the correspondences do not belong to one pose at all; None where they do."""
    share = float(np.mean(fit.explained))
    if not (share >= 1 - options.max_outliers and fit.epipolar_noise.level <= options.max_noise_px):
        return (
            f"{share:.0%} of the correspondences agree with one pose, to {fit.epipolar_noise.level:.2g} px; expected"
            f" {1 - options.max_outliers:.0%} or more, to {options.max_noise_px:g} px: was something moving, have the"
            " intrinsics changed, or is it another rig's picture?"
        )
    return None


def objection(fit: PoseFit, evidence: Evidence, comparison: Comparison, options: RecalibrateOptions) -> str | None:
    """Why a resolved pose is still not to be trusted, and what to do; None where nothing speaks against it."""
    if evidence.sigma is None or not (
        evidence.sigma.rotation_deg <= options.max_sigma_rotation_deg
        and evidence.sigma.translation_deg <= options.max_sigma_translation_deg
    ):
        found = (
            "unknown"
            if evidence.sigma is None
            else (
                f"{evidence.sigma.rotation_deg:.2g} deg in rotation, {evidence.sigma.translation_deg:.2g} deg in"
                " the direction of t"
            )
        )
        return f"the pose is too uncertain ({found}); fill more of the picture, or add captures"
    problem = inconsistency(fit, options)
    if problem is not None:
        return problem
    if not twin_is_resolved(comparison, options):
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
