"""A picture that a rig takes of a scene, with the exact truth beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.rig import Rig
from retrue.simulation.camera_model import CameraModel, gaussian_blur
from retrue.simulation.surfaces import Surface

NOTHING = -1
BAND = 64  # rows that are rendered at a time, to save memory
SHADOW_GAP = 1e-4  # relative to the distance from the projector


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Surfaces, and the room's light on them.

    Attributes
    ----------
    surfaces : in the camera frame, in the rig's unit.
    ambient : red, green, blue of the room's light; 1 is as bright as the projector's white at `bright_at`.
    bright_at : distance from the projector at which its white has brightness 1; None: no fall-off.
    """

    surfaces: Sequence[Surface]
    ambient: tuple[float, float, float] = (0.03, 0.03, 0.03)
    bright_at: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Rendered:
    """A picture and, at its pixel centres, the truth.

    Attributes
    ----------
    image : (h, w, 3) uint8, red, green, blue.
    depth : (h, w) Z in the camera frame; NaN where nothing is.
    projector_px : (h, w, 2) the projector pixel that looks there; NaN where it cannot.
    visible : (h, w) whether the projector's light gets there.
    surface : (h, w) index of the surface seen, -1 for none.
    """

    image: NDArray[np.uint8]
    depth: FloatArray
    projector_px: FloatArray
    visible: BoolArray
    surface: IntArray


def render(
    rig: Rig,
    scene: Scene,
    projected: NDArray[np.uint8],
    camera_model: CameraModel | None = None,
    seed: int = 0,
    supersample: int = 2,
    projector_blur_px: float = 0.4,
) -> Rendered:
    """What the rig's camera sees while its projector shows `projected` (h, w, 3).

    Lambert shading with a mirror lobe for glossy paint, cast shadows, no light from surface to surface. Each
    pixel is the mean of `supersample` squared rays; the truth is that of its centre.
    """
    model = camera_model if camera_model is not None else CameraModel()
    lamp = gaussian_blur(projected.astype(np.float64) / 255.0, projector_blur_px)
    width, height = rig.camera.size
    light = np.zeros((height, width, 3))
    fractions = (np.arange(supersample) + 0.5) / supersample - 0.5
    for top in range(0, height, BAND):
        rows = np.arange(top, min(top + BAND, height))
        for dy in fractions:
            for dx in fractions:
                rays = _trace(rig, scene, _grid(rows + dy, np.arange(width) + dx))
                light[rows] += _light(scene, lamp, rays).reshape(len(rows), width, 3)
    centres = [
        _trace(rig, scene, _grid(np.arange(top, min(top + BAND, height)), np.arange(width)))
        for top in range(0, height, BAND)
    ]
    return Rendered(
        image=model.picture(light / supersample**2, seed),
        depth=np.concatenate([np.where(rays.hit, rays.depth, np.nan) for rays in centres]).reshape(height, width),
        projector_px=np.concatenate([rays.projector_px for rays in centres]).reshape(height, width, 2),
        visible=np.concatenate([rays.lit for rays in centres]).reshape(height, width),
        surface=np.concatenate([rays.surface for rays in centres]).reshape(height, width),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Rays:
    """What (N,) rays of the camera meet, in its frame, and how the projector stands to it."""

    direction: FloatArray
    hit: BoolArray
    depth: FloatArray
    surface: IntArray
    point: FloatArray
    normal: FloatArray
    projector_px: FloatArray
    beam: FloatArray
    distance: FloatArray
    cosine: FloatArray
    lit: BoolArray


def _grid(y: FloatArray | IntArray, x: FloatArray | IntArray) -> FloatArray:
    return np.stack(np.meshgrid(x, y), axis=-1).astype(np.float64)


def _trace(rig: Rig, scene: Scene, pixels: FloatArray) -> _Rays:
    """The rays through camera pixels (h, w, 2), row by row."""
    rays = rig.camera.unproject(pixels).reshape(-1, 2)
    direction = np.concatenate([rays, np.ones((len(rays), 1))], axis=1)
    depth, surface, normal = _first_hit(scene, np.zeros(3), direction)
    hit = np.isfinite(depth)
    point = np.where(hit, depth, 1.0)[:, None] * direction
    projector_px = rig.projector.project(rig.projector_from_camera.apply(point))
    projector_px[~hit] = np.nan
    source = rig.projector_from_camera.inverse().t
    beam = point - source
    distance = np.sqrt(_dot(beam, beam))
    cosine = -_dot(normal, beam) / distance
    with np.errstate(invalid="ignore"):
        lit = hit & rig.projector.contains(projector_px) & (cosine > 0)
    for item in scene.surfaces:
        lit &= item.hit(source, beam)[0] > 1 - SHADOW_GAP
    return _Rays(direction, hit, depth, surface, point, normal, projector_px, beam, distance, cosine, lit)


def _light(scene: Scene, lamp: FloatArray, rays: _Rays) -> FloatArray:
    """(N, 3) what comes back along the rays."""
    count = len(rays.point)
    albedo, gloss = np.zeros((count, 3)), np.zeros(count)
    for index, item in enumerate(scene.surfaces):
        here = rays.surface == index
        albedo[here] = item.paint.albedo(rays.point[here])
        gloss[here] = item.paint.gloss
    falloff = np.ones(count) if scene.bright_at is None else (scene.bright_at / rays.distance) ** 2
    shown = np.zeros((count, 3))
    shown[rays.lit] = _bilinear(lamp, rays.projector_px[rays.lit]) * falloff[rays.lit, None]
    reflected = albedo * np.maximum(rays.cosine, 0.0)[:, None]
    if gloss.any():
        mirrored = rays.beam / rays.distance[:, None] + 2 * rays.cosine[:, None] * rays.normal
        toward = -rays.direction / np.sqrt(_dot(rays.direction, rays.direction))[:, None]
        reflected += (gloss * np.maximum(_dot(mirrored, toward), 0.0) ** 40)[:, None]
    light = shown * reflected + albedo * np.asarray(scene.ambient)
    light[~rays.hit] = 0.0
    return light


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.einsum("ij,ij->i", a, b)


def _first_hit(scene: Scene, origin: FloatArray, direction: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
    nearest = np.full(len(direction), np.inf)
    index = np.full(len(direction), NOTHING)
    normal = np.zeros((len(direction), 3))
    for number, surface in enumerate(scene.surfaces):
        distance, outward = surface.hit(origin, direction)
        nearer = distance < nearest
        nearest = np.where(nearer, distance, nearest)
        index[nearer] = number
        normal = np.where(nearer[:, None], outward, normal)
    return nearest, index, normal


def _bilinear(image: FloatArray, at: FloatArray) -> FloatArray:
    """`image` (h, w, 3) at points (N, 2), (x, y); beyond its border as on it."""
    h, w = image.shape[:2]
    x, y = np.clip(at[:, 0], 0, w - 1), np.clip(at[:, 1], 0, h - 1)
    x0, y0 = np.minimum(x.astype(np.int64), w - 2), np.minimum(y.astype(np.int64), h - 2)
    fx, fy = (x - x0)[:, None], (y - y0)[:, None]
    pixels, first = image.reshape(h * w, -1), y0 * w + x0
    corners: list[FloatArray] = [pixels.take(first + step, axis=0) for step in (0, 1, w, w + 1)]
    upper = corners[0] * (1 - fx) + corners[1] * fx
    lower = corners[2] * (1 - fx) + corners[3] * fx
    return upper * (1 - fy) + lower * fy
