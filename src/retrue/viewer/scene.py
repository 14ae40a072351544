"""What there is to see: layers and lines in one unit and the camera frame of the first rig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from retrue.errors import InputError
from retrue.files.history_entry import HistoryEntry
from retrue.geometry.arrays import FloatArray
from retrue.geometry.transform import RigidTransform
from retrue.reconstruction.cloud import Cloud, Mesh
from retrue.report.space import CAMERA_COLOR, PROJECTOR_COLOR, Layer, Line, Vector, frustum, space_page
from retrue.rig import Rig
from retrue.units import METRES
from retrue.viewer.contents import MOST_ENTRIES, Candidate, Contents

TWIN_COLOR, HISTORY_COLOR = (0.62, 0.65, 0.68), (0.72, 0.47, 0.95)
FRUSTUM_REACH = 0.35  # of the way to the middle of the scene that a frustum is drawn
NEAR_BASELINES = 2.0  # the middle, in lengths of t, where nothing is there to see


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Everything, and what had to be left out of it, in words."""

    layers: tuple[Layer, ...]
    lines: tuple[Line, ...]
    notes: tuple[str, ...]

    def page(self, title: str) -> str:
        """As a page that loads nothing."""
        return space_page(self.layers, self.lines, title, about="points" if self.layers else "all")


def make_scene(contents: Contents, *, compare: bool = False) -> Scene:
    """Frusta of both devices of each rig, of every candidate and entry of a history; clouds and meshes.

    In the unit of the first rig, else of the first model. Candidates need a rig, whose projector they place; a refused
    twin is grey. With `compare` the first of two clouds is "before".

    Raises
    ------
    InputError : candidates but no rig, or not two clouds to compare.
    """
    if compare and len(contents.models) != 2:
        raise InputError(f"view: expected two clouds to compare, found {len(contents.models)}")
    rigs = {name: rig for name, (rig, _) in contents.rigs.items()}
    unit = next((thing.unit for thing in (*rigs.values(), *contents.models.values())), "m")
    models = {name: _in_unit(model, unit) for name, model in contents.models.items()}
    whens = ("before", "after") if compare else ("",) * len(models)
    layers = [Layer(name, model, when=when) for (name, model), when in zip(models.items(), whens, strict=True)]
    reach = FRUSTUM_REACH * _distance(list(models.values()), list(rigs.values()), unit)
    lines = [line for name, rig in rigs.items() for line in _devices(name, rig, unit, reach)]
    first = next(iter(rigs.values()), None)
    for name, candidates in contents.candidates.items():
        if first is None:
            raise InputError("candidates need the rig that they are poses of: give its file too")
        lines += _candidates(name, candidates, first, unit, reach)
    notes: list[str] = []
    for name, (_, entries) in contents.rigs.items():
        if len(entries) > MOST_ENTRIES:
            notes.append(f"{name}: the last {MOST_ENTRIES} entries of its history, up to {entries[-1].id}")
        if len(entries) > 1:
            lines += _history(name, entries[-MOST_ENTRIES:], unit, reach)
    return Scene(tuple(layers), tuple(lines), tuple(notes))


def _factor(unit: str, wanted: str) -> float:
    """Units that nobody knows are shown as they are."""
    known, target = METRES.get(unit.strip().lower()), METRES.get(wanted.strip().lower())
    return 1.0 if known is None or target is None else known / target


def _in_unit(model: Cloud | Mesh, unit: str) -> Cloud | Mesh:
    factor = _factor(model.unit, unit)
    points = model.points * factor
    if isinstance(model, Mesh):
        return replace(model, points=points, unit=unit)
    sigma = None if model.sigma is None else model.sigma * factor
    return replace(model, points=points, sigma=sigma, uncertainty=None, unit=unit)


def _distance(models: Sequence[Cloud | Mesh], rigs: Sequence[Rig], unit: str) -> float:
    """To the middle of all points, else a little way ahead of the camera."""
    points: list[FloatArray] = [model.points for model in models if len(model.points)]
    if points:
        return float(np.linalg.norm(np.median(np.concatenate(points), axis=0)))
    lengths = [float(np.linalg.norm(rig.projector_from_camera.t)) * _factor(rig.unit, unit) for rig in rigs]
    return NEAR_BASELINES * max([*lengths, 0.1 / METRES.get(unit, 1.0)])


def _devices(name: str, rig: Rig, unit: str, reach: float) -> list[Line]:
    camera = frustum(f"{name}: camera", rig.camera, RigidTransform.identity(), reach, CAMERA_COLOR)
    projector = _projector(f"{name}: projector", rig, unit, reach, PROJECTOR_COLOR, solid=True)
    return [replace(camera, label="camera"), replace(projector, label="projector")]


def _projector(name: str, rig: Rig, unit: str, reach: float, color: Vector, *, solid: bool = False) -> Line:
    pose = rig.projector_from_camera.inverse()
    placed = RigidTransform(pose.R, pose.t * _factor(rig.unit, unit))
    return frustum(name, rig.projector, placed, reach, color, solid=solid)


def _candidates(name: str, candidates: Sequence[Candidate], rig: Rig, unit: str, reach: float) -> list[Line]:
    other = "twin" if any(candidate.chosen for candidate in candidates) else "candidate"
    lines: list[Line] = []
    for number, candidate in enumerate(candidates, start=1):
        moved = replace(rig, projector_from_camera=candidate.projector_from_camera)
        color = PROJECTOR_COLOR if candidate.chosen else TWIN_COLOR
        line = _projector(f"{name}: candidate {number}", moved, unit, reach, color)
        lines.append(replace(line, label="chosen" if candidate.chosen else other))
    return lines


def _history(name: str, entries: Sequence[HistoryEntry], unit: str, reach: float) -> list[Line]:
    """The projector at each entry, oldest first."""
    return [
        replace(
            _projector(f"{name}: history", entry.rig, unit, reach, HISTORY_COLOR),
            label=f"{entry.id}",
            moment=f"{entry.id}: {entry.action}, {entry.time:%Y-%m-%d %H:%M:%S} UTC",
        )
        for entry in entries
    ]
