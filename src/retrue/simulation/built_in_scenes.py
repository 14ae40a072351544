"""Scenes that fit any rig: what stands where the views of both devices meet."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from retrue.errors import InputError
from retrue.geometry.arrays import FloatArray
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.rig import Rig
from retrue.simulation.surfaces import Box, Paint, Sphere, Wall

Piece = Wall | Sphere | Box
Triple = tuple[float, float, float]

FAR = 6.0  # half size of a wall, in widths of the camera's view
SLIGHTLY_TURNED = (0.1, -0.15, 0.0)  # radians: a wall across the axis would be a special case
NEARLY_PARALLEL = 0.02  # sine of the angle between the views: below, they meet nowhere in particular
BASELINES = 5.0  # distance in that case


def meeting_distance(rig: Rig) -> float:
    """Distance along the camera's middle ray where the projector's middle ray passes nearest."""
    ray = _middle_ray(rig.camera)
    other = rig.projector_from_camera.R.T @ _middle_ray(rig.projector)
    centre = rig.projector_from_camera.inverse().t
    baseline = float(np.linalg.norm(centre))
    if not baseline > 0:
        raise InputError("simulate: expected a rig whose devices stand apart, found t = 0")
    across = np.cross(ray, other)
    sine2 = float(across @ across)
    if sine2 < NEARLY_PARALLEL**2:
        return BASELINES * baseline
    distance = float(np.cross(centre, other) @ across) / sine2
    return distance if distance > 0.5 * baseline else BASELINES * baseline


def built_in_scene(name: str, rig: Rig, distance: float) -> tuple[Piece, ...]:
    """The surfaces of a scene of `SCENES`, its middle at that distance along the camera's middle ray."""
    ray = _middle_ray(rig.camera)
    x = np.cross([0.0, 1.0, 0.0], ray)
    x /= np.linalg.norm(x)
    camera_from_stage = RigidTransform(np.stack([x, np.cross(ray, x), ray], axis=1), distance * ray)
    return SCENES[name](_Stage(camera_from_stage, distance * rig.camera.size[0] / float(rig.camera.K[0, 0])))


@dataclass(frozen=True, slots=True)
class _Stage:
    """Where to put things: x to the right, y down, z away from the camera, in widths of its view."""

    camera_from_stage: RigidTransform
    width: float

    def pose(self, at: ArrayLike, turn: ArrayLike) -> RigidTransform:
        return self.camera_from_stage @ RigidTransform.from_rotation_vector(turn, self.width * np.asarray(at))

    def wall(self, z: float, turn: Triple = SLIGHTLY_TURNED) -> Wall:
        return Wall(self.pose([0.0, 0.0, z], turn), (FAR * self.width, FAR * self.width))

    def box(self, at: Triple, half: Triple, turn: Triple = (0.0, 0.0, 0.0), paint: Paint | None = None) -> Box:
        x, y, z = half
        half_size = (x * self.width, y * self.width, z * self.width)
        return Box(self.pose(at, turn), half_size, paint or Paint())

    def ball(self, at: Triple, radius: float, paint: Paint | None = None) -> Sphere:
        centre = self.camera_from_stage.apply(self.width * np.array(at))
        return Sphere(centre, radius * self.width, paint or Paint())


def _middle_ray(device: Camera) -> FloatArray:
    """Unit vector through the middle of the device's picture, in its own frame."""
    x, y = device.unproject((np.array(device.size) - 1) / 2)
    ray = np.array([x, y, 1.0])
    return ray / np.linalg.norm(ray)


def _corner(stage: _Stage) -> tuple[Piece, ...]:
    return stage.wall(0.3, (0.0, np.pi / 4, 0.0)), stage.wall(0.3, (0.0, -np.pi / 4, 0.0))


def _step(stage: _Stage) -> tuple[Piece, ...]:
    turn = (0.1, 0.0, 0.0)
    return stage.wall(0.15, turn), stage.box((2.0, 0.0, 0.0), (2.0, FAR, 0.05), turn)


def _clutter(stage: _Stage) -> tuple[Piece, ...]:
    random = np.random.default_rng(0)

    def three(low: float, high: float) -> Triple:
        a, b, c = (float(value) for value in random.uniform(low, high, 3))
        return a, b, c

    pieces: list[Piece] = [stage.wall(0.3)]
    for k in range(8):
        x, y, z = three(-1.0, 1.0)
        at = (0.4 * x, 0.3 * y, 0.05 + 0.15 * z)
        paint, half, turn = Paint(three(0.4, 0.9)), three(0.04, 0.1), three(-1.5, 1.5)
        pieces.append(stage.ball(at, half[0], paint) if k % 2 else stage.box(at, half, turn, paint))
    return tuple(pieces)


def _texture(stage: _Stage) -> tuple[Piece, ...]:
    printed = Paint(blob_size=0.06 * stage.width, contrast=0.7, seed=1)
    panel = stage.box((0.0, 0.0, 0.3), (1.0, 1.0, 0.1), SLIGHTLY_TURNED, printed)
    return panel, stage.box((0.15, 0.05, 0.05), (0.12, 0.1, 0.02), (0.2, 0.3, 0.1), printed)


def _glossy(stage: _Stage) -> tuple[Piece, ...]:
    shiny = Paint((0.6, 0.6, 0.65), gloss=0.6)
    ball = stage.ball((-0.2, 0.0, 0.1), 0.14, shiny)
    return stage.wall(0.3), ball, stage.box((0.18, 0.02, 0.12), (0.1, 0.12, 0.06), (0.1, 0.4, 0.0), shiny)


SCENES: dict[str, Callable[[_Stage], tuple[Piece, ...]]] = {
    "wall": lambda stage: (stage.wall(0.0),),
    "corner": _corner,
    "step": _step,
    "sphere": lambda stage: (stage.wall(0.4), stage.ball((0.0, 0.0, 0.1), 0.2)),
    "clutter": _clutter,
    "texture": _texture,
    "glossy": _glossy,
}
