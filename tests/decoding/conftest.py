"""A synthetic Gray-code capture: what a camera sees of a surface on which the projector's pixel is known exactly."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from retrue.patterns.gray_code import GrayCode

Mapping = Callable[[NDArray[np.float64], NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]]
SAMPLES = 5
"""Per pixel and axis: the camera integrates over its pixel."""


@dataclass(frozen=True)
class Shot:
    """Pictures in the contract's order, and the mapping from camera to projector pixel that they were made with."""

    pattern: GrayCode
    pictures: list[NDArray[np.uint8]]
    mapping: Mapping

    def truth(self, camera_px: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.stack(self.mapping(camera_px[:, 0], camera_px[:, 1]), axis=1)


def oblique(x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A plane seen at an angle: about two camera pixels a projector pixel."""
    z = 1 + 4e-4 * x + 2e-4 * y
    return (3.2 + 0.47 * x + 0.03 * y) / z, (2.7 - 0.02 * x + 0.45 * y) / z


def shoot(
    pattern: GrayCode,
    size: tuple[int, int] = (240, 180),
    mapping: Mapping = oblique,
    albedo: NDArray[np.float64] | None = None,
    noise: float = 1.0,
    gamma: float = 1.0,
    seed: int = 1,
) -> Shot:
    """Project, reflect, blur by the pixel, add ambient light and noise, round."""
    rng = np.random.default_rng(seed)
    width, height = size
    steps = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
    xs = (np.arange(width)[:, None] + steps).ravel()
    ys = (np.arange(height)[:, None] + steps).ravel()
    u, v = mapping(*np.meshgrid(xs, ys))
    columns, rows = np.floor(u + 0.5).astype(int), np.floor(v + 0.5).astype(int)
    lit = (columns >= 0) & (columns < pattern.projector_size[0]) & (rows >= 0) & (rows < pattern.projector_size[1])
    beyond = np.prod(pattern.projector_size)  # where it is dark
    at = np.where(lit, rows * pattern.projector_size[0] + columns, beyond)
    reflected = np.full((height, width), 0.8) if albedo is None else albedo
    pictures = []
    for shown in pattern.render():
        white = np.append(shown.ravel() == 255, False).take(at).reshape(height, SAMPLES, width, SAMPLES)
        light = np.count_nonzero(white.swapaxes(1, 2).reshape(height, width, SAMPLES**2), axis=2) / SAMPLES**2
        brightness = 230 * (reflected * (0.02 + 0.95 * light)) ** gamma + rng.normal(0, noise, light.shape)
        pictures.append(np.clip(np.rint(brightness), 0, 255).astype(np.uint8))
    return Shot(pattern, pictures, mapping)


@pytest.fixture(scope="session")
def shooting() -> Callable[..., Shot]:
    return shoot


@pytest.fixture(scope="session")
def plain_shot() -> Shot:
    return shoot(GrayCode((128, 96)))


@pytest.fixture
def pictures(plain_shot: Shot) -> Sequence[NDArray[np.uint8]]:
    """A fresh list of the plain shot's pictures, to spoil."""
    return list(plain_shot.pictures)
