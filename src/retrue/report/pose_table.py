"""What changed between two poses of a rig, and how well that is known: in degrees, in length, and where the work is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from retrue.geometry.arrays import FloatArray
from retrue.geometry.transform import RigidTransform, vector_from_rotation
from retrue.geometry.two_view import TwoViewPose
from retrue.recalibration.result import PoseSigma
from retrue.report.lengths import MISSING, LengthUnit, degrees, figures
from retrue.report.page import Table
from retrue.rig import Rig
from retrue.rig_difference import rig_difference


@dataclass(frozen=True, slots=True)
class Known:
    """How well a pose is known, one sigma; `displacement` is what that does to points at the working distance."""

    rotation_deg: float | None = None
    translation_deg: float | None = None
    displacement: float | None = None


def known(rig: Rig, sigma: PoseSigma | None, details: Mapping[str, Any], distance: float | None) -> Known:
    """From the sigma of a result, and the covariance (5, 5) among its details, if it has one.

    That covariance is of the points alone. It is scaled, its rotation and its direction of t each, to the sigma that
    also holds what intrinsics and bowed planes add.
    """
    if sigma is None:
        return Known()
    displacement = None
    if distance is not None and details.get("covariance") is not None:
        covariance = np.asarray(details["covariance"], dtype=np.float64)
        displacement = _displacement_sigma(rig, _scaled(covariance, sigma), distance)
    return Known(sigma.rotation_deg, sigma.translation_deg, displacement)


def change_table(before: Rig, after: Rig, sigma: Known, distance: float | None, unit: LengthUnit) -> Table:
    """One row a quantity: change, sigma."""
    difference = rig_difference(before, after, distance)
    old, new = before.projector_from_camera, after.projector_from_camera
    centres = [pose.inverse().t for pose in (old, new)]
    rows = [
        ("Rotation", degrees(difference.rotation_deg), degrees(sigma.rotation_deg)),
        ("Direction of t", degrees(difference.translation_deg), degrees(sigma.translation_deg)),
        (f"Length of t, was {unit.text(float(np.linalg.norm(old.t)))}", unit.text(difference.length), MISSING),
        ("Projector's place, seen from the camera", unit.text(float(np.linalg.norm(centres[1] - centres[0]))), MISSING),
    ]
    if distance is not None:
        name = f"A point measured at {unit.text(distance)}"
        rows.append((name, unit.text(difference.displacement), unit.text(sigma.displacement)))
    return Table(
        ("", "change", "sigma"),
        tuple(rows),
        "Sigma is one standard deviation. The last row says how far a measured point lands elsewhere (RMS over the"
        " picture), which is what a wrong rig costs.",
    )


def pose_table(poses: Mapping[str, RigidTransform], unit: LengthUnit) -> Table:
    """R as axis times angle, and t, of each."""
    rows: list[tuple[str, ...]] = []
    for name, pose in poses.items():
        vector = np.degrees(vector_from_rotation(pose.R))
        rows.append((name, *(f"{angle:.4f}" for angle in vector), *(figures(unit.factor * x, 6) for x in pose.t)))
    head = ("", *(f"r{axis}, deg" for axis in "xyz"), *(f"t{axis}, {unit.name}" for axis in "xyz"))
    return Table(head, tuple(rows), "projector_from_camera: rotation as axis times angle, and t.")


def _scaled(covariance: FloatArray, sigma: PoseSigma) -> FloatArray:
    scale = np.empty(5)
    for block, wanted in ((slice(0, 3), sigma.rotation_deg), (slice(3, 5), sigma.translation_deg)):
        own = np.sqrt(np.trace(covariance[block, block]))
        scale[block] = np.radians(wanted) / own if own > 0 else 0.0
    return covariance * np.outer(scale, scale)


def _displacement_sigma(rig: Rig, covariance: FloatArray, distance: float) -> float:
    """RMS over the picture of how far a point at that depth moves, by one sigma along each axis of the covariance."""
    pose = rig.projector_from_camera
    length = float(np.linalg.norm(pose.t))
    unit_pose = TwoViewPose(pose.R, pose.t / length)
    values, vectors = np.linalg.eigh(covariance)
    total = 0.0
    for value, vector in zip(values, vectors.T, strict=True):
        step = np.sqrt(max(float(value), 0.0)) * vector
        moved = unit_pose.moved(step)
        turned = replace(rig, projector_from_camera=RigidTransform(moved.R, length * moved.t))
        total += (rig_difference(rig, turned, distance).displacement or 0.0) ** 2
    return float(np.sqrt(total))
