"""The main job: hypotheses -> one posterior -> the best beats its rivals, or the answer is refused."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from retrue.correspondences import Correspondences, require_captures
from retrue.errors import DegenerateError, require_kind
from retrue.geometry.arrays import FloatArray
from retrue.geometry.transform import RigidTransform
from retrue.rasters import check_captures
from retrue.recalibration.drift import holds
from retrue.recalibration.judge import Judgement, objection
from retrue.recalibration.lens import LENS_PARAMETERS, changed_device
from retrue.recalibration.misread import judge_as_meant
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.reasons import reason_of
from retrue.recalibration.result import (
    Accepted,
    Evidence,
    LensReport,
    PoseSigma,
    Refused,
    RivalReport,
    candidate,
    change,
    rms,
    sigma,
    sigma_at,
    working_distance,
)
from retrue.recalibration.scale import translation_length
from retrue.rig import Rig, require_baseline, require_rig
from retrue.rig_evidence import LOG_LENGTH, rescaled, rig_covariance


def recalibrate(
    rig: Rig, captures: Sequence[Correspondences], options: RecalibrateOptions | None = None
) -> Accepted | Refused:
    """The relative pose of camera and projector, anew, from one or more captures of any scene.

    Parameters
    ----------
    rig : intrinsics, with the covariance that the calibration left them, and the old pose: its |t| gives the scale,
        and a small move is likelier than a large one.
    captures : correspondences of each; several are solved jointly.
    options : what is taken for granted, how sure the answer must be, and the known distance.

    Returns
    -------
    Accepted, with the new rig, or with the old one where it still holds and is known better; or Refused, with none.
    Either with evidence and a reason in one sentence.

    Raises
    ------
    CaptureError : captures of other rasters than the rig's: `check_rasters`; one that is handed in twice.
    InputError : no captures, or a known distance that the captures cannot give.
    DegenerateError : the rig's devices coincide (t = 0).

    Source: Zhang, Li, Wu 2007, section 3.
    """
    require_rig(rig)
    require_baseline(rig)
    require_captures(captures)
    check_captures(rig, captures)
    options = options or RecalibrateOptions()
    require_kind(options, RecalibrateOptions, "options")
    total = sum(len(capture) for capture in captures)
    try:
        judgement = judge_as_meant(rig, captures, options)
    except DegenerateError as error:
        return Refused(reason_of(error, captures), Evidence(total))
    evidence = _evidence(rig, judgement, total, options)
    cause = objection(judgement, evidence.sigma, evidence.working_distance, options)
    if cause is not None:
        return Refused(cause, evidence)
    same = rig if options.known_distance is None else _as_long_as(evidence.pose, rig, evidence.scale)
    if judgement.lens.verdict != "changed" and holds(same, judgement, evidence, options):
        length = "" if same is rig else "; t is as long as the known distance has it"
        return Accepted(
            same, f"the rig still holds, and its pose is known better{length}", evidence, unchanged=same is rig
        )
    doubt = "" if judgement.inverted is None else f"; {judgement.inverted}"
    return Accepted(_new_rig(rig, judgement, evidence), f"resolved by {evidence.resolved_by}{doubt}", evidence)


def _as_long_as(pose: RigidTransform | None, rig: Rig, how: str) -> Rig:
    """The rig's own pose, t as long as that of another, which is taken for exact."""
    own = float(np.linalg.norm(rig.projector_from_camera.t))
    return rig if pose is None else rescaled(rig, float(np.linalg.norm(pose.t)) / own, how, 0.0)


def _evidence(rig: Rig, judgement: Judgement, total: int, options: RecalibrateOptions) -> Evidence:
    answer, fit = judgement.answer, judgement.answer.fit
    length = float(np.linalg.norm(rig.projector_from_camera.t))
    if options.known_distance is not None:
        first_capture = answer.points.select(judgement.rays.capture == 0)
        length = translation_length(options.known_distance, rig.camera, fit.pose, first_capture)
    scored = judgement.compared.fit.explained
    candidates = [
        candidate(fit, answer.points, fit.explained, length, chosen=True),
        *(candidate(r.posterior.fit, r.posterior.points, scored, length, chosen=False) for r in judgement.rivals),
    ]
    found = candidates[0].projector_from_camera
    distance = working_distance(fit, answer.points, length)
    covariance = judgement.covariance
    lens = judgement.lens
    return Evidence(
        correspondences=total,
        candidates=tuple(candidates),
        rms_px=rms(fit.found.epipolar[fit.explained]),
        change=change(rig, found, distance),
        sigma=sigma_at(distance, covariance, fit.pose, replace(rig, projector_from_camera=found)),
        resolved_by=judgement.resolved_by,
        scale=("the old length of t was kept" if options.known_distance is None else "the known distance in the scene"),
        working_distance=distance,
        lenses=LensReport.of(lens.verdict, lens.change, lens.sigma, options.lens),
        rivals=tuple(RivalReport(r.name, r.margin, r.points, r.light, r.move) for r in judgement.rivals),
        details={
            "covariance": covariance.tolist(),
            "rig_covariance": _rig_covariance(judgement, rig, options).tolist(),
            "covariance_statistical": answer.statistical_covariance.tolist(),
            "sigma_statistical": _angles(sigma(answer.statistical_covariance)),
            "points_used": len(judgement.rays),
            "points_explained": int(np.count_nonzero(fit.explained)),
            "points_of_another_pose": 0 if judgement.other_part is None else judgement.other_part.count,
            "planes": len(fit.pose.planes),
            "noise_px": fit.epipolar_noise.level,
            "shared_noise_px": fit.epipolar_noise.shared,
            "planarity_px": fit.along_noise.total,
        },
    )


def _rig_covariance(judgement: Judgement, rig: Rig, options: RecalibrateOptions) -> FloatArray:
    """(14, 14) as a calibration writes it: of the pose (5), log |t| as the rig had it, and the lenses (8).

    A known distance in the scene is taken for exact.
    """
    joint = judgement.answer.joint_covariance.copy()
    joint[:5, :5] += judgement.covariance - judgement.answer.covariance
    whole = np.insert(np.insert(joint, LOG_LENGTH, 0.0, axis=0), LOG_LENGTH, 0.0, axis=1)
    if options.known_distance is None:
        whole[LOG_LENGTH, LOG_LENGTH] = rig_covariance(rig)[LOG_LENGTH, LOG_LENGTH]
    return whole


def _angles(known: PoseSigma) -> dict[str, float]:
    return {"rotation_deg": known.rotation_deg, "translation_deg": known.translation_deg}


def _new_rig(rig: Rig, judgement: Judgement, evidence: Evidence) -> Rig:
    lenses = {key: rig.evidence[key] for key in ("lens_covariance",) if key in rig.evidence}  # its lenses are the same
    if judgement.lens.verdict == "changed":
        lenses = {"lens_covariance": judgement.answer.lens_covariance.tolist()}
        lens = judgement.answer.parameters.lens
        rig = replace(
            rig,
            camera=changed_device(rig.camera, lens[:LENS_PARAMETERS]),
            projector=changed_device(rig.projector, lens[LENS_PARAMETERS:]),
        )
    return replace(
        rig,
        projector_from_camera=evidence.pose or rig.projector_from_camera,
        evidence={
            "method": "recalibrated by retrue",
            "correspondences": evidence.correspondences,
            "rms_px": evidence.rms_px,
            "resolved_by": evidence.resolved_by,
            "lens": evidence.lens,
            **lenses,
            "scale": evidence.scale,
            "working_distance": evidence.working_distance,
            **evidence.details,
        },
    )
