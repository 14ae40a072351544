"""A rig, its planes and what it measured, in space, to turn with the mouse.

Plotly's z points up, a camera's y points down: z here is the camera's y, drawn the other way round.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from retrue.capture import Capture
from retrue.errors import DegenerateError
from retrue.geometry.arrays import FloatArray
from retrue.geometry.camera import Camera
from retrue.geometry.plane import Plane
from retrue.geometry.transform import RigidTransform
from retrue.recalibration.result import PoseCandidate
from retrue.reconstruction.cloud import Cloud
from retrue.reconstruction.reconstruct import reconstruct
from retrue.report.evidence_tables import candidate_name
from retrue.report.figures import every, harmless, hex_colors, numbers, polyline
from retrue.report.lengths import LengthUnit
from retrue.report.page import Block, Chart, Text
from retrue.rig import Rig

MOST_IN_SPACE = 8000
FRUSTUM_SHARE = 0.16  # of the distance to the scene, so that a device is seen but hides nothing
STRAY_SHARE = 0.005  # of the points, at either end of each axis: strays must not shrink the rest
NEAR_PLANE = 0.01  # of the distance: what is drawn as lying on it
EYE = np.array([0.95, -0.75, 0.5])  # in Plotly's axes: x to the right, y away from the camera, z up
EYE_DISTANCE = 0.85  # of the box's diagonal
Trace = dict[str, Any]
HOW_TO_TURN = "Drag to turn, scroll to zoom; a click on a name hides or shows it."
NOTHING_TO_DRAW = Text("Nothing to draw: no point lies in front of both devices.")


@dataclass(frozen=True, slots=True, eq=False)
class Device:
    """A frustum to draw.

    Attributes
    ----------
    camera_from_device : where it stands, in the camera frame.
    color : of the page, "var(--name)".
    faint : for what is no longer so, or never was: thin lines only.
    """

    name: str
    device: Camera
    camera_from_device: RigidTransform
    color: str
    faint: bool = False


def scene_chart(
    devices: Sequence[Device], traces: Sequence[Trace], points: FloatArray, unit: LengthUnit, label: str, caption: str
) -> Chart:
    """Everything in one space; `points` (N, 3) say what must be in view, strays excepted."""
    length = FRUSTUM_SHARE * float(np.median(points[:, 2])) if len(points) else 1.0
    outlines = [_outline(device, length) for device in devices]
    low, high = _bounds(points, np.concatenate([np.zeros((1, 3)), *outlines]))
    drawn = [*traces]
    for device, outline in zip(devices, outlines, strict=True):
        drawn += _frustum(device, outline, unit)
    axes = {
        name: {"title": {"text": f"{axis}, {unit.name}"}, "range": [unit.factor * a, unit.factor * b], "nticks": 6}
        for name, axis, a, b in (
            ("xaxis", "x", low[0], high[0]),
            ("yaxis", "z", low[2], high[2]),
            ("zaxis", "y", high[1], low[1]),
        )
    }
    layout = {
        "scene": {
            **axes,
            "aspectmode": "data",
            "dragmode": "turntable",
            "camera": {"eye": _eye(high - low)},
        },
        "legend": {"x": 0, "y": 0, "yanchor": "bottom", "itemsizing": "constant", "tracegroupgap": 0},
        "showlegend": True,
        "uirevision": "kept",
    }
    return Chart({"data": drawn, "layout": layout}, label, caption, 0.58)


def cloud_trace(cloud: Cloud, unit: LengthUnit, name: str, *, color: str | None = None, shown: bool = True) -> Trace:
    """The points (thinned) in the colors of the capture, or all in one; where there are no colors, by depth."""
    rows = every(len(cloud), MOST_IN_SPACE)
    colors = cloud.colors[rows]
    marker: dict[str, Any] = {"size": 2.2, "line": {"width": 0}}
    if color is not None:
        marker["color"] = color
    elif np.ptp(colors, axis=0).any():
        marker["color"] = hex_colors(colors)
    else:
        marker |= {"color": numbers(cloud.points[rows, 2]), "colorscale": "Cividis", "showscale": False}
    return {
        "type": "scatter3d",
        "mode": "markers",
        "name": harmless(name),
        **_coordinates(cloud.points[rows], unit),
        "marker": marker,
        "hovertemplate": "x %{x}<br>y %{z}<br>z %{y} " + unit.name + "<extra></extra>",
        "visible": True if shown else "legendonly",
    }


def plane_trace(plane: Plane, points: FloatArray, unit: LengthUnit, name: str, color: str) -> Trace | None:
    """The rectangle in a plane that holds the points (N, 3) on it; None where there are too few."""
    on_it = points[np.abs(points @ plane.normal - plane.distance) < NEAR_PLANE * plane.distance]
    if len(on_it) < 3:
        return None
    across = np.cross([0.0, 1.0, 0.0] if abs(plane.normal[1]) < 0.9 else [1.0, 0.0, 0.0], plane.normal)
    across /= np.linalg.norm(across)
    basis = np.stack([across, np.cross(plane.normal, across)])
    low, high = np.quantile(on_it @ basis.T, [STRAY_SHARE, 1 - STRAY_SHARE], axis=0)
    sides = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
    return {
        "type": "mesh3d",
        "name": harmless(name),
        **_coordinates(plane.distance * plane.normal + sides @ basis, unit),
        "i": [0, 0],
        "j": [1, 2],
        "k": [2, 3],
        "color": color,
        "opacity": 0.22,
        "hoverinfo": "name",
        "showlegend": True,
        "flatshading": True,
    }


def outline_trace(corners: FloatArray, unit: LengthUnit, name: str, color: str, *, legend: bool) -> Trace:
    """Closed outlines (N, corners, 3), such as boards."""
    return {
        "type": "scatter3d",
        "mode": "lines",
        "name": harmless(name),
        **_coordinates(polyline(np.concatenate([corners, corners[:, :1]], axis=1)), unit),
        "line": {"color": color, "width": 4},
        "hoverinfo": "name",
        "showlegend": legend,
    }


def _outline(device: Device, length: float) -> FloatArray:
    """(5, 3) the centre and the corners of the picture at that depth, in the camera frame."""
    return device.camera_from_device.apply(np.concatenate([np.zeros((1, 3)), device.device.frustum(length)]))


def _frustum(device: Device, outline: FloatArray, unit: LengthUnit) -> list[Trace]:
    """Edges, and a pale body so that it reads as a solid."""
    o, a, b, c, d = outline
    edges = polyline(np.array([[a, b], [b, c], [c, d], [d, a], [o, a], [o, b], [o, c], [o, d]]))
    group = {"legendgroup": harmless(device.name), "name": harmless(device.name)}
    line: Trace = {
        "type": "scatter3d",
        "mode": "lines",
        **group,
        **_coordinates(edges, unit),
        "line": {"color": device.color, "width": 2 if device.faint else 5},
        "hoverinfo": "name",
    }
    if device.faint:
        return [line]
    body: Trace = {
        "type": "mesh3d",
        **group,
        **_coordinates(outline, unit),
        "i": [0, 0, 0, 0],
        "j": [1, 2, 3, 4],
        "k": [2, 3, 4, 1],
        "color": device.color,
        "opacity": 0.16,
        "hoverinfo": "skip",
        "showlegend": False,
    }
    return [line, body]


def _coordinates(points: FloatArray, unit: LengthUnit) -> dict[str, list[float | None]]:
    x, y, z = (numbers(unit.factor * column) for column in points.T)
    return {"x": x, "y": z, "z": y}


def _eye(extent: FloatArray) -> dict[str, float]:
    """From behind the devices, aside and above, as far off as shows everything.

    Plotly measures in the geometric mean of the three sides of the box.
    """
    distance = EYE_DISTANCE * float(np.linalg.norm(extent) / np.cbrt(np.prod(extent)))
    x, y, z = (distance * EYE / np.linalg.norm(EYE)).tolist()
    return {"x": x, "y": y, "z": z}


def _bounds(points: FloatArray, always: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Least and greatest of each coordinate, with some room."""
    low, high = always.min(axis=0), always.max(axis=0)
    if len(points):
        inner = np.quantile(points, [STRAY_SHARE, 1 - STRAY_SHARE], axis=0)
        low, high = np.minimum(low, inner[0]), np.maximum(high, inner[1])
    room = 0.04 * float((high - low).max())
    return low - room, high + room


def cloud_of(rig: Rig, captures: Sequence[Capture]) -> Cloud | None:
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
        return NOTHING_TO_DRAW
    devices = [
        Device("camera", rig.camera, RigidTransform.identity(), "var(--camera)"),
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
        return NOTHING_TO_DRAW
    devices = [Device("camera", before.camera, RigidTransform.identity(), "var(--camera)")]
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
