"""What there is to see, in metres and the camera frame of the first rig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from retrue.errors import InputError
from retrue.files.history_entry import HistoryEntry
from retrue.geometry.arrays import FloatArray, IntArray
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.reconstruction.cloud import Cloud, Mesh
from retrue.rig import Rig
from retrue.units import METRES
from retrue.viewer.contents import MOST_ENTRIES, Candidate, Contents

MOST_SHOWN = 300_000
MOST_FACES = 800_000
CAMERA_COLOR = (30, 120, 220)
PROJECTOR_COLOR = (230, 120, 20)
TWIN_COLOR = (150, 150, 150)
HISTORY_COLOR = (130, 60, 180)
FRUSTUM_REACH = 0.35  # of the way to the middle of the scene that a frustum is drawn
NEAR_BASELINES = 2.0  # the middle, in lengths of t, where nothing is there to see

Color = tuple[int, int, int]


@dataclass(frozen=True, slots=True, eq=False)
class Frustum:
    """A device: lines (N, 2, 3) from its centre through the corners of its picture, and around them."""

    name: str
    lines: FloatArray
    color: Color
    label: str
    label_at: FloatArray
    visible: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A cloud (no faces) or a mesh."""

    name: str
    points: FloatArray
    colors: NDArray[np.uint8]
    faces: IntArray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class TimeLine:
    """Poses of one rig over time.

    Attributes
    ----------
    name : of the rig file.
    frusta : of the projector, oldest first; one is shown at a time.
    captions : what happened, one for each.
    """

    name: str
    frusta: tuple[Frustum, ...]
    captions: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Everything, and what had to be left out of it, in words."""

    frusta: tuple[Frustum, ...]
    shapes: tuple[Shape, ...]
    time_lines: tuple[TimeLine, ...]
    middle: FloatArray
    notes: tuple[str, ...]


def make_scene(contents: Contents) -> Scene:
    """Frusta of both devices of each rig, of every candidate and entry of a history; clouds and meshes.

    Candidates need a rig, whose projector they place; a refused twin is grey. Large clouds are thinned, and the
    notes say so. Raises `InputError` where there are candidates but no rig.
    """
    notes: list[str] = []
    shapes = tuple(_shape(name, model, notes) for name, model in contents.models.items())
    rigs = {name: rig for name, (rig, _) in contents.rigs.items()}
    middle = _middle(shapes, list(rigs.values()))
    reach = FRUSTUM_REACH * float(np.linalg.norm(middle))
    frusta = [frustum for name, rig in rigs.items() for frustum in _devices(name, rig, reach)]
    if contents.candidates and not rigs:
        raise InputError("candidates need the rig that they are poses of: give its file too")
    first = next(iter(rigs.values()), None)
    for name, candidates in contents.candidates.items():
        assert first is not None
        for number, candidate in enumerate(candidates, start=1):
            frusta.append(
                _projector(
                    f"{name}/candidate {number}",
                    replace(first, projector_from_camera=candidate.projector_from_camera),
                    reach,
                    PROJECTOR_COLOR if candidate.chosen else TWIN_COLOR,
                    "chosen" if candidate.chosen else "candidate" if _none_chosen(candidates) else "twin",
                    label_corner=0,
                )
            )
    time_lines = tuple(
        _time_line(name, entries, reach, notes) for name, (_, entries) in contents.rigs.items() if len(entries) > 1
    )
    return Scene(tuple(frusta), shapes, time_lines, middle, tuple(notes))


def _none_chosen(candidates: Sequence[Candidate]) -> bool:
    return not any(candidate.chosen for candidate in candidates)


def _metres(unit: str) -> float:
    """Units that nobody knows are shown as they are."""
    return METRES.get(unit.strip().lower(), 1.0)


def _shape(name: str, model: Cloud | Mesh, notes: list[str]) -> Shape:
    points, colors = model.points * _metres(model.unit), model.colors
    if isinstance(model, Mesh) and len(model.faces) <= MOST_FACES:
        return Shape(name, points, colors, model.faces)
    if isinstance(model, Mesh):
        notes.append(f"{name}: {len(model.faces)} faces are too many for a browser; shown as points")
    step = -(-len(points) // MOST_SHOWN)
    if step > 1:
        notes.append(f"{name}: thinned to {len(points[::step])} of {len(points)} points")
    return Shape(name, points[::step], colors[::step])


def _middle(shapes: Sequence[Shape], rigs: Sequence[Rig]) -> FloatArray:
    """(3,) what to look at: the middle of all points, else a little way ahead of the camera."""
    if shapes:
        return np.median(np.concatenate([shape.points for shape in shapes]), axis=0)
    lengths = [float(np.linalg.norm(rig.projector_from_camera.t)) * _metres(rig.unit) for rig in rigs]
    return np.array([0.0, 0.0, NEAR_BASELINES * max([*lengths, 0.1])])


def _devices(name: str, rig: Rig, reach: float) -> list[Frustum]:
    lines = _lines(rig.camera, RigidTransform.identity(), reach)
    camera = Frustum(f"{name}/camera", lines, CAMERA_COLOR, "camera", lines[0, 0])
    return [camera, _projector(f"{name}/projector", rig, reach, PROJECTOR_COLOR, "projector")]


def _projector(name: str, rig: Rig, reach: float, color: Color, label: str, label_corner: int | None = None) -> Frustum:
    """With its label at the centre of projection, or at a corner of the picture so that several can be read."""
    pose = rig.projector_from_camera.inverse()
    in_metres = RigidTransform(pose.R, pose.t * _metres(rig.unit))
    lines = _lines(rig.projector, in_metres, reach)
    return Frustum(name, lines, color, label, lines[0, 0] if label_corner is None else lines[label_corner, 1])


def _lines(device: Camera, camera_from_device: RigidTransform, reach: float) -> FloatArray:
    """Eight lines (8, 2, 3): four rays of that length in depth, and the sides of the picture there."""
    far = camera_from_device.apply(device.frustum(reach))
    centre = np.tile(camera_from_device.t, (4, 1))
    return np.concatenate([np.stack([centre, far], axis=1), np.stack([far, np.roll(far, -1, axis=0)], axis=1)])


def _time_line(name: str, entries: Sequence[HistoryEntry], reach: float, notes: list[str]) -> TimeLine:
    if len(entries) > MOST_ENTRIES:
        notes.append(f"{name}: the last {MOST_ENTRIES} entries of its history, up to {entries[-1].id}")
    shown = entries[-MOST_ENTRIES:]
    frusta = tuple(
        replace(
            _projector(f"{name}/history/{entry.id}", entry.rig, reach, HISTORY_COLOR, f"{entry.id}", 2), visible=False
        )
        for entry in shown
    )
    captions = tuple(f"{entry.id}: {entry.action}, {entry.time:%Y-%m-%d %H:%M:%S} UTC" for entry in shown)
    return TimeLine(name, frusta, captions)
