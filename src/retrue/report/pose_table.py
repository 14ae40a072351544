"""What changed between two poses of a rig, and how well that is known: in degrees, in length, and where the work is."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from retrue.geometry.transform import RigidTransform, vector_from_rotation
from retrue.recalibration.result import PoseChange, PoseSigma
from retrue.report.lengths import MISSING, LengthUnit, degrees, figures
from retrue.report.page import Table


def change_table(change: PoseChange, sigma: PoseSigma | None, distance: float | None, unit: LengthUnit) -> Table:
    """One row a quantity: its change, and one sigma of that."""
    known = sigma or PoseSigma(float("nan"), float("nan"))
    rows = [
        ("Rotation", degrees(change.rotation_deg), degrees(known.rotation_deg)),
        ("Direction of t", degrees(change.translation_deg), degrees(known.translation_deg)),
        ("Length of t", unit.text(change.length), MISSING),
    ]
    caption = "Sigma is one standard deviation."
    if distance is not None and change.displacement is not None:
        caption += " The last row is what it costs: how far a measured point lands elsewhere, RMS over the picture."
        name = f"A point measured at {unit.text(distance)}"
        rows.append((name, unit.text(change.displacement), unit.text(known.displacement)))
    return Table(
        ("", "change", "sigma"),
        tuple(rows),
        caption,
    )


def pose_table(poses: Mapping[str, RigidTransform], unit: LengthUnit) -> Table:
    """R as axis times angle, and t, of each pose by its name."""
    rows: list[tuple[str, ...]] = []
    for name, pose in poses.items():
        vector = np.degrees(vector_from_rotation(pose.R))
        rows.append((name, *(f"{angle:.4f}" for angle in vector), *(figures(unit.factor * x, 6) for x in pose.t)))
    head = ("", *(f"r{axis}, deg" for axis in "xyz"), *(f"t{axis}, {unit.name}" for axis in "xyz"))
    return Table(head, tuple(rows), "projector_from_camera: rotation as axis times angle, and t.")
