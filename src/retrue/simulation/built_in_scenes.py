"""Scenes that fit any rig: what stands where the views of both devices meet."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from retrue.errors import InputError
from retrue.geometry.arrays import FloatArray
from retrue.geometry.transform import RigidTransform, rotation_from_vector
from retrue.rig import Rig
from retrue.simulation.surfaces import Box, Paint, Sphere, Wall

Builder = Callable[[RigidTransform, float], tuple[Wall | Sphere | Box, ...]]
FAR = 6.0  # half size of a wall, in widths of the camera's view
NEARLY_PARALLEL = 0.02  # sine of the angle between the views: below, they meet nowhere in particular
BASELINES = 5.0  # distance in that case


def meeting_distance(rig: Rig) -> float:
    """Distance along the camera's middle ray where the projector's middle ray passes nearest."""
    ray, other = _middle_ray(rig, "camera"), _middle_ray(rig, "projector")
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


def built_in_scene(name: str, rig: Rig, distance: float) -> tuple[Wall | Sphere | Box, ...]:
    """The surfaces of a scene of `SCENES`, its middle at that distance along the camera's middle ray."""
    ray = _middle_ray(rig, "camera")
    x = np.cross([0.0, 1.0, 0.0], ray)
    x /= np.linalg.norm(x)
    camera_from_stage = RigidTransform(np.stack([x, np.cross(ray, x), ray], axis=1), distance * ray)
    width = distance * rig.camera.size[0] / float(rig.camera.K[0, 0])
    return SCENES[name](camera_from_stage, width)


def _middle_ray(rig: Rig, device: str) -> FloatArray:
    """Unit vector in the camera's frame."""
    camera = rig.camera if device == "camera" else rig.projector
    x, y = camera.unproject((np.array(camera.size) - 1) / 2)
    ray = np.array([x, y, 1.0]) / np.sqrt(x * x + y * y + 1)
    return ray if device == "camera" else rig.projector_from_camera.R.T @ ray


def _placed(stage: RigidTransform, width: float, at: tuple[float, float, float], turn: FloatArray) -> RigidTransform:
    return stage @ RigidTransform(turn, width * np.array(at))


def _wall(
    stage: RigidTransform,
    width: float,
    at: tuple[float, float, float] = (0.0, 0.0, 0.0),
    turn: tuple[float, float, float] = (0.1, -0.15, 0.0),
    paint: Paint | None = None,
) -> Wall:
    pose = _placed(stage, width, at, rotation_from_vector(turn))
    return Wall(pose, (FAR * width, FAR * width), paint if paint is not None else Paint())


def _box(
    stage: RigidTransform,
    width: float,
    at: tuple[float, float, float],
    half: tuple[float, float, float],
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0),
    paint: Paint | None = None,
) -> Box:
    pose = _placed(stage, width, at, rotation_from_vector(turn))
    x, y, z = half
    return Box(pose, (x * width, y * width, z * width), paint if paint is not None else Paint())


def _ball(
    stage: RigidTransform, width: float, at: tuple[float, float, float], radius: float, paint: Paint | None = None
) -> Sphere:
    return Sphere(stage.apply(width * np.array(at)), radius * width, paint if paint is not None else Paint())


def _corner(stage: RigidTransform, width: float) -> tuple[Wall | Sphere | Box, ...]:
    at = (0.0, 0.0, 0.3)
    return _wall(stage, width, at, (0.0, np.pi / 4, 0.0)), _wall(stage, width, at, (0.0, -np.pi / 4, 0.0))


def _step(stage: RigidTransform, width: float) -> tuple[Wall | Sphere | Box, ...]:
    turn = (0.1, 0.0, 0.0)
    return _wall(stage, width, (0.0, 0.0, 0.15), turn), _box(stage, width, (2.0, 0.0, 0.0), (2.0, FAR, 0.05), turn)


def _sphere(stage: RigidTransform, width: float) -> tuple[Wall | Sphere | Box, ...]:
    return _wall(stage, width, (0.0, 0.0, 0.4)), _ball(stage, width, (0.0, 0.0, 0.1), 0.2)


def _clutter(stage: RigidTransform, width: float) -> tuple[Wall | Sphere | Box, ...]:
    random = np.random.default_rng(0)
    items: list[Wall | Sphere | Box] = [_wall(stage, width, (0.0, 0.0, 0.3))]
    for k in range(8):
        x, y, z = random.uniform([-0.4, -0.3, -0.1], [0.4, 0.3, 0.2])
        red, green, blue = random.uniform(0.4, 0.9, 3)
        paint = Paint((float(red), float(green), float(blue)))
        size = random.uniform(0.04, 0.1, 3)
        if k % 2:
            items.append(_ball(stage, width, (x, y, z), float(size[0]), paint))
        else:
            turn, half = random.normal(size=3), (float(size[0]), float(size[1]), float(size[2]))
            items.append(_box(stage, width, (x, y, z), half, (float(turn[0]), float(turn[1]), float(turn[2])), paint))
    return tuple(items)


def _texture(stage: RigidTransform, width: float) -> tuple[Wall | Sphere | Box, ...]:
    print_ = Paint(blob_size=0.06 * width, contrast=0.7, seed=1)
    card = _box(stage, width, (0.15, 0.05, 0.05), (0.12, 0.1, 0.02), (0.2, 0.3, 0.1), print_)
    return _box(stage, width, (0.0, 0.0, 0.3), (1.0, 1.0, 0.1), (0.1, -0.15, 0.0), print_), card


def _glossy(stage: RigidTransform, width: float) -> tuple[Wall | Sphere | Box, ...]:
    shiny = Paint((0.6, 0.6, 0.65), gloss=0.6)
    return (
        _wall(stage, width, (0.0, 0.0, 0.3)),
        _ball(stage, width, (-0.2, 0.0, 0.1), 0.14, shiny),
        _box(stage, width, (0.18, 0.02, 0.12), (0.1, 0.12, 0.06), (0.1, 0.4, 0.0), shiny),
    )


SCENES: dict[str, Builder] = {
    "wall": lambda stage, width: (_wall(stage, width),),
    "corner": _corner,
    "step": _step,
    "sphere": _sphere,
    "clutter": _clutter,
    "texture": _texture,
    "glossy": _glossy,
}
