"""Answers as plain JSON values, under the keys of the contract."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from retrue.answers import answer_report
from retrue.geometry.transform import RigidTransform
from retrue.plain_json import plain
from retrue.recalibration.result import Accepted, PoseCandidate, Refused, Verification


def pose_report(pose: RigidTransform) -> dict[str, Any]:
    """R and t."""
    return {"R": plain(pose.R), "t": plain(pose.t)}


def recalibration_report(result: Accepted | Refused, seconds: float) -> dict[str, Any]:
    """What `recalibrate --json` prints."""
    evidence = result.evidence
    return {
        **answer_report(result),
        "lens": evidence.lens,
        "lenses": None if evidence.lenses is None else plain(asdict(evidence.lenses)),
        "projector_from_camera": (
            pose_report(result.rig.projector_from_camera) if isinstance(result, Accepted) else None
        ),
        "candidates": [_candidate_report(candidate) for candidate in evidence.candidates],
        "rivals": [plain(asdict(rival)) for rival in evidence.rivals],
        "change": None if evidence.change is None else plain(asdict(evidence.change)),
        "sigma": None if evidence.sigma is None else plain(asdict(evidence.sigma)),
        "rms_px": plain(evidence.rms_px),
        "correspondences": evidence.correspondences,
        "resolved_by": evidence.resolved_by,
        "scale": evidence.scale,
        "working_distance": plain(evidence.working_distance),
        "details": plain(evidence.details),
        "seconds": seconds,
    }


def verification_report(verification: Verification, seconds: float) -> dict[str, Any]:
    """What `verify --json` prints."""
    return {
        **answer_report(verification),
        "band": verification.band,
        "epipolar_rms_px": plain(verification.epipolar_rms_px),
        "correspondences": verification.correspondences,
        "drift": None if verification.drift is None else plain(asdict(verification.drift)),
        "drift_sigmas": plain(verification.drift_sigmas),
        "sigma": None if verification.sigma is None else plain(asdict(verification.sigma)),
        "working_distance": plain(verification.working_distance),
        "seconds": seconds,
    }


def _candidate_report(candidate: PoseCandidate) -> dict[str, Any]:
    return {
        **pose_report(candidate.projector_from_camera),
        "rms_px": plain(candidate.rms_px),
        "off_plane_rms_px": plain(candidate.off_plane_rms_px),
        "chosen": candidate.chosen,
        "planes": [{"normal": plain(plane.normal), "distance": plane.distance} for plane in candidate.planes],
    }
