"""What a simulated capture can be told."""

from __future__ import annotations

import math
from dataclasses import dataclass

from retrue.errors import InputError
from retrue.ranges import check_ranges, ranged


@dataclass(frozen=True, slots=True)
class SimulateOptions:
    """Light, camera and noise of a simulated capture.

    Attributes
    ----------
    distance
        Of the scene's middle from the camera, in the rig's unit; by default where the views of both devices meet.
        The projector's white is as bright as exposure says there.
    seed
        Of all noise; the same seed gives the same pictures.
    samples
        Light paths for a camera pixel, 4 times a square number; fewer are noisier.
    bounces
        How often light is followed from surface to surface.
    ambient
        The room's light, as a share of the projector's white.
    projector_blur_px
        Standard deviation of the projector's blur, in its pixels.
    exposure
        Picture value, 0 to 1, of a white wall in the projector's white.
    blur_px
        Standard deviation of the camera's blur.
    vignetting
        Share of the light that the camera's lens loses in the corners.
    mixing
        Share of each colour that the camera sees as its neighbours.
    electrons
        Of a full pixel; its shot noise is their square root.
    read_noise
        In electrons.
    gamma
        Picture = light ^ (1 / gamma).
    bayer
        A colour mosaic before the sensor.
    """

    distance: float | None = ranged(None, 1e-12, 1e12)
    seed: int = ranged(0, 0, 2**32 - 1)
    samples: int = ranged(16, 4, 65536)
    bounces: int = ranged(2, 1, 64)
    ambient: float = ranged(0.03, 0, 100)
    projector_blur_px: float = ranged(0.4, 0, 100)
    exposure: float = ranged(0.7, 1e-6, 1e6)
    blur_px: float = ranged(0.6, 0, 100)
    vignetting: float = ranged(0.1, 0, 1)
    mixing: float = ranged(0.05, 0, 0.5)
    electrons: float = ranged(20_000.0, 1)
    read_noise: float = ranged(5.0, 0, 1e9)
    gamma: float = ranged(1.0, 0.1, 10)
    bayer: bool = False

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.samples % 4 or math.isqrt(self.samples // 4) ** 2 != self.samples // 4:
            raise InputError(f"samples: expected 4 times a square number (4, 16, 36, 64 ...), found {self.samples}")
