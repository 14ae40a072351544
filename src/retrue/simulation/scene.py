"""A picture that a rig takes of a scene, with the exact truth beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.rig import Rig
from retrue.simulation.camera_model import CameraModel, gaussian_blur
from retrue.simulation.surfaces import Surface, dot

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
    centres: list[Seen] = []
    for top in range(0, height, BAND):
        rows = np.arange(top, min(top + BAND, height))
        centres.append(look(rig, scene, pixel_grid(rows, np.arange(width))))
        for dy, dx in product(fractions, fractions):
            central = dy == dx == 0
            seen = centres[-1] if central else look(rig, scene, pixel_grid(rows + dy, np.arange(width) + dx))
            light[rows] += seen.light(lamp)
    return Rendered(
        image=model.picture(light / supersample**2, seed),
        depth=np.concatenate([part.depth for part in centres]),
        projector_px=np.concatenate([part.projector_px for part in centres]),
        visible=np.concatenate([part.visible for part in centres]),
        surface=np.concatenate([part.surface for part in centres]),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What rays through camera pixels (h, w) meet.

    Attributes
    ----------
    gain : (h, w, 3) share of the projector's light at `projector_px` that comes back along the ray.
    room : (h, w, 3) the room's light.
    """

    gain: FloatArray
    room: FloatArray
    depth: FloatArray
    projector_px: FloatArray
    visible: BoolArray
    surface: IntArray

    def light(self, lamp: FloatArray) -> FloatArray:
        """(h, w, 3) under a projector that shows `lamp`."""
        rows = np.flatnonzero(self.visible)
        light = self.room.reshape(-1, 3).copy()
        light[rows] += _bilinear(lamp, self.projector_px.reshape(-1, 2)[rows]) * self.gain.reshape(-1, 3)[rows]
        return light.reshape(self.room.shape)


def pixel_grid(y: FloatArray | IntArray, x: FloatArray | IntArray) -> FloatArray:
    return np.stack(np.meshgrid(x, y), axis=-1).astype(np.float64)


def look(rig: Rig, scene: Scene, pixels: FloatArray) -> Seen:
    """What the rays through camera pixels (h, w, 2) meet."""
    shape = pixels.shape[:-1]
    rays = rig.camera.unproject(pixels).reshape(-1, 2)
    direction = np.concatenate([rays, np.ones((len(rays), 1))], axis=1)
    centre = np.zeros(3)
    depth, surface = first_hit(scene.surfaces, centre, direction)
    hit = np.isfinite(depth)
    point = np.where(hit, depth, 1.0)[:, None] * direction
    normal = np.zeros((len(rays), 3))
    of_surfaces = [(item, np.flatnonzero(surface == index)) for index, item in enumerate(scene.surfaces)]
    for item, here in of_surfaces:
        normal[here] = item.normals(centre, direction[here], depth[here])

    in_projector = rig.projector_from_camera.apply(point)
    projector_px = rig.projector.project(in_projector)
    projector_px[~hit] = np.nan
    source = rig.projector_from_camera.inverse().t
    beam = point - source
    distance = np.sqrt(dot(beam, beam))
    cosine = -dot(normal, beam) / distance
    with np.errstate(invalid="ignore"):
        lit = hit & rig.projector.contains(projector_px) & (cosine > 0)
    shadow, _ = first_hit(scene.surfaces, source, beam[lit])
    lit[lit] = shadow > 1 - SHADOW_GAP

    albedo, gloss = np.zeros((len(rays), 3)), np.zeros(len(rays))
    for item, here in of_surfaces:
        albedo[here] = item.paint.albedo(point[here])
        gloss[here] = item.paint.gloss
    falloff = 1.0 if scene.bright_at is None else (scene.bright_at / distance) ** 2
    gain = albedo * np.maximum(cosine, 0.0)[:, None]
    if gloss.any():
        mirrored = beam / distance[:, None] + 2 * cosine[:, None] * normal
        toward = -direction / np.sqrt(dot(direction, direction))[:, None]
        gain += (gloss * np.maximum(dot(mirrored, toward), 0.0) ** 40)[:, None]
    gain = (lit * falloff)[:, None] * gain
    return Seen(
        gain=gain.reshape(*shape, 3),
        room=(albedo * np.asarray(scene.ambient)).reshape(*shape, 3),
        depth=np.where(hit, depth, np.nan).reshape(shape),
        projector_px=projector_px.reshape(*shape, 2),
        visible=lit.reshape(shape),
        surface=surface.reshape(shape),
    )


def first_hit(surfaces: Sequence[Surface], origin: FloatArray, direction: FloatArray) -> tuple[FloatArray, IntArray]:
    """Of each ray (N, 3): distance in its own lengths, inf for none; which surface, -1 for none."""
    nearest = np.full(len(direction), np.inf)
    index = np.full(len(direction), NOTHING)
    for number, surface in enumerate(surfaces):
        distance = surface.distance(origin, direction)
        index[distance < nearest] = number
        nearest = np.minimum(nearest, distance)
    return nearest, index


def _bilinear(image: FloatArray, at: FloatArray) -> FloatArray:
    """`image` (h, w, 3) at points (N, 2), (x, y); beyond its border as on it."""
    h, w = image.shape[:2]
    x, y = np.clip(at[:, 0], 0, w - 1), np.clip(at[:, 1], 0, h - 1)
    x0, y0 = np.minimum(x.astype(np.int64), w - 2), np.minimum(y.astype(np.int64), h - 2)
    fx, fy = (x - x0)[:, None], (y - y0)[:, None]
    flat, at_corner = image.reshape(h * w, -1), y0 * w + x0
    upper_left, upper_right, lower_left, lower_right = (flat[at_corner + step] for step in (0, 1, w, w + 1))
    upper = upper_left * (1 - fx) + upper_right * fx
    lower = lower_left * (1 - fx) + lower_right * fx
    return upper * (1 - fy) + lower * fy
