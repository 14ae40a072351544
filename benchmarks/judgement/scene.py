"""Surfaces that rays are traced to, and scenes of them at a given distance, in the camera's frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .lens import Array, Generator
from .rig import tilted, turn

NOWHERE = np.inf


@dataclass(frozen=True)
class Flats:
    """M flat rectangles: middles (M, 3); axes (M, 3, 3) with rows u, v, normal; half (M, 2) their half sides."""

    middles: Array
    axes: Array
    half: Array
    flat = True

    def hit(self, start: Array, rays: Array) -> tuple[Array, Array]:
        """For N rays the length to the nearest (N,), and which it is."""
        lift = np.einsum("mij,mj->im", self.axes, start - self.middles)  # the start in each one's frame
        with np.errstate(all="ignore"):
            length = -lift[2] / (rays @ self.axes[:, 2].T)
            good = length > 0
            for k in range(2):
                good &= np.abs(lift[k] + (rays @ self.axes[:, k].T) * length) <= self.half[:, k]
        return _nearest(np.where(good, length, NOWHERE))

    def normals(self, points: Array, which: Array) -> Array:
        return self.axes[which, 2]


@dataclass(frozen=True)
class Balls:
    """M spheres, seen from outside: a ball, or a head put together from some."""

    middles: Array
    radii: Array
    flat = False

    def hit(self, start: Array, rays: Array) -> tuple[Array, Array]:
        to = start - self.middles
        a = (rays**2).sum(axis=1)[:, None]
        b = rays @ to.T
        c = (to**2).sum(axis=1) - self.radii**2
        with np.errstate(all="ignore"):
            length = (-b - np.sqrt(b * b - a * c)) / a
        return _nearest(np.where(length > 0, length, NOWHERE))

    def normals(self, points: Array, which: Array) -> Array:
        return (points - self.middles[which]) / self.radii[which, None]


@dataclass(frozen=True)
class Cylinder:
    """Endless, round; seen from outside."""

    middle: Array
    axis: Array
    radius: float
    flat = False

    def hit(self, start: Array, rays: Array) -> tuple[Array, Array]:
        across, to = (v - np.outer(v @ self.axis, self.axis) for v in (rays, (start - self.middle)[None]))
        a, b, c = (across**2).sum(axis=1), across @ to[0], to[0] @ to[0] - self.radius**2
        with np.errstate(all="ignore"):
            length = (-b - np.sqrt(b * b - a * c)) / a
        return np.where(length > 0, length, NOWHERE), np.zeros(len(rays), dtype=int)

    def normals(self, points: Array, which: Array) -> Array:
        to = points - self.middle
        return (to - np.outer(to @ self.axis, self.axis)) / self.radius


@dataclass(frozen=True)
class Relief:
    """A height above a plane: axes rows u, v, up (toward the viewer); bumps (K, 4): u, v, width, height of each."""

    middle: Array
    axes: Array
    bumps: Array
    bow: float = 0.0  # height = bow (u^2 + v^2) too
    flat = False

    def height(self, u: Array, v: Array) -> Array:
        total = self.bow * (u * u + v * v)
        for at_u, at_v, width, height in self.bumps:
            total = total + height * np.exp(-((u - at_u) ** 2 + (v - at_v) ** 2) / (2 * width * width))
        return total

    def hit(self, start: Array, rays: Array) -> tuple[Array, Array]:
        origin, slope = self.axes @ (start - self.middle), rays @ self.axes.T
        top, bottom = (self.bumps[:, 3][np.sign(self.bumps[:, 3]) == s].sum() for s in (1, -1))
        with np.errstate(all="ignore"):
            base = -origin[2] / slope[:, 2]  # the length at which the ray meets the plane itself
            first, last = ((level - origin[2]) / slope[:, 2] for level in (top, bottom))
        if self.bow:  # slight: Newton from the plane finds it
            first = last = base
        steps = np.linspace(0, 1, 25 if len(self.bumps) else 1)[:, None]
        lengths = first + (last - first) * steps
        gap = self._gap(origin, slope, lengths)
        below = (gap <= 0).argmax(axis=0) if len(steps) > 1 else np.zeros(len(rays), dtype=int)
        columns = np.arange(len(rays))
        low, high = lengths[np.maximum(below - 1, 0), columns], lengths[below, columns]
        for _ in range(10 if len(steps) > 1 else 0):  # halved until Newton's step is safe
            middle = (low + high) / 2
            over = self._gap(origin, slope, middle) > 0
            low, high = np.where(over, middle, low), np.where(over, high, middle)
        length = (low + high) / 2
        for _ in range(4):
            h = 1e-6 * np.abs(length)
            before, after = (self._gap(origin, slope, length + d) for d in (-h, h))
            with np.errstate(all="ignore"):
                length = length - self._gap(origin, slope, length) * 2 * h / (after - before)
        with np.errstate(all="ignore"):
            good = (length > 0) & (np.abs(self._gap(origin, slope, length)) < 1e-9 * np.abs(length))
        return np.where(good, length, NOWHERE), np.zeros(len(rays), dtype=int)

    def _gap(self, origin: Array, slope: Array, length: Array) -> Array:
        u, v, z = (origin[k] + slope[:, k] * length for k in range(3))
        return z - self.height(u, v)

    def normals(self, points: Array, which: Array) -> Array:
        u, v, _ = ((points - self.middle) @ self.axes.T).T
        du, dv = 2 * self.bow * u, 2 * self.bow * v
        for at_u, at_v, width, height in self.bumps:
            bump = height * np.exp(-((u - at_u) ** 2 + (v - at_v) ** 2) / (2 * width * width)) / width**2
            du, dv = du - (u - at_u) * bump, dv - (v - at_v) * bump
        normal = np.stack([-du, -dv, np.ones_like(u)], axis=1) @ self.axes
        return normal / np.linalg.norm(normal, axis=1, keepdims=True)


Surface = Flats | Balls | Cylinder | Relief


@dataclass(frozen=True)
class Scene:
    """Surfaces; the first one met is seen. `things` are those that can be moved by themselves."""

    surfaces: tuple[Surface, ...]

    def trace(self, start: Array, rays: Array) -> tuple[Array, Array, Array]:
        """Points (N, 3), unit normals (N, 3) toward `start`, and label (N,) of the piece; NaN and -1 where none is."""
        found = [surface.hit(start, rays) for surface in self.surfaces]
        best, length = _nearest(np.stack([f[0] for f in found], axis=1))[::-1]
        points = start + rays * np.where(np.isfinite(length), length, np.nan)[:, None]
        normals, labels = np.full_like(points, np.nan), np.full(len(rays), -1)
        for k, (surface, (_, which)) in enumerate(zip(self.surfaces, found, strict=True)):
            mine = (best == k) & np.isfinite(length)
            normals[mine] = surface.normals(points[mine], which[mine])
            labels[mine] = 1000 * k + which[mine]
        away = np.einsum("ij,ij->i", normals, start - points) < 0
        normals[away] *= -1
        return points, normals, labels

    def is_flat(self, labels: Array) -> Array:
        return np.array([s.flat for s in self.surfaces])[labels // 1000] & (labels >= 0)


def _nearest(lengths: Array) -> tuple[Array, Array]:
    which = lengths.argmin(axis=1)
    return lengths[np.arange(len(lengths)), which], which


def facing(normal: Array, spin: float = 0.0) -> Array:
    """Rows u, v, n for a unit normal."""
    u = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    u /= np.linalg.norm(u)
    v = np.cross(normal, u)
    c, s = np.cos(spin), np.sin(spin)
    return np.stack([c * u + s * v, c * v - s * u, normal])


def flats(*pieces: tuple[Array, Array, tuple[float, float]]) -> Flats:
    """Of (middle, axes, half sides) each."""
    middles, axes, half = zip(*pieces, strict=True)
    return Flats(np.array(middles), np.array(axes), np.array(half, dtype=float))


ENDLESS = (np.inf, np.inf)
TOWARD = np.array([0.0, 0.0, -1.0])  # from the scene to the camera


def a_wall(rng: Generator, distance: float, most: float = 60.0) -> tuple[Array, Array]:
    """A point on it and its axes; its normal up to that many degrees off the camera's axis."""
    middle = distance * np.array([0, 0, rng.uniform(0.9, 1.1)])
    return middle, facing(tilted(rng, TOWARD, np.radians(rng.uniform(0, most))))


def box(middle: Array, axes: Array, half: Array) -> list[tuple[Array, Array, tuple[float, float]]]:
    """Its six faces."""
    faces = []
    for k in range(3):
        for sign in (-1, 1):
            u, v, n = axes[(k + 1) % 3], axes[(k + 2) % 3], sign * axes[k]
            faces.append((middle + half[k] * n, np.stack([u, v, n]), (half[(k + 1) % 3], half[(k + 2) % 3])))
    return faces


def wall(rng: Generator, distance: float) -> Scene:
    return Scene((flats((*a_wall(rng, distance), ENDLESS)),))


def wall_and_object(rng: Generator, distance: float) -> Scene:
    """A ball or a box of 3 to 8 % of the distance, before the wall."""
    middle, axes = a_wall(rng, distance, 45)
    size = distance * rng.uniform(0.03, 0.08)
    at = middle + axes.T @ (distance * np.array([*rng.uniform(-0.08, 0.08, 2), rng.uniform(0.05, 0.2)]))
    if rng.random() < 0.5:
        return Scene((flats((middle, axes, ENDLESS)), Balls(at[None], np.array([size]))))
    faces = box(at, turn(rng.normal(size=3)), size * rng.uniform(0.5, 1, 3))
    return Scene((flats((middle, axes, ENDLESS)), flats(*faces)))


def corner(rng: Generator, distance: float, planes: int = 2) -> Scene:
    """Two or three walls that meet about the middle of the picture, seen from the inside."""
    edge = distance * np.array([*rng.uniform(-0.05, 0.05, 2), rng.uniform(1, 1.2)])
    around = rng.uniform(0, 2 * np.pi)
    pieces = []
    for k in range(planes):
        phi, tilt = around + 2 * np.pi * k / planes, np.radians(rng.uniform(25, 55))
        normal = np.array([np.sin(tilt) * np.cos(phi), np.sin(tilt) * np.sin(phi), -np.cos(tilt)])
        pieces.append((edge, facing(normal), ENDLESS))
    return Scene((flats(*pieces),))


def three_planes(rng: Generator, distance: float) -> Scene:
    return corner(rng, distance, 3)


def parallel_planes(rng: Generator, distance: float) -> Scene:
    """A wall, and a board before it, parallel, that hides a half of it or less."""
    middle, axes = a_wall(rng, distance, 40)
    step, size = distance * rng.uniform(0.04, 0.2), distance * rng.uniform(0.08, 0.3, 2)
    side = axes[0] * size[0] * rng.choice([-1, 1])
    board = (middle + axes[2] * step + side, axes, (float(size[0]), float(size[1])))
    return Scene((flats((middle, axes, ENDLESS), board),))


def boxes_on_wall(rng: Generator, distance: float) -> Scene:
    middle, axes = a_wall(rng, distance, 45)
    faces = [(middle, axes, ENDLESS)]
    for _ in range(rng.integers(2, 6)):
        half = distance * rng.uniform(0.02, 0.09, 3)
        at = middle + axes.T @ np.array([*(distance * rng.uniform(-0.2, 0.2, 2)), half[2]])
        faces += box(at, turn(np.array([0, 0, rng.uniform(0, 3)])) @ axes, half)
    return Scene((flats(*faces),))


def ball(rng: Generator, distance: float) -> Scene:
    at = distance * np.array([*rng.uniform(-0.04, 0.04, 2), 1])
    return Scene((Balls(at[None], np.array([distance * rng.uniform(0.08, 0.3)])),))


def head(rng: Generator, distance: float) -> Scene:
    """A skull, a jaw, a nose, ears, shoulders: spheres that run into one another."""
    size = distance * rng.uniform(0.1, 0.22)
    parts = [((0, 0, 0), 1.0), ((0, 0.6, -0.2), 0.7), ((0, 0.15, -0.95), 0.2), ((0.95, 0, 0), 0.22)]
    parts += [((-0.95, 0, 0), 0.22), ((0.7, 2.2, 0.2), 1.0), ((-0.7, 2.2, 0.2), 1.0)]
    where = np.array([p for p, _ in parts]) + rng.normal(0, 0.05, (len(parts), 3))
    radii = np.array([r for _, r in parts]) * rng.uniform(0.85, 1.15, len(parts))
    R = turn(rng.normal(0, 0.25, 3))
    return Scene((Balls(np.array([0, 0, distance]) + size * where @ R.T, size * radii),))


def terrain(rng: Generator, distance: float) -> Scene:
    middle, axes = a_wall(rng, distance, 40)
    bumps = np.column_stack(
        [
            distance * rng.uniform(-0.3, 0.3, (8, 2)),
            distance * rng.uniform(0.06, 0.2, 8),
            distance * rng.uniform(0.01, 0.08, 8) * rng.choice([-1, 1], 8),
        ]
    )
    return Scene((Relief(middle, axes, bumps),))


def cylinder(rng: Generator, distance: float) -> Scene:
    radius = distance * rng.uniform(0.08, 0.4)
    axis = tilted(rng, np.array([0.0, 1, 0]), rng.uniform(0, 1.2))
    return Scene((Cylinder(np.array([0, 0, distance * 0.9 + radius]), axis, radius),))


def clutter(rng: Generator, distance: float) -> Scene:
    """Small pieces at any depth, turned any way."""
    count = int(rng.integers(30, 80))
    depth = distance * rng.uniform(0.75, 1.4, count)
    at = np.column_stack([depth * rng.uniform(-0.4, 0.4, count), depth * rng.uniform(-0.3, 0.3, count), depth])
    axes = np.array([facing(tilted(rng, TOWARD, rng.uniform(0, 0.9))) for _ in range(count)])
    return Scene((Flats(at, axes, distance * rng.uniform(0.02, 0.06, (count, 2))),))


def bowed_board(rng: Generator, distance: float) -> Scene:
    """Off its plane by 0.02 to 0.2 % of the distance at 0.3 of it from its middle."""
    middle, axes = a_wall(rng, distance, 45)
    bow = distance * 10 ** rng.uniform(-3.7, -2.7) * rng.choice([-1, 1]) / (0.3 * distance) ** 2
    return Scene((Relief(middle, axes, np.zeros((0, 4)), bow),))


def across(rng: Generator, distance: float, normal: Array) -> Scene:
    """A wall with about that normal."""
    normal = tilted(rng, normal, rng.uniform(0, 0.02))
    return Scene((flats((np.array([0, 0, distance]), facing(normal), ENDLESS)),))


SCENES: dict[str, Callable[[Generator, float], Scene]] = {
    "wall": wall,
    "object": wall_and_object,
    "corner": corner,
    "three planes": three_planes,
    "parallel": parallel_planes,
    "boxes": boxes_on_wall,
    "ball": ball,
    "head": head,
    "terrain": terrain,
    "cylinder": cylinder,
    "clutter": clutter,
    "bowed": bowed_board,
}
NO_PLANE = ("ball", "head", "terrain", "cylinder", "clutter")
RICH = ("object", "corner", "three planes", "parallel", "boxes")
