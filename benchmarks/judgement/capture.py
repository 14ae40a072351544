"""What a camera sees of a scene that a projector lights: matched pixels, with the noise of a decoder."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import retrue

from .lens import Array, Generator
from .rig import Rig
from .scene import Scene


@dataclass(frozen=True)
class Noise:
    """`sigma` in camera pixels per axis; `tails`: Student's t of 3 degrees of freedom; `slow`: a smooth field, RMS.

    `uneven`: by how much it is louder along the axis at that `angle` (radians) than across it.
    """

    sigma: float
    tails: bool = False
    slow: float = 0.0
    uneven: float = 1.0
    angle: float = 0.0

    def draw(self, rng: Generator, pixels: Array, size: tuple[int, int]) -> Array:
        error = rng.standard_t(3, pixels.shape) / np.sqrt(3) if self.tails else rng.normal(size=pixels.shape)
        axis = np.array([np.cos(self.angle), np.sin(self.angle)])
        spread = self.uneven**-0.5 * np.eye(2) + (self.uneven**0.5 - self.uneven**-0.5) * np.outer(axis, axis)
        error = error @ spread if self.uneven != 1 else error
        waves = rng.uniform(-1.2, 1.2, (2, 2)) * 2 * np.pi / np.array(size)
        return error * self.sigma + self.slow * np.sqrt(2) * np.sin(pixels @ waves.T + rng.uniform(0, 2 * np.pi, 2))


def uneven_noise(rng: Generator) -> Noise:
    """Of stripes, or of blocks seen aslant: up to five times as loud along one axis as across it."""
    return replace(random_noise(rng), uneven=float(np.exp(rng.uniform(0, np.log(5)))), angle=rng.uniform(0, np.pi))


def heavy_tails(rng: Generator) -> Noise:
    """Of any level, some points ten or more times as far off as the usual one."""
    return replace(random_noise(rng), tails=True)


def random_noise(rng: Generator) -> Noise:
    """0.05 to 0.5 px; a quarter with heavier tails, a quarter with an error that neighbours share."""
    sigma = float(np.exp(rng.uniform(np.log(0.05), np.log(0.5))))
    return Noise(sigma, bool(rng.random() < 0.25), float(rng.uniform(0.02, 0.1)) if rng.random() < 0.25 else 0.0)


@dataclass(frozen=True)
class Capture:
    """N matches and the truth behind them.

    Attributes
    ----------
    camera_px, projector_px : (N, 2) as decoded.
    points, normals : (N, 3) where the surface was met, camera frame; its normal toward the devices.
    labels : (N,) the piece of the scene; `flat` (N,) whether that is a plane.
    right : (N,) false where a fault made the match wrong.
    """

    camera_px: Array
    projector_px: Array
    points: Array
    normals: Array
    labels: Array
    flat: Array
    right: Array
    cells: Array
    noise: Noise
    camera_size: tuple[int, int]
    projector_size: tuple[int, int]
    light: Array | None = None
    light_class: Array | None = None

    def __len__(self) -> int:
        return len(self.camera_px)

    def public(self) -> retrue.Correspondences:
        """What `retrue` is told; optional columns as far as it has them by now."""
        optional: dict[str, Any] = {
            "light": self.light,
            "light_class": self.light_class,
            "camera_size": self.camera_size,
            "projector_size": self.projector_size,
        }
        known = retrue.Correspondences.__dataclass_fields__
        told = {name: value for name, value in optional.items() if name in known and value is not None}
        return retrue.Correspondences(self.camera_px, self.projector_px, cells=self.cells, **told)

    def select(self, rows: Array) -> Capture:
        """The same, with only those rows."""
        columns = ("camera_px", "projector_px", "points", "normals", "labels", "flat", "right", "cells")
        light = {n: v[rows] for n in ("light", "light_class") if (v := getattr(self, n)) is not None}
        return replace(self, **{name: getattr(self, name)[rows] for name in columns}, **light)

    def span(self) -> float:
        """Share of the picture's width or height that the points reach over, whichever is more."""
        low, high = np.percentile(self.camera_px, [1, 99], axis=0)
        return float(((high - low) / np.array(self.camera_size)).max())

    def slant(self) -> float:
        """Median angle, radians, between the surface's normal and the line to the camera."""
        cosine = -(self.normals * self.points).sum(axis=1) / np.linalg.norm(self.points, axis=1)
        return float(np.arccos(np.clip(np.median(cosine), -1, 1)))


def see(rig: Rig, scene: Scene, pixels: Array) -> tuple[Array, Array, Array, Array]:
    """Camera pixels (N, 2), points, normals and labels of projector pixels; NaN and -1 where the camera sees none.

    A point is seen where nothing stands between it and the camera, from the side that is lit, inside the picture.
    """
    rays = rig.projector.rays(pixels) @ rig.R
    points, normals, labels = scene.trace(rig.place, rays)
    camera_px = rig.camera.project(points)
    with np.errstate(invalid="ignore"):
        lit_side = (normals * points).sum(axis=1) < 0
    shown = np.flatnonzero((labels >= 0) & rig.camera.inside(camera_px) & lit_side)
    first = scene.trace(np.zeros(3), points[shown])[0]
    hidden = ~(np.abs(first - points[shown]).max(axis=1) < 1e-6 * np.abs(points[shown]).max(axis=1))
    gone = np.ones(len(pixels), dtype=bool)
    gone[shown[~hidden]] = False
    camera_px[gone], points[gone], normals[gone], labels[gone] = np.nan, np.nan, np.nan, -1
    return camera_px, points, normals, labels


def capture(
    rng: Generator, rig: Rig, scene: Scene, span: float = 1.0, count: int | None = None, noise: Noise | None = None
) -> Capture | None:
    """Blocks of a grid as far as they fall into a window of `span` of the camera's picture; None where hardly any do.

    `count` is about how many; 400 to 2000 if not given, and one capture of eight is dense (6000).
    """
    noise = noise or random_noise(rng)
    size = np.array(rig.camera.size)
    corner = rng.uniform(0, 1 - span, 2) * size if span < 1 else np.zeros(2)
    width, height = rig.projector.size
    step = max(width, height) / 48
    coarse = _grid(np.zeros(2), np.array([width, height]) - 1.0, step)[0]
    seen = _window(see(rig, scene, coarse)[0], corner, span * size)
    if np.count_nonzero(seen) < 4:
        return None
    low, high = coarse[seen].min(axis=0) - step, coarse[seen].max(axis=0) + step
    low, high = np.maximum(low, 0), np.minimum(high, np.array([width, height]) - 1.0)
    dense = count is None and rng.random() < 1 / 8
    count = count or (6000 if dense else int(np.exp(rng.uniform(np.log(400), np.log(2000)))))
    pitch = max(1.0, float(np.sqrt(np.count_nonzero(seen) * step**2 / count)))
    pixels, cells = _grid(low, high, pitch)
    camera_px, points, normals, labels = see(rig, scene, pixels)
    good = _window(camera_px, corner, span * size)
    if np.count_nonzero(good) < 40:
        return None
    camera_px, pixels, labels = camera_px[good], pixels[good], labels[good]
    return Capture(
        camera_px + noise.draw(rng, camera_px, rig.camera.size),
        pixels,
        points[good],
        normals[good],
        labels,
        scene.is_flat(labels),
        np.ones(len(labels), dtype=bool),
        cells[good],
        noise,
        rig.camera.size,
        rig.projector.size,
    )


def _grid(low: Array, high: Array, pitch: float) -> tuple[Array, Array]:
    """Pixels (N, 2), and (row, column) of each."""
    columns, rows = (np.arange(a, b + 1e-9, pitch) for a, b in zip(low, high, strict=True))
    i, j = np.meshgrid(np.arange(len(rows)), np.arange(len(columns)), indexing="ij")
    return np.stack([columns[j.ravel()], rows[i.ravel()]], axis=1), np.stack([i.ravel(), j.ravel()], axis=1)


def _window(pixels: Array, corner: Array, size: Array) -> Array:
    with np.errstate(invalid="ignore"):
        return ((pixels >= corner - 0.5) & (pixels <= corner + size - 0.5)).all(axis=1)
