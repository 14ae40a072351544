"""A rig and what it measured, in space."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from retrue.errors import DegenerateError
from retrue.geometry.transform import RigidTransform
from retrue.recalibration.result import PoseCandidate
from retrue.reconstruction.cloud import Cloud
from retrue.reconstruction.reconstruct import reconstruct
from retrue.report.evidence_tables import candidate_name
from retrue.report.lengths import LengthUnit
from retrue.report.page import Block, Text
from retrue.report.scene import ORIGIN, Device, Trace, cloud_trace, plane_trace, scene_chart
from retrue.report.seen import SeenCapture
from retrue.rig import Rig

HOW_TO_TURN = "Drag to turn, scroll to zoom; a click on a name hides or shows it."
NOTHING = Text("Nothing to draw: no point lies in front of both devices.")


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


def rig_scene(rig: Rig, cloud: Cloud | None, unit: LengthUnit, supported: RigidTransform | None = None) -> Block:
    """Both devices as the rig says, and the cloud; beside them, where a capture has the projector."""
    if cloud is None:
        return NOTHING
    devices = [
        Device("camera", rig.camera, ORIGIN, "var(--camera)"),
        Device("projector", rig.projector, rig.projector_from_camera.inverse(), "var(--after)"),
    ]
    if supported is not None:
        name = "projector, as the capture has it"
        devices.append(Device(name, rig.projector, supported.inverse(), "var(--mark)", faint=True))
    return scene_chart(
        devices, [cloud_trace(cloud, unit, "points")], cloud.points, unit, "Devices and points in space", HOW_TO_TURN
    )


def change_scene(
    before: Rig, after: Rig | None, candidates: Sequence[PoseCandidate], cloud: Cloud | None, unit: LengthUnit
) -> Block:
    """Camera, projector before and after, planes, the twin in grey, the cloud."""
    if cloud is None:
        return NOTHING
    devices = [Device("camera", before.camera, ORIGIN, "var(--camera)")]
    old = before.projector_from_camera.inverse()
    devices.append(Device("projector before", before.projector, old, "var(--before)", faint=after is not None))
    traces: list[Trace] = [cloud_trace(cloud, unit, "points")]
    if after is not None:
        new = after.projector_from_camera.inverse()
        devices.append(Device("projector after", after.projector, new, "var(--after)"))
    for index, candidate in enumerate(candidates):
        if candidate.chosen:
            traces += _planes(candidate, cloud, unit)
            continue
        name = candidate_name(candidates, index)
        pose = candidate.projector_from_camera.inverse()
        color = "var(--mark)" if after is None and index == 0 else "var(--twin)"
        devices.append(Device(name, before.projector, pose, color, faint=True))
    return scene_chart(
        devices,
        traces,
        cloud.points,
        unit,
        "Camera, projector before and after, planes and points in space",
        f"{HOW_TO_TURN} Thin frusta are poses that were not taken, though on the plane the grey one fits as well.",
    )


def _planes(candidate: PoseCandidate, cloud: Cloud, unit: LengthUnit) -> list[Trace]:
    """The planes of a candidate where the cloud shows them."""
    several = len(candidate.planes) > 1
    found = [
        plane_trace(plane, cloud.points, unit, f"plane {number}" if several else "plane", "var(--plane)")
        for number, plane in enumerate(candidate.planes, 1)
    ]
    return [trace for trace in found if trace is not None]
