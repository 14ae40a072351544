"""Answers as plain JSON values, under the keys of the contract; NaN and infinity become null."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import PurePath
from typing import Any, cast

import numpy as np

from retrue.geometry.transform import RigidTransform
from retrue.recalibration.result import Accepted, PoseCandidate, Refused, Verification


def plain(value: Any) -> Any:
    """`value` with nothing in it that JSON does not have.

    >>> plain({"rms": float("nan"), "t": np.array([1.5, 2.0]), "planes": (np.int64(3),)})
    {'rms': None, 't': [1.5, 2.0], 'planes': [3]}
    """
    if isinstance(value, np.ndarray | np.generic):
        return plain(cast("Any", value).tolist())
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in cast("Mapping[Any, Any]", value).items()}
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        return [plain(item) for item in cast("Sequence[Any]", value)]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, PurePath):
        return str(value)
    raise TypeError(f"{type(value).__name__} has no place in JSON")


def pose_report(pose: RigidTransform) -> dict[str, Any]:
    """R and t."""
    return {"R": plain(pose.R), "t": plain(pose.t)}


def recalibration_report(result: Accepted | Refused, seconds: float) -> dict[str, Any]:
    """What `recalibrate --json` prints."""
    evidence = result.evidence
    return {
        "verdict": "accepted" if isinstance(result, Accepted) else "refused",
        "reason": result.reason,
        "projector_from_camera": (
            pose_report(result.rig.projector_from_camera) if isinstance(result, Accepted) else None
        ),
        "candidates": [_candidate_report(candidate) for candidate in evidence.candidates],
        "change": None if evidence.change is None else plain(asdict(evidence.change)),
        "sigma": None if evidence.sigma is None else plain(asdict(evidence.sigma)),
        "rms_px": plain(evidence.rms_px),
        "correspondences": evidence.correspondences,
        "resolved_by": evidence.resolved_by,
        "scale": evidence.scale,
        "details": plain(evidence.details),
        "seconds": seconds,
    }


def verification_report(verification: Verification, seconds: float) -> dict[str, Any]:
    """What `verify --json` prints."""
    return {
        "verdict": verification.verdict,
        "reason": verification.reason,
        "epipolar_rms_px": plain(verification.epipolar_rms_px),
        "correspondences": verification.correspondences,
        "drift": None if verification.drift is None else plain(asdict(verification.drift)),
        "drift_sigmas": plain(verification.drift_sigmas),
        "sigma": None if verification.sigma is None else plain(asdict(verification.sigma)),
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
