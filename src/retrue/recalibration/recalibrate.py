"""The main job: split off planes -> pose candidates -> refine each on all points -> compare -> judge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from retrue.correspondences import Correspondences, require_captures
from retrue.errors import DegenerateError, require_kind
from retrue.geometry.transform import RigidTransform
from retrue.rasters import check_captures
from retrue.recalibration.candidates import Estimate, estimate_pose
from retrue.recalibration.fit import PoseFit, Support, refine
from retrue.recalibration.judge import Choice, choose_twin, objection, supporting_rays
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.rays import Rays
from retrue.recalibration.reasons import Reason, reason_of
from retrue.recalibration.result import (
    Accepted,
    Evidence,
    PoseCandidate,
    Refused,
    candidate,
    change,
    rms,
    sigma,
    sigma_at,
    working_distance,
)
from retrue.recalibration.scale import translation_length
from retrue.recalibration.uncertainty import systematic_covariance
from retrue.rig import Rig, require_rig

KEPT = ("lens_covariance",)  # of the old rig's evidence: its lenses are the new rig's


def recalibrate(
    rig: Rig, captures: Sequence[Correspondences], options: RecalibrateOptions | None = None
) -> Accepted | Refused:
    """The relative pose of camera and projector, anew, from one or more captures of scenes that hold a plane.

    Parameters
    ----------
    rig : intrinsics that still hold, and the old pose: its |t| gives the scale, and its direction of t tells the
        twins apart where the scene cannot, unless its rotation clearly speaks against it.
    captures : correspondences of each; several are solved jointly.
    options : limits, and the known distance.

    Returns
    -------
    Accepted, with the new rig, or Refused, with none; either with evidence and a reason in one sentence.

    Raises
    ------
    CaptureError : captures of other rasters than the rig's: `check_rasters`.
    InputError : no captures, or a known distance that the captures cannot give.

    Source: Zhang, Li, Wu 2007, section 3.
    """
    require_rig(rig)
    require_captures(captures)
    check_captures(rig, captures)
    options = options or RecalibrateOptions()
    require_kind(options, RecalibrateOptions, "options")
    total = sum(len(capture) for capture in captures)
    try:
        estimate = estimate_pose(rig, captures, options)
        choice = choose_twin(estimate.comparison, rig.projector_from_camera, options)
        if isinstance(choice, Reason):
            return Refused(choice, _unresolved(rig, estimate, total, options))
        rays = supporting_rays(estimate, options)
        chosen = estimate.comparison.fits[choice.index]
        fit = refine(chosen.pose, Support.of(rays), iterations=2)
        evidence = _evidence(rig, estimate, rays, choice, fit, total, options)
        cause = objection(fit, rays, estimate, evidence, options)
    except DegenerateError as error:
        return Refused(reason_of(error), Evidence(total))
    if cause is not None:
        return Refused(cause, evidence)
    pose = next(candidate for candidate in evidence.candidates if candidate.chosen).projector_from_camera
    return Accepted(_new_rig(rig, pose, evidence), f"resolved by {choice.resolved_by}", evidence)


def _evidence(
    rig: Rig,
    estimate: Estimate,
    rays: Rays,
    choice: Choice,
    fit: PoseFit,
    total: int,
    options: RecalibrateOptions,
) -> Evidence:
    others = [other for k, other in enumerate(estimate.comparison.fits) if k != choice.index]
    length = _length(rig, rays, fit, options)
    candidates = [
        candidate(fit, rays.points, fit.explained, length, chosen=True),
        *_candidates(estimate, others, length),
    ]
    order = [0, 1] if choice.index == 0 else [1, 0]
    found = candidates[0].projector_from_camera
    distance = working_distance(fit, rays.points, length)
    covariance = fit.covariance
    statistical = sigma(covariance)
    return Evidence(
        correspondences=total,
        candidates=tuple(candidates[k] for k in order[: len(candidates)]),
        rms_px=rms(fit.found.epipolar[fit.explained]),
        change=change(rig, found, distance),
        sigma=sigma_at(
            distance,
            covariance + systematic_covariance(rig, rays.points, fit, options),
            fit.pose,
            replace(rig, projector_from_camera=found),
        ),
        resolved_by=choice.resolved_by,
        scale=_scale_policy(options),
        working_distance=distance,
        details={
            "covariance": covariance.tolist(),
            "sigma_statistical": {
                "rotation_deg": statistical.rotation_deg,
                "translation_deg": statistical.translation_deg,
            },
            "points_used": len(estimate.rays),
            "points_explained": int(np.count_nonzero(fit.explained)),
            "planes": len(fit.pose.planes),
            "noise_px": fit.epipolar_noise.level,
            "shared_noise_px": fit.epipolar_noise.shared,
            "planarity_px": float(np.hypot(fit.along_noise.level, fit.along_noise.shared)),
            "twin_margin": estimate.comparison.margin,
            "twin_deviations": estimate.comparison.deviations,
        },
    )


def _unresolved(rig: Rig, estimate: Estimate, total: int, options: RecalibrateOptions) -> Evidence:
    fits = list(estimate.comparison.fits)
    return Evidence(
        correspondences=total,
        candidates=tuple(_candidates(estimate, fits, float(np.linalg.norm(rig.projector_from_camera.t)))),
        rms_px=rms(fits[0].found.epipolar[fits[0].explained]),
        resolved_by="nothing",
        scale=_scale_policy(options),
        details={"twin_margin": estimate.comparison.margin, "twin_deviations": estimate.comparison.deviations},
    )


def _candidates(estimate: Estimate, fits: list[PoseFit], length: float) -> list[PoseCandidate]:
    """The candidates that were not chosen, on the points that they were compared on."""
    points = estimate.comparison.rays.points
    scored = estimate.comparison.fits[0].explained
    return [candidate(fit, points, scored, length, chosen=False) for fit in fits]


def _length(rig: Rig, rays: Rays, fit: PoseFit, options: RecalibrateOptions) -> float:
    if options.known_distance is None:
        return float(np.linalg.norm(rig.projector_from_camera.t))
    first_capture = rays.points.select(rays.capture == 0)
    return translation_length(options.known_distance, rig.camera, fit.pose, first_capture)


def _scale_policy(options: RecalibrateOptions) -> str:
    return "the old length of t was kept" if options.known_distance is None else "the known distance in the scene"


def _new_rig(rig: Rig, pose: RigidTransform, evidence: Evidence) -> Rig:
    return replace(
        rig,
        projector_from_camera=pose,
        evidence={
            "method": "recalibrated from a plane by retrue",
            "correspondences": evidence.correspondences,
            "rms_px": evidence.rms_px,
            "resolved_by": evidence.resolved_by,
            "scale": evidence.scale,
            "working_distance": evidence.working_distance,
            **evidence.details,
            **{key: rig.evidence[key] for key in KEPT if key in rig.evidence},
        },
    )
