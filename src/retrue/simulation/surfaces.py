"""Surfaces that rays can hit: planes, spheres, boxes; in the camera frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from retrue.geometry.arrays import FloatArray, finite_array
from retrue.geometry.transform import RigidTransform

NEAREST = 1e-6  # along a ray, relative to its length: what lies nearer is the surface that it starts from


@dataclass(frozen=True, slots=True)
class Paint:
    """Albedo of a surface: one colour, or blobs of random colours of a given size printed on it.

    Attributes
    ----------
    color : red, green, blue in 0 .. 1.
    blob_size : typical size of the printed blobs, in the scene's unit; 0 for none.
    contrast : of the print, 0 .. 1.
    gloss : share of the light that is mirrored about the mirror direction, 0 .. 1.
    seed : of the print.
    """

    color: tuple[float, float, float] = (0.8, 0.8, 0.8)
    blob_size: float = 0.0
    contrast: float = 0.0
    gloss: float = 0.0
    seed: int = 0

    def albedo(self, points: FloatArray) -> FloatArray:
        """Red, green, blue (..., 3) at points (..., 3): sums of random waves, cut to a few flat levels."""
        base = np.broadcast_to(np.asarray(self.color), points.shape)
        if self.blob_size <= 0 or self.contrast <= 0:
            return base
        random = np.random.default_rng(self.seed)
        waves = random.normal(0.0, np.pi / (2 * self.blob_size), (3, 5, 3))
        phases = random.uniform(0.0, 2 * np.pi, (3, 5))
        field = np.stack(
            [np.sin(points @ waves[channel].T + phases[channel]).sum(axis=-1) for channel in range(3)], axis=-1
        )
        levels = np.clip(np.round(1.2 * field), -2, 2) / 4 + 0.5
        return base * (1 - self.contrast * levels)


class Surface(Protocol):
    """Anything that rays can hit."""

    @property
    def paint(self) -> Paint: ...

    def distance(self, origin: FloatArray, direction: FloatArray) -> FloatArray:
        """(N,) along each ray, in lengths of its direction, inf for none.

        `origin` is (3,) or (N, 3), `direction` (N, 3).
        """
        ...

    def normals(self, origin: FloatArray, direction: FloatArray, distance: FloatArray) -> FloatArray:
        """(N, 3) outwards, of rays that meet it at those distances."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Wall:
    """A plane through `point`; or, with `half_size`, the rectangle about it along the axes of `pose`'s x and y.

    Attributes
    ----------
    pose : frame of the wall, X_camera = R X_wall + t: the wall is its z = 0.
    half_size : (x, y) half extents, inf for an endless wall.
    """

    pose: RigidTransform
    half_size: tuple[float, float] = (np.inf, np.inf)
    paint: Paint = field(default_factory=Paint)

    @classmethod
    def facing(cls, distance: float, tilt: ArrayLike = (0.0, 0.0, 0.0), paint: Paint | None = None) -> Wall:
        """An endless wall across the optical axis at `distance`, turned by the rotation vector `tilt` in radians."""
        pose = RigidTransform.from_rotation_vector(finite_array(tilt, (3,), "tilt"), [0.0, 0.0, distance])
        return cls(pose, paint=paint if paint is not None else Paint())

    def distance(self, origin: FloatArray, direction: FloatArray) -> FloatArray:
        o = (origin - self.pose.t) @ self.pose.R
        dx, dy, dz = (direction @ self.pose.R).T
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = -o[..., 2] / dz
            inside = np.abs(o[..., 0] + distance * dx) <= self.half_size[0]
            inside &= np.abs(o[..., 1] + distance * dy) <= self.half_size[1]
        return np.where(inside & (distance > NEAREST), distance, np.inf)

    def normals(self, origin: FloatArray, direction: FloatArray, distance: FloatArray) -> FloatArray:
        facing = -np.sign((direction @ self.pose.R)[:, 2])
        return facing[:, None] * self.pose.R[:, 2]


@dataclass(frozen=True, slots=True, eq=False)
class Sphere:
    """A ball about `centre` (3,)."""

    centre: FloatArray
    radius: float
    paint: Paint = field(default_factory=Paint)

    def distance(self, origin: FloatArray, direction: FloatArray) -> FloatArray:
        o = origin - np.asarray(self.centre, dtype=np.float64)
        a, b = dot(direction, direction), dot(o, direction)
        c = dot(o, o) - self.radius**2
        discriminant = b * b - a * c
        root = np.sqrt(np.maximum(discriminant, 0.0))
        first, second = (-b - root) / a, (-b + root) / a
        distance = np.where(first > NEAREST, first, second)
        return np.where((discriminant > 0) & (distance > NEAREST), distance, np.inf)

    def normals(self, origin: FloatArray, direction: FloatArray, distance: FloatArray) -> FloatArray:
        return (origin - np.asarray(self.centre, dtype=np.float64) + distance[:, None] * direction) / self.radius


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """A box about the origin of its own frame.

    Attributes
    ----------
    pose : X_camera = R X_box + t.
    half_size : (x, y, z) half extents.
    """

    pose: RigidTransform
    half_size: tuple[float, float, float]
    paint: Paint = field(default_factory=Paint)

    def distance(self, origin: FloatArray, direction: FloatArray) -> FloatArray:
        near, far, _ = self._slabs(origin, direction)
        enter = np.maximum(np.maximum(near[0], near[1]), near[2])
        leave = np.minimum(np.minimum(far[0], far[1]), far[2])
        return np.where((enter <= leave) & (enter > NEAREST), enter, np.inf)

    def normals(self, origin: FloatArray, direction: FloatArray, distance: FloatArray) -> FloatArray:
        near, _, d = self._slabs(origin, direction)
        axis = np.argmax(near, axis=0)
        side = np.take_along_axis(-np.sign(d), axis[None], axis=0)[0]
        return side[:, None] * self.pose.R.T[axis]

    def _slabs(self, origin: FloatArray, direction: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(3, N) where each ray enters, and leaves, the space between two opposite sides; and its direction there."""
        o = ((origin - self.pose.t) @ self.pose.R).T.reshape(3, -1)
        d = np.ascontiguousarray((direction @ self.pose.R).T)
        d[d == 0] = 1e-300
        half = np.copysign(np.asarray(self.half_size)[:, None], d)
        return (-half - o) / d, (half - o) / d, d


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Products of vectors (..., 3): a few times as quick as a sum over so short an axis."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]
