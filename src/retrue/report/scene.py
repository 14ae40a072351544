"""A rig, its planes and boards and what it measured, in space, for pages about a pose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from retrue.capture import Capture
from retrue.errors import DegenerateError
from retrue.geometry.arrays import FloatArray
from retrue.geometry.plane import Plane
from retrue.geometry.transform import RigidTransform
from retrue.recalibration.result import PoseCandidate
from retrue.reconstruction.cloud import Cloud
from retrue.reconstruction.reconstruct import reconstruct
from retrue.report.evidence_tables import candidate_name
from retrue.report.page import Block, Space, Text
from retrue.report.space import (
    CAMERA_COLOR,
    FRUSTUM_SHARE,
    Layer,
    Line,
    Vector,
    frustum,
    outline,
    rig_lines,
    space_html,
)
from retrue.rig import Rig

MOST_IN_SPACE = 100_000  # points of a page that is about a pose
STRAY_SHARE = 0.005  # of the points, at either end of each axis: strays must not widen a plane
NEAR_PLANE = 0.01  # of the distance: what is drawn as lying on it
BEFORE_COLOR, AFTER_COLOR, TWIN_COLOR = (0.95, 0.6, 0.3), (0.25, 0.81, 0.59), (0.62, 0.65, 0.68)
SUPPORTED_COLOR, PLANE_COLOR = (0.75, 0.55, 0.96), (0.53, 0.66, 0.93)
HOW_TO_TURN = "Drag to turn, scroll to zoom, shift and drag to move; two clicks measure a distance."
NOTHING_TO_DRAW = Text("Nothing to draw: no point lies in front of both devices.")


def cloud_of(rig: Rig, captures: Sequence[Capture]) -> Cloud | None:
    """The points of all captures under one rig; None where there are none."""
    clouds: list[Cloud] = []
    for capture in captures:
        try:
            clouds.append(reconstruct(rig, capture.points))
        except DegenerateError:
            continue
    if len(clouds) < 2:  # one keeps its grid, whose surface is drawn
        return clouds[0] if clouds else None
    return Cloud(
        np.concatenate([cloud.points for cloud in clouds]),
        np.concatenate([cloud.colors for cloud in clouds]),
        np.concatenate([cloud.camera_px for cloud in clouds]),
        rig.unit,
    )


def rig_scene(rig: Rig, cloud: Cloud | None, supported: RigidTransform | None = None) -> Block:
    """Both devices as the rig says, and the cloud; beside them, where a capture has the projector."""
    if cloud is None:
        return NOTHING_TO_DRAW
    distance = float(np.median(cloud.points[:, 2]))
    lines = rig_lines(rig, distance)
    if supported is not None:
        name = "projector, as the capture has it"
        length = FRUSTUM_SHARE * distance
        lines.append(frustum(name, rig.projector, supported.inverse(), length, SUPPORTED_COLOR, solid=False))
    return _space([Layer("points", cloud)], lines, "Devices and points in space", HOW_TO_TURN)


def change_scene(
    before: Rig, after: Rig | None, candidates: Sequence[PoseCandidate], clouds: Sequence[Cloud | None]
) -> Block:
    """Camera, projector before and after, planes, the twin in grey, and the points, before and after by a slider.

    `clouds` are the points under the rig before, and under the one after, where there is one.
    """
    layers = [
        Layer(f"points {when}" if after is not None else "points", cloud, when=when if after is not None else "")
        for cloud, when in zip(clouds, ("before", "after"), strict=False)
        if cloud is not None
    ]
    if not layers:
        return NOTHING_TO_DRAW
    shown = layers[-1].model
    assert isinstance(shown, Cloud)
    length = FRUSTUM_SHARE * float(np.median(shown.points[:, 2]))

    def projector(name: str, pose: RigidTransform, color: Vector, *, solid: bool = False) -> Line:
        return frustum(name, before.projector, pose.inverse(), length, color, solid=solid)

    lines = [frustum("camera", before.camera, RigidTransform.identity(), length, CAMERA_COLOR)]
    lines.append(projector("projector before", before.projector_from_camera, BEFORE_COLOR, solid=after is None))
    if after is not None:
        lines.append(projector("projector after", after.projector_from_camera, AFTER_COLOR, solid=True))
    for index, candidate in enumerate(candidates):
        if candidate.chosen:
            lines += _planes(candidate, shown)
            continue
        color = SUPPORTED_COLOR if after is None and index == 0 else TWIN_COLOR
        lines.append(projector(candidate_name(candidates, index), candidate.projector_from_camera, color))
    return _space(
        layers,
        lines,
        "Camera, projector before and after, planes and points in space",
        f"{HOW_TO_TURN} Thin frusta are poses that were not taken, though on the plane the grey one fits as well.",
    )


def board_scene(boards: Sequence[tuple[str, FloatArray, Vector]], rig: Rig | None) -> Block:
    """Every pose of the board (name, corners (4, 3), colour) before the devices, as in Fig. 6 of Zhang, Li, Wu 2007."""
    distance = float(np.median(np.concatenate([corners for _, corners, _ in boards])[:, 2]))
    lines = [outline(name, corners, color, solid=True) for name, corners, color in boards]
    return _space(
        (),
        [*(rig_lines(rig, distance) if rig is not None else ()), *lines],
        "Poses of the board before camera and projector",
        "Drag to turn, scroll to zoom. Poses should be tilted each another way, nearer and farther.",
    )


def _space(layers: Sequence[Layer], lines: Sequence[Line], label: str, caption: str) -> Space:
    names = tuple(dict.fromkeys([*(layer.name for layer in layers), *(line.name for line in lines)]))
    return Space(space_html(layers, lines, label, about="all", most=MOST_IN_SPACE), caption, names)


def _planes(candidate: PoseCandidate, cloud: Cloud) -> list[Line]:
    """The planes of a candidate where the cloud shows them."""
    several = len(candidate.planes) > 1
    found = [
        _plane(plane, cloud.points, f"plane {number}" if several else "plane")
        for number, plane in enumerate(candidate.planes, 1)
    ]
    return [line for line in found if line is not None]


def _plane(plane: Plane, points: FloatArray, name: str) -> Line | None:
    """The rectangle in a plane that holds the points (N, 3) on it; None where there are too few."""
    on_it = points[np.abs(points @ plane.normal - plane.distance) < NEAR_PLANE * plane.distance]
    if len(on_it) < 3:
        return None
    across = np.cross([0.0, 1.0, 0.0] if abs(plane.normal[1]) < 0.9 else [1.0, 0.0, 0.0], plane.normal)
    across /= np.linalg.norm(across)
    basis = np.stack([across, np.cross(plane.normal, across)])
    low, high = np.quantile(on_it @ basis.T, [STRAY_SHARE, 1 - STRAY_SHARE], axis=0)
    sides = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
    return outline(name, plane.distance * plane.normal + sides @ basis, PLANE_COLOR, solid=True)
