"""Whether the renderer puts a dot where the rig's geometry says, in both devices; asked before every run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from retrue.errors import InputError
from retrue.geometry.arrays import FloatArray
from retrue.geometry.transform import RigidTransform
from retrue.simulation.mitsuba_scene import Properties, bitmap, load_mitsuba, shapes, to_world
from retrue.simulation.mitsuba_stage import HERE, SCALE, Stage
from retrue.simulation.mitsuba_views import FINEST, covering_pinhole, sensor, through_lens
from retrue.simulation.surfaces import Paint, Wall

LARGEST_ERROR_PX = 0.05
SPREAD_PX = 2.5  # standard deviation of a dot
DOT_SIGMAS = 5.0  # of a dot, in standard deviations
DOT_TEXELS = 101
WALL = 9.0  # half its size, in distances
SHARES = (0.12, 0.5, 0.88)  # of the picture's width and height: where the dots are


def require_true_dots(stage: Stage) -> dict[str, float]:
    """The largest error of a dot in camera and projector, in pixels.

    The camera looks at glowing dots on a plane across its axis; the projector throws dots onto that plane, and what
    the camera sees of them is traced back to projector pixels.

    Raises
    ------
    InputError
        an error above 0.05 px, or views that do not meet at the stage's distance.
    """
    width, height = stage.rig.camera.size
    asked = np.stack(np.meshgrid(SHARES, SHARES), axis=-1).reshape(-1, 2) * [width - 1, height - 1]
    errors = {"camera": _camera_error(stage, asked), "projector": _projector_error(stage, asked)}
    for device, error in errors.items():
        if not error <= LARGEST_ERROR_PX:
            raise InputError(
                f"simulate: expected rendered dots within {LARGEST_ERROR_PX} px of where the rig puts them, "
                f"found {error:.3f} px in the {device}; is its lens model sound over the whole picture?"
            )
    return errors


def _camera_error(stage: Stage, asked: FloatArray) -> float:
    camera, mitsuba = stage.rig.camera, load_mitsuba()
    pinhole = covering_pinhole(camera, SCALE)
    half = DOT_SIGMAS * SPREAD_PX * stage.distance / float(camera.K[0, 0])
    edge = np.linspace(-DOT_SIGMAS, DOT_SIGMAS, DOT_TEXELS + 1)
    middle = (edge[1:] + edge[:-1]) / 2
    dot = np.exp(-0.5 * (middle[:, None] ** 2 + middle**2))[..., None].repeat(3, axis=-1)
    glow: Properties = {"type": "area", "radiance": bitmap(mitsuba, dot)}
    lamps: Properties = {}
    for number, ray in enumerate(camera.unproject(asked)):
        facing = RigidTransform(np.diag([1.0, -1.0, -1.0]), stage.distance * np.array([*ray, 1.0]))
        pose = to_world(mitsuba, facing, (half, half, 1.0))
        lamps[f"dot_{number}"] = {"type": "rectangle", "to_world": pose, "emitter": glow}
    view = sensor(mitsuba, pinhole, HERE, stage.distance, samples=1)
    parts = {"integrator": {"type": "path", "max_depth": 1}, "sensor": view, **lamps}
    rendered = replace(stage, shapes={}).render(parts, seed=0)
    seen = through_lens(rendered[..., :1], pinhole, camera, SCALE)[..., 0]
    return max(_distance(_centroid(seen, pixel), pixel) for pixel in asked)


def _projector_error(stage: Stage, asked: FloatArray) -> float:
    rig = stage.rig
    rays = np.column_stack([rig.camera.unproject(asked), np.ones(len(asked))])
    thrown = rig.projector.project(rig.projector_from_camera.apply(stage.distance * rays))
    dots = np.round(thrown[rig.projector.contains(np.nan_to_num(thrown, nan=-1e9), margin=-DOT_SIGMAS * SPREAD_PX)])
    if len(dots) == 0:
        raise InputError(
            f"simulate: expected camera and projector to see one place, but at distance {stage.distance:g} {rig.unit} "
            "they do not; give another --distance"
        )
    width, height = rig.projector.size
    y, x = (np.mgrid[0 : FINEST * height, 0 : FINEST * width] - (FINEST - 1) / 2) / FINEST
    raster = np.zeros_like(x)
    for u, v in dots:
        raster += np.exp(-0.5 * ((x - u) ** 2 + (y - v) ** 2) / SPREAD_PX**2)
    facing = RigidTransform(np.eye(3), np.array([0.0, 0.0, stage.distance]))
    half = WALL * stage.distance
    wall = Wall(facing, (half, half), Paint((1.0, 1.0, 1.0)))
    bare = replace(stage, shapes=shapes([wall], monochrome=False), samples=SCALE**2, bounces=1)
    light = bare.projected(raster[..., None].repeat(3, axis=-1), seed=0)[..., 0]
    back = rig.projector_from_camera.inverse()
    errors: list[float] = []
    for dot in dots:
        beam = back.R @ np.array([*rig.projector.unproject(dot), 1.0])
        point = back.t + beam * (stage.distance - back.t[2]) / beam[2]
        seen = rig.camera.unproject(_centroid(light, rig.camera.project(point)))
        found = rig.projector.project(rig.projector_from_camera.apply(stage.distance * np.array([*seen, 1.0])))
        errors.append(_distance(found, dot))
    return max(errors)


def _centroid(picture: FloatArray, near: FloatArray) -> FloatArray:
    """(x, y) of the dot near a pixel; NaN where there is none."""
    reach = int(2 * DOT_SIGMAS * SPREAD_PX)
    height, width = picture.shape
    x, y = (int(value) for value in np.round(near))
    left, right, top, bottom = (
        max(x - reach, 0),
        min(x + reach + 1, width),
        max(y - reach, 0),
        min(y + reach + 1, height),
    )
    part = picture[top:bottom, left:right]
    with np.errstate(invalid="ignore"):
        return (
            np.array([part.sum(axis=0) @ np.arange(left, right), part.sum(axis=1) @ np.arange(top, bottom)])
            / part.sum()
        )


def _distance(a: FloatArray, b: FloatArray) -> float:
    return float(np.linalg.norm(a - b))
