"""The page of a recalibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from retrue.errors import DegenerateError
from retrue.geometry.transform import RigidTransform
from retrue.recalibration.result import Accepted, PoseCandidate, Refused
from retrue.reconstruction.cloud import Cloud
from retrue.reconstruction.reconstruct import epipolar_residuals, reconstruct
from retrue.report.evidence_tables import candidate_name, evidence_blocks
from retrue.report.lengths import LengthUnit, degrees, pixels, shown_unit
from retrue.report.page import Block, Chart, Fact, Page, Section, Tabs, Text
from retrue.report.pose_table import Known, change_table, known, pose_table
from retrue.report.residual_charts import arrow_picture, point_picture, residual_histogram, residual_limits
from retrue.report.scene import ORIGIN, Device, Trace, cloud_trace, plane_trace, scene_chart
from retrue.report.seen import SeenCapture
from retrue.report.words import problem_and_advice, sentence
from retrue.rig import Rig

MOST_CAPTURES = 6  # drawn; all are counted


def recalibration_page(
    before: Rig, captures: Sequence[SeenCapture], result: Accepted | Refused, *, out: str = ""
) -> Page:
    """What was seen, which pose was taken and why, how far it is from the old one, and how sure that is.

    Parameters
    ----------
    before : the rig as it was handed in.
    captures : what `recalibrate` was given, in that order.
    out : where the new rig was written to.
    """
    unit = shown_unit(before.unit)
    after = _after(before, result)
    cloud = cloud_of(after or before, captures)
    distance = None if cloud is None else float(np.median(cloud.points[:, 2]))
    sigma = known(after or before, result.evidence.sigma, result.evidence.details, distance)
    sections = [
        Section("In space", _scene_lead(result), scene_blocks(before, after, result.evidence.candidates, cloud, unit)),
        residual_section(before, after, captures),
    ]
    if after is not None:
        poses = {"before": before.projector_from_camera, "after": after.projector_from_camera}
        tables = (change_table(before, after, sigma, distance, unit), pose_table(poses, unit))
        lead = "" if isinstance(result, Accepted) else "As it would have been, had the answer been trusted."
        sections.insert(1, Section("What changed", lead, tables))
    sections.append(
        Section("Why this answer", sentence(result.reason), evidence_blocks(before, result.evidence, unit))
    )
    facts = _facts(before, after, captures, result, sigma, distance, unit)
    if isinstance(result, Accepted):
        return Page("recalibrate", "Accepted", "good", _accepted(result, out), facts, tuple(sections))
    problem, advice = problem_and_advice(result.reason)
    return Page(
        "recalibrate", "Refused", "warn", f"{problem} Nothing was written.", facts, tuple(sections), advice
    )


def cloud_of(rig: Rig, captures: Sequence[SeenCapture]) -> Cloud | None:
    """The points of all captures under one rig; None where there are none."""
    clouds: list[Cloud] = []
    for capture in captures:
        try:
            clouds.append(reconstruct(rig, capture.points))
        except DegenerateError:
            continue
    if not clouds:
        return None
    return Cloud(
        np.concatenate([cloud.points for cloud in clouds]),
        np.concatenate([cloud.colors for cloud in clouds]),
        np.concatenate([cloud.camera_px for cloud in clouds]),
        rig.unit,
    )


def scene_blocks(
    before: Rig, after: Rig | None, candidates: Sequence[PoseCandidate], cloud: Cloud | None, unit: LengthUnit
) -> tuple[Block, ...]:
    """Camera, projector before and after, planes, the twin in grey, the cloud."""
    if cloud is None:
        return (Text("Nothing to draw: no point lies in front of both devices."),)
    devices = [Device("camera", before.camera, ORIGIN, "var(--camera)")]
    old = before.projector_from_camera.inverse()
    devices.append(Device("projector before", before.projector, old, "var(--before)", dashed=after is not None))
    traces: list[Trace] = [cloud_trace(cloud, unit, "points")]
    if after is not None:
        new = after.projector_from_camera.inverse()
        devices.append(Device("projector after", after.projector, new, "var(--after)"))
    for index, candidate in enumerate(candidates):
        if candidate.chosen:
            traces += planes_of(candidate, cloud, unit)
            continue
        name = candidate_name(candidates, index).lower()
        pose = candidate.projector_from_camera.inverse()
        devices.append(Device(f"projector, {name}", before.projector, pose, "var(--twin)", dashed=True))
        if after is None:
            traces += planes_of(candidate, cloud, unit, f", {name}")
    return (
        scene_chart(
            devices,
            traces,
            cloud.points,
            unit,
            "Camera, projector before and after, planes and points in space",
            "Drag to turn, scroll to zoom; a click on a name hides or shows it. Frusta are drawn as long as a sixth of"
            " the distance.",
        ),
    )


def planes_of(candidate: PoseCandidate, cloud: Cloud, unit: LengthUnit, whose: str = "") -> list[Trace]:
    """The planes of a candidate where the cloud shows them."""
    several = len(candidate.planes) > 1
    found = [
        plane_trace(plane, cloud.points, unit, f"plane {number}{whose}" if several else f"plane{whose}", "var(--plane)")
        for number, plane in enumerate(candidate.planes, 1)
    ]
    return [trace for trace in found if trace is not None]


def residual_section(before: Rig, after: Rig | None, captures: Sequence[SeenCapture]) -> Section:
    """Points over the photographs by residual, arrows, and how many miss by how much."""
    rigs = {"After": after, "Before": before} if after is not None else {"As the rig stands": before}
    colors = {"After": "var(--after)", "Before": "var(--before)", "As the rig stands": "var(--camera)"}
    values = {
        name: (np.concatenate([epipolar_residuals(rig, capture.points) for capture in captures]), colors[name])
        for name, rig in rigs.items()
        if rig is not None
    }
    if not any(len(capture.points) for capture in captures):
        return Section("What was decoded", "No correspondences.", ())
    limits = residual_limits([residual for residual, _ in values.values()])
    newest = after or before
    panels: list[tuple[str, Chart]] = []
    for capture in captures[:MOST_CAPTURES]:
        of = f" · {capture.name}" if len(captures) > 1 else ""
        for name, rig in rigs.items():
            if rig is not None and (rig is newest or len(captures) == 1):
                panels.append((f"{name}{of}", point_picture(rig, capture, limits)))
        if len(captures) == 1:
            panels.append(("Arrows", arrow_picture(newest, capture)))
    if len(captures) > 1:
        panels.append((f"Arrows · {captures[0].name}", arrow_picture(newest, captures[0])))
    names = captures[0].name if len(captures) == 1 else f"{len(captures)} captures"
    total = sum(len(capture.points) for capture in captures)
    return Section(
        "What was decoded",
        f"{total} correspondences in {names}. The two rays of a point should meet; its residual is by how many pixels"
        " they miss.",
        (Tabs(tuple(panels)), residual_histogram(values)),
    )


def _after(before: Rig, result: Accepted | Refused) -> Rig | None:
    """The new rig; of a refusal, what it would have been."""
    if isinstance(result, Accepted):
        return result.rig
    chosen: list[RigidTransform] = [
        candidate.projector_from_camera for candidate in result.evidence.candidates if candidate.chosen
    ]
    return replace(before, projector_from_camera=chosen[0]) if chosen else None


def _accepted(result: Accepted, out: str) -> str:
    change, sigma = result.evidence.change, result.evidence.sigma
    said = "The new pose is accepted"
    if change is not None:
        said = (
            f"The projector has turned by {degrees(change.rotation_deg)}, and its direction from the camera by"
            f" {degrees(change.translation_deg)}"
        )
    if sigma is not None:
        said += f"; the new pose is known to {degrees(sigma.rotation_deg)} and {degrees(sigma.translation_deg)}"
    return f"{said}{f', and was written to {out}' if out else ''}."


def _scene_lead(result: Accepted | Refused) -> str:
    if isinstance(result, Accepted):
        return "The points as the new rig measures them, and where both devices stand."
    return "The points as far as they can be placed."


def _facts(
    before: Rig,
    after: Rig | None,
    captures: Sequence[SeenCapture],
    result: Accepted | Refused,
    sigma: Known,
    distance: float | None,
    unit: LengthUnit,
) -> tuple[Fact, ...]:
    evidence = result.evidence
    facts = [Fact("Correspondences", str(evidence.correspondences), f"in {len(captures)} capture(s)")]
    if after is None:
        return tuple(facts)
    from retrue.rig_difference import rig_difference

    difference = rig_difference(before, after, distance)
    facts = [
        Fact("Rotation", degrees(difference.rotation_deg), _plus_minus(degrees(sigma.rotation_deg))),
        Fact("Direction of t", degrees(difference.translation_deg), _plus_minus(degrees(sigma.translation_deg))),
    ]
    if distance is not None:
        cost = unit.text(difference.displacement)
        note = f"at {unit.text(distance)}; now {_plus_minus(unit.text(sigma.displacement))}"
        facts.append(Fact("The old rig was wrong by", cost, note))
    medians = [
        float(np.nanmedian(np.concatenate([np.abs(epipolar_residuals(rig, c.points)) for c in captures])))
        for rig in (after, before)
    ]
    facts.append(Fact("Rays miss by (median)", pixels(medians[0]), f"{pixels(medians[1])} before"))
    return tuple(facts)


def _plus_minus(text: str) -> str:
    return f"± {text}"
