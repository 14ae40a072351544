"""Ask `retrue` about one case, and hold its answer against the truth."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

import retrue

from .bound import Bound, bound
from .contradiction import contradiction
from .kinds import Case
from .lens import Array, Prior
from .rig import Rig, pose_error

WRONG_SIGMAS, WRONG_DEG = 5.0, 0.2
LENS_SIGMAS = 6.0  # by which matches contradict lenses that are to be called changed


@dataclass(frozen=True)
class Outcome:
    """One answer.

    Attributes
    ----------
    verdict : accepted, wrong, unchanged, refused or error; good, drifted, unknown; written, refused.
    off, sigma : degrees, of rotation and of the direction of t.
    nees : error^T C^-1 error of the five parameters, where the answer states C.
    focal_off : the larger relative error of the focal lengths that the answer leaves in the rig.
    at_best : what the matches allow (`bound`).
    """

    kind: str
    seed: int
    verdict: str
    reason: str = ""
    lens: str = ""
    off: Array | None = None
    sigma: Array | None = None
    nees: float | None = None
    focal_off: float | None = None
    at_best: Bound | None = None
    seconds: float = 0.0
    facts: dict[str, Any] = field(default_factory=dict)


def ask(kind: str, seed: int, job: str, case: Case, settings: Mapping[str, Any]) -> Outcome:
    """The outcome of one case; an exception is an "error". `settings` are fields of RecalibrateOptions."""
    start = time.perf_counter()
    captures = [capture.public() for capture in case.captures]
    rig = case.told.public(case.evidence)
    try:
        judge = {"recalibrate": _recalibrate, "verify": _verify, "reconstruct": _reconstruct}[job]
        answer = judge(rig, captures, case, options(case.prior, settings))
    except Exception as error:  # the bench goes on; the row shows it
        answer = {"verdict": "error", "reason": f"{type(error).__name__}: {error}"}
    seconds = time.perf_counter() - start
    found = answer.pop("pose", None)
    best = bound(case.truths[0], case.captures, case.prior, case.told)
    if best.against > LENS_SIGMAS:  # to first order; the pose that was found may explain the matches all the same
        poses = [] if found is None else [replace(case.told, R=np.array(found.R), t=np.array(found.t))]
        least = contradiction(case.truths[0], case.told, case.captures, case.prior, poses)
        best = replace(best, against=min(best.against, least))
    return Outcome(kind, seed, at_best=best, seconds=seconds, **{"facts": case.facts, **answer})


def options(prior: Prior, settings: Mapping[str, Any]) -> retrue.RecalibrateOptions:
    """As sure of the lenses as their calibration is, where that is an option."""
    stated = {"focal_sigma": max(prior.focal, 1e-6), "principal_point_sigma_px": max(prior.centre_px, 1e-4)}
    stated["k1_sigma"] = max(prior.k1, 1e-7)
    known = retrue.RecalibrateOptions.__dataclass_fields__
    return retrue.RecalibrateOptions(**{n: v for n, v in stated.items() if n in known} | dict(settings))


def _recalibrate(
    rig: retrue.Rig, captures: list[retrue.Correspondences], case: Case, limits: retrue.RecalibrateOptions
) -> dict[str, Any]:
    result = retrue.recalibrate(rig, captures, limits)
    evidence = result.evidence
    lens = _lens_answer(getattr(evidence, "lens", None))
    found = {"lens": lens, "pose": evidence.pose}
    if isinstance(result, retrue.Refused):
        return {"verdict": "refused", "reason": f"{result.cause.name}: {result.reason}", **found}
    found["pose"] = evidence.pose or result.rig.projector_from_camera
    sigma = evidence.sigma
    stated = np.array([sigma.rotation_deg, sigma.translation_deg]) if sigma else np.zeros(2)
    # The rig that is handed back must be right; how exact and how honest we are, the pose that was found tells.
    error, off = _off(evidence.pose or result.rig.projector_from_camera, case, stated)
    _, left = _off(result.rig.projector_from_camera, case, stated)
    right = ((left <= WRONG_DEG) | (left <= WRONG_SIGMAS * stated)).all()
    verdict = result.verdict if right else "wrong"
    covariance = evidence.details.get("covariance")
    nees = None if covariance is None else float(error @ np.linalg.solve(np.array(covariance, dtype=float), error))
    return {
        "verdict": verdict,
        "reason": result.reason,
        **found,
        "off": off,
        "sigma": stated,
        "nees": nees,
        "focal_off": _focal_error(result.rig, case.truths[0]),
    }


def _off(pose: retrue.RigidTransform, case: Case, sigma: Array) -> tuple[Array, Array]:
    """Error (5,) from the nearest truth in its sigma, radians; degrees of rotation and of the direction of t."""
    errors = np.array([pose_error(pose.R, pose.t, truth) for truth in case.truths])
    off = np.degrees([[np.linalg.norm(error[:3]), np.linalg.norm(error[3:])] for error in errors])
    nearest = int((off / np.maximum(sigma, 1e-9)).max(axis=1).argmin())
    return errors[nearest], off[nearest]


def _lens_answer(lens: Any) -> str:
    if lens is None or isinstance(lens, str):
        return lens or ""
    named = (getattr(lens, name) for name in ("verdict", "state", "status", "answer") if hasattr(lens, name))
    return str(next(named, type(lens).__name__)).lower()


def _focal_error(rig: retrue.Rig, truth: Rig) -> float:
    pairs = ((rig.camera, truth.camera), (rig.projector, truth.projector))
    return max(abs(float(found.K[0, 0]) / float(true.focal[0]) - 1) for found, true in pairs)


def _verify(
    rig: retrue.Rig, captures: list[retrue.Correspondences], case: Case, limits: retrue.RecalibrateOptions
) -> dict[str, Any]:
    result = retrue.verify(rig, captures, retrue.VerifyOptions(estimate=limits))
    sigma = result.sigma
    stated = np.array([sigma.rotation_deg, sigma.translation_deg]) if sigma else None
    reason = f"{result.cause.name}: {result.reason}" if result.cause else result.reason
    return {"verdict": result.verdict, "reason": reason, "sigma": stated, "nees": (result.drift_sigmas or np.nan) ** 2}


def _reconstruct(
    rig: retrue.Rig, captures: list[retrue.Correspondences], case: Case, _: retrue.RecalibrateOptions
) -> dict[str, Any]:
    verification = retrue.verify(rig, captures[:1])  # as the command does
    if verification.forbids_measuring:
        return {"verdict": "refused", "reason": verification.reason}
    try:
        cloud = retrue.reconstruct(rig, captures[0])
    except retrue.RetrueError as error:
        return {"verdict": "refused", "reason": str(error)}
    taken = case.captures[0]
    true = {tuple(pixel): point for pixel, point in zip(taken.camera_px, taken.points, strict=True)}
    there = np.array([true[tuple(pixel)] for pixel in cloud.camera_px])
    miss = np.linalg.norm(cloud.points - there, axis=1) / np.linalg.norm(there, axis=1)
    facts = case.facts | {"cloud_miss": float(np.median(miss)), "epipolar_rms_px": cloud.card["epipolar_rms_px"]}
    return {"verdict": "written", "reason": "", "facts": facts}
