"""Surfaces as Mitsuba shapes; the world is the camera's frame, in the rig's unit."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from retrue.errors import FileError, InputError
from retrue.geometry.arrays import FloatArray
from retrue.geometry.transform import RigidTransform
from retrue.simulation.surfaces import Box, Paint, Sphere, Wall

VARIANT = "scalar_rgb"  # runs on any machine: the faster variants need an LLVM library or a GPU
TEXELS = 1024  # a side of a printed surface
ROUGHNESS = 0.15  # of glossy paint

Properties = dict[str, Any]


@dataclass(frozen=True, slots=True)
class MeshFile:
    """Triangles from a PLY or OBJ file, in the camera's frame and the rig's unit."""

    path: Path
    paint: Paint = field(default_factory=Paint)


Item = Wall | Sphere | Box | MeshFile


def load_mitsuba() -> Any:
    """The renderer, as a module; an `InputError` that names the extra where it is not installed."""
    if find_spec("mitsuba") is None:
        raise InputError('simulate: expected the renderer Mitsuba 3, which is not installed: pip install ".[simulate]"')
    mitsuba = import_module("mitsuba")
    mitsuba.set_variant(VARIANT)
    mitsuba.set_log_level(mitsuba.LogLevel.Error)
    return mitsuba


def shapes(items: Iterable[Item], monochrome: bool) -> Properties:
    """One Mitsuba shape an item, in that order; a monochrome camera sees paints by the mean of their channels."""
    mitsuba = load_mitsuba()
    found: Properties = {}
    for number, item in enumerate(items):
        shape, surface = _shape(mitsuba, item)
        paint = _paint(mitsuba, item.paint, surface, monochrome)
        try:
            made = mitsuba.load_dict({**shape, "bsdf": paint})
        except RuntimeError as error:
            problem = str(error).strip().splitlines()[-1].strip()
            if isinstance(item, MeshFile):
                raise FileError(item.path, f"cannot be read as a mesh: {problem}") from error
            raise InputError(f"simulate: Mitsuba cannot make a {type(item).__name__}: {problem}") from error
        if isinstance(item, MeshFile) and made.face_count() == 0:
            raise FileError(item.path, "expected a mesh, found no triangles")
        found[f"item_{number:03d}"] = made
    return found


def to_world(
    mitsuba: Any, camera_from_item: RigidTransform, scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
) -> Any:
    """Mitsuba's transform of a frame that is first scaled along its axes."""
    matrix = np.eye(4)
    matrix[:3, :3] = camera_from_item.R * np.array(scale)
    matrix[:3, 3] = camera_from_item.t
    return mitsuba.ScalarTransform4f(matrix)


def _shape(mitsuba: Any, item: Item) -> tuple[Properties, FloatArray]:
    """The shape, and points (TEXELS, TEXELS, 3) at its texture coordinates: what is printed there."""
    v, u = (np.mgrid[0:TEXELS, 0:TEXELS] + 0.5) / TEXELS
    match item:
        case Wall():
            x, y = item.half_size
            if not np.isfinite([x, y]).all():
                raise InputError("simulate: expected walls of finite size, found an endless one")
            shape: Properties = {"type": "rectangle", "to_world": to_world(mitsuba, item.pose, (x, y, 1.0))}
            return shape, np.stack([2 * x * u, 2 * y * v, 0 * u], axis=-1)
        case Box():
            shape = {"type": "cube", "to_world": to_world(mitsuba, item.pose, item.half_size)}
            side = 2 * max(item.half_size)
            return shape, np.stack([side * u, side * v, 0 * u], axis=-1)
        case Sphere():
            shape = {"type": "sphere", "center": np.asarray(item.centre).tolist(), "radius": item.radius}
            around, down = 2 * np.pi * u, np.pi * v
            ring = np.stack([np.sin(down) * np.cos(around), np.sin(down) * np.sin(around), np.cos(down)], axis=-1)
            return shape, item.radius * ring
        case MeshFile():
            kind = item.path.suffix.lower().lstrip(".")
            if kind not in ("ply", "obj"):
                raise FileError(item.path, "expected a mesh, .ply or .obj")
            return {"type": kind, "filename": str(item.path), "face_normals": True}, np.zeros((1, 1, 3))


def _paint(mitsuba: Any, paint: Paint, surface: FloatArray, monochrome: bool) -> Properties:
    printed = paint.blob_size > 0 and paint.contrast > 0
    albedo = paint.albedo(surface) if printed else np.asarray(paint.color)
    if monochrome:
        albedo = np.broadcast_to(albedo.mean(axis=-1, keepdims=True), albedo.shape)
    reflectance: Properties = {"type": "rgb", "value": albedo.tolist()}
    if printed:
        reflectance = bitmap(mitsuba, albedo)
    if paint.gloss > 0:
        # Its own lobe reaches every direction a little, so that what is lit is never quite black.
        inside: Properties = {
            "type": "roughplastic",
            "alpha": ROUGHNESS,
            "diffuse_reflectance": reflectance,
            "specular_reflectance": {"type": "rgb", "value": paint.gloss},
        }
    else:
        inside = {"type": "diffuse", "reflectance": reflectance}
    return {"type": "twosided", "bsdf": inside}


def bitmap(mitsuba: Any, values: FloatArray) -> Properties:
    """A texture of linear values (h, w, 3)."""
    picture = mitsuba.Bitmap(np.ascontiguousarray(values, dtype=np.float32))
    return {"type": "bitmap", "bitmap": picture, "raw": True, "filter_type": "bilinear", "wrap_mode": "clamp"}
