"""Two photographs of a textured scene by the two cameras of a rig, in even light; and the truth of every pixel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.rig import Rig
from retrue.simulation.camera_model import CameraModel
from retrue.simulation.scene import BAND, first_hit, pixel_grid
from retrue.simulation.surfaces import Paint, Surface

NEARLY = 1e-3  # relative depth by which the second camera's view of a point may differ from the point's own


@dataclass(frozen=True, slots=True)
class Texture(Paint):
    """Flecks of many sizes, each half as large as the one before, with sharp edges: as in nature, at any distance.

    Lattice noise of hashed corners, each octave cut to three levels.

    Attributes
    ----------
    fleck : the largest, in the scene's unit.
    octaves : how many sizes.
    depth : share of the light that flecks take at most, 0 .. 1.
    period : flecks after which the print repeats, a whole number, as on wallpaper; 0: it never does.
    """

    fleck: float = 100.0
    octaves: int = 5
    depth: float = 0.8
    period: int = 0

    def albedo(self, points: FloatArray) -> FloatArray:
        """Red, green, blue (..., 3) at points (..., 3)."""
        flat = points.reshape(-1, 3)
        taken = np.zeros((len(flat), 3))
        for octave in range(self.octaves):
            noise = self._noise(flat * (2.0**octave / self.fleck), octave)
            taken += np.clip(np.floor(3 * (2 * noise - 0.5)), 0, 2)[:, None] / 2 * TINTS[octave % len(TINTS)]
        share = self.depth * taken / self.octaves
        return (np.asarray(self.color) * (1 - share)).reshape(points.shape)

    def _noise(self, places: FloatArray, octave: int) -> FloatArray:
        """(N,) trilinear noise in 0 .. 1."""
        corner = np.floor(places)
        along = places - corner
        cell = corner.astype(np.int64)
        total = np.zeros(len(places))
        for offset in np.ndindex(2, 2, 2):
            weight = np.prod(np.where(offset, along, 1 - along), axis=1)
            total += weight * self._hashed(cell + np.array(offset), octave)
        return total

    def _hashed(self, cell: IntArray, octave: int) -> FloatArray:
        """(N,) a number in 0 .. 1 for each cell (N, 3), the same whenever it is asked."""
        if self.period:
            cell = np.mod(cell, self.period * 2**octave)
        mixed = np.full(len(cell), np.uint64(1 + octave + 1000 * self.seed))
        with np.errstate(over="ignore"):
            for axis in range(3):
                mixed = (mixed ^ cell[:, axis].astype(np.uint64)) * np.uint64(0x9E3779B97F4A7C15)
                mixed ^= mixed >> np.uint64(29)
            mixed *= np.uint64(0xBF58476D1CE4E5B9)
        return (mixed >> np.uint64(40)).astype(np.float64) / 2**24


TINTS = np.array([[1.0, 0.9, 0.8], [0.8, 1.0, 0.9], [0.9, 0.8, 1.0], [1.0, 1.0, 1.0], [1.0, 0.8, 0.7]])


@dataclass(frozen=True, slots=True, eq=False)
class Photographed:
    """A pair, and the truth at the first photograph's pixel centres.

    Attributes
    ----------
    left, right : (h, w, 3) uint8, each of its camera's size.
    depth : (h, w) Z in the first camera's frame; NaN where nothing is.
    right_px : (h, w, 2) where the second camera sees the same point; NaN where it does not.
    """

    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    depth: FloatArray
    right_px: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class TexturedScene:
    """Surfaces in the first camera's frame, and what stands in another place when the second photograph is taken.

    Attributes
    ----------
    surfaces : in both photographs.
    moved : in their place for the second camera; empty where nothing moved.
    """

    surfaces: Sequence[Surface]
    moved: Sequence[Surface] = field(default_factory=tuple)


def photograph(
    rig: Rig,
    scene: TexturedScene,
    model: CameraModel | None = None,
    *,
    right_model: CameraModel | None = None,
    seed: int = 0,
    supersample: int = 2,
) -> Photographed:
    """What both cameras of a rig see of a scene in even light, at one time.

    Parameters
    ----------
    rig : the first camera, and the second in the projector's place.
    model, right_model : what the cameras do to light; the second's is the first's where none is given.
    supersample : squared, rays a pixel.
    """
    model = model or CameraModel(exposure=0.9, blur_px=0.6, electrons=10_000, read_noise=10)
    second = scene.moved or scene.surfaces
    pose = rig.projector_from_camera
    left = _view(rig.camera, RigidTransform.identity(), scene.surfaces, supersample)
    right = _view(rig.projector, pose, second, supersample)
    pictures = [
        (model if index == 0 or right_model is None else right_model).picture(light, seed + index)
        for index, light in enumerate((left, right))
    ]
    depth, right_px = _truth(rig, scene.surfaces, second)
    return Photographed(pictures[0], pictures[1], depth, right_px)


def _view(camera: Camera, pose: RigidTransform, surfaces: Sequence[Surface], supersample: int) -> FloatArray:
    """(h, w, 3) light of a camera that stands at `pose`, camera from world."""
    width, height = camera.size
    fractions = (np.arange(supersample) + 0.5) / supersample - 0.5
    light = np.zeros((height, width, 3))
    for top in range(0, height, BAND):
        rows = np.arange(top, min(top + BAND, height))
        for dy in fractions:
            for dx in fractions:
                point, surface = _seen(camera, pose, surfaces, pixel_grid(rows + dy, np.arange(width) + dx))
                light[rows] += _colors(point, surface, surfaces)
    return light / supersample**2


def _seen(
    camera: Camera, pose: RigidTransform, surfaces: Sequence[Surface], pixels: FloatArray
) -> tuple[FloatArray, IntArray]:
    """World points (..., 3) that pixels (..., 2) show, NaN of nothing, and which surface they are of."""
    rays = camera.unproject(pixels).reshape(-1, 2)
    direction = np.concatenate([rays, np.ones((len(rays), 1))], axis=1) @ pose.R
    source = -pose.t @ pose.R
    distance, surface = first_hit(surfaces, source, direction)
    point = source + np.where(np.isfinite(distance), distance, np.nan)[:, None] * direction
    return point.reshape(*pixels.shape[:-1], 3), surface.reshape(pixels.shape[:-1])


def _colors(point: FloatArray, surface: IntArray, surfaces: Sequence[Surface]) -> FloatArray:
    light = np.zeros(point.shape)
    for index, item in enumerate(surfaces):
        here: BoolArray = surface == index
        if here.any():
            light[here] = item.paint.albedo(point[here])
    return light


def _truth(rig: Rig, surfaces: Sequence[Surface], second: Sequence[Surface]) -> tuple[FloatArray, FloatArray]:
    """Depth, and the second camera's pixel of what both see in one place."""
    width, height = rig.camera.size
    grid = pixel_grid(np.arange(height), np.arange(width))
    point, _ = _seen(rig.camera, RigidTransform.identity(), surfaces, grid)
    there = rig.projector_from_camera.apply(point)
    right_px = rig.projector.project(there)
    known = np.isfinite(right_px).all(axis=-1) & rig.projector.contains(np.nan_to_num(right_px, nan=-9.0))
    asked = np.where(known[..., None], right_px, 0.0)
    met, _ = _seen(rig.projector, rig.projector_from_camera, second, asked)
    gap = np.linalg.norm(met - point, axis=-1)
    with np.errstate(invalid="ignore"):
        same = known & (gap < NEARLY * np.linalg.norm(there, axis=-1))
    return point[..., 2], np.where(same[..., None], right_px, np.nan)


def textured_scene(
    rig: Rig, distance: float, seed: int = 0, *, period: int = 0, wall_only: bool = False
) -> TexturedScene:
    """A wall at that distance with boxes and balls before it, all at random; or the wall alone.

    Parameters
    ----------
    period : flecks after which the wall's print repeats; 0 for a print that never does.
    """
    from retrue.simulation.surfaces import Box, Sphere, Wall

    random = np.random.default_rng(seed)
    print_on = Texture(fleck=distance / 12, seed=seed + 1, period=period)
    tilt = random.uniform(-0.4, 0.4, 3) * [1, 1, 0]
    items: list[Surface] = [Wall.facing(distance, tilt=tilt, paint=print_on)]
    if not wall_only:
        reach = np.array(rig.camera.size) / rig.camera.K[[0, 1], [0, 1]] / 2
        for number in range(5):
            depth = distance * random.uniform(0.45, 0.8)
            centre = np.array([*(random.uniform(-0.8, 0.8, 2) * reach * depth), depth])
            paint = replace(print_on, seed=seed + 2 + number, period=0, fleck=distance / 20)
            size = distance * random.uniform(0.05, 0.12, 3)
            pose = RigidTransform.from_rotation_vector(random.normal(0, 0.6, 3), centre)
            items.append(Sphere(centre, float(size[0]), paint) if number % 2 else Box(pose, tuple(size), paint))
    return TexturedScene(tuple(items))
