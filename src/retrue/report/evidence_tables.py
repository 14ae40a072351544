"""What changed and what that rests on, as tables: the change of pose, both candidates side by side, the counts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from retrue.geometry.transform import RigidTransform, direction_angle, rotation_angle, vector_from_rotation
from retrue.recalibration.result import Evidence, PoseCandidate, PoseChange, PoseSigma
from retrue.recalibration.summary import lens_text
from retrue.report.lengths import LengthUnit, degrees, pixels, sentence
from retrue.report.page import Block, Table, Text
from retrue.rig import Rig
from retrue.shown import MISSING, figures

LABELS = {
    "points_used": "Points used",
    "points_explained": "Points that agree with the pose",
    "planes": "Planes found",
    "noise_px": "Noise of a point, px",
    "shared_noise_px": "Error shared by neighbours, px",
    "planarity_px": "Planes are flat to, px",
    "points_of_another_pose": "Points of another pose, set aside",
    "dropped_epipolar_outliers": "Left out: rays miss each other by too much",
    "dropped_behind_or_at_infinity": "Left out: behind a device, or infinitely far",
    "dropped_alone": "Left out: without neighbours on a surface",
    "dropped_in_islands": "Left out: on pieces without an inside",
    "dropped_at_edges": "Left out: cut by an edge",
    "smoothed": "Points smoothed",
    "smoothed_cells": "Side of the windows, cells (median)",
    "holes_filled": "Holes filled",
    "points_filled_in": "Points invented in them",
    "holes_left_open": "Holes left open",
}


def evidence_blocks(before: Rig, evidence: Evidence, unit: LengthUnit) -> tuple[Block, ...]:
    """What the lenses are to it, every rival, the candidates side by side, and what was counted."""
    blocks: list[Block] = []
    if evidence.lenses is not None:
        blocks.append(Text(f"Lenses: {lens_text(evidence.lenses)}."))
    if evidence.rivals:
        blocks.append(_rivals_table(evidence))
    if evidence.scale:
        blocks.append(Text(f"Length of t: {sentence(evidence.scale)}"))
    if evidence.candidates:
        blocks.append(_candidates_table(before, evidence.candidates, unit))
    rows = detail_rows(evidence.details)
    if rows:
        blocks.append(Table(("Evidence", ""), (("Correspondences", figures(evidence.correspondences)), *rows)))
    return tuple(blocks)


def detail_rows(details: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Every number and word among the details, by the name that people have for it."""
    return [
        (LABELS.get(key, key.replace("_", " ").capitalize()), value if isinstance(value, str) else figures(value))
        for key, value in details.items()
        if isinstance(value, str | int | float) and not isinstance(value, bool)
    ]


def candidate_name(candidates: Sequence[PoseCandidate], index: int) -> str:
    """ "Chosen pose", and the others by their number: "Rival 1" is that of the first row of the rivals."""
    if candidates[index].chosen:
        return "Chosen pose"
    return f"Rival {sum(not candidate.chosen for candidate in candidates[: index + 1])}"


def _rivals_table(evidence: Evidence) -> Table:
    """By how much the answer beats each other explanation, and where from."""
    rows = tuple(
        (f"{number}: {rival.name}", *(f"{nats:.1f}" for nats in (rival.margin, rival.points, rival.light, rival.move)))
        for number, rival in enumerate(evidence.rivals, start=1)
    )
    return Table(
        ("Rival", "margin", "points", "light", "move"),
        rows,
        "Log evidence for the answer against each other explanation, all of them refined on all points, and what it is"
        " made of: the points, the projector's light, the distance from the old pose. 7 is a thousand to one.",
    )


def _candidates_table(before: Rig, candidates: Sequence[PoseCandidate], unit: LengthUnit) -> Table:
    old = before.projector_from_camera
    columns = [
        (
            candidate_name(candidates, index),
            pixels(candidate.rms_px),
            pixels(candidate.off_plane_rms_px),
            degrees(float(np.degrees(rotation_angle(candidate.projector_from_camera.R @ old.R.T)))),
            degrees(float(np.degrees(direction_angle(candidate.projector_from_camera.t, old.t)))),
            unit.text(candidate.planes[0].distance) if candidate.planes else MISSING,
            degrees(_tilt_deg(candidate)),
        )
        for index, candidate in enumerate(candidates)
    ]
    names = (
        "",
        "RMS, all points",
        "RMS, points off the plane",
        "Rotated from the old pose",
        "Direction of t from the old",
        "First plane, distance",
        "First plane, tilt to the camera",
    )
    rows = tuple(zip(names, *columns, strict=True))
    return Table(
        rows[0],
        rows[1:],
        "The chosen pose beside its rivals, by the numbers that they have above.",
    )


def _tilt_deg(candidate: PoseCandidate) -> float | None:
    if not candidate.planes:
        return None
    return float(np.degrees(direction_angle(candidate.planes[0].normal, [0.0, 0.0, 1.0])))


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
