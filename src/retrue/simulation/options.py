"""What a simulated capture can be told."""

from __future__ import annotations

import math
from dataclasses import dataclass

from retrue.errors import InputError


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

    distance: float | None = None
    seed: int = 0
    samples: int = 16
    bounces: int = 2
    ambient: float = 0.03
    projector_blur_px: float = 0.4
    exposure: float = 0.7
    blur_px: float = 0.6
    vignetting: float = 0.1
    mixing: float = 0.05
    electrons: float = 20_000.0
    read_noise: float = 5.0
    gamma: float = 1.0
    bayer: bool = False

    def __post_init__(self) -> None:
        ranges = {
            "distance": (self.distance, 1e-12, 1e12),
            "seed": (self.seed, 0, 2**32 - 1),
            "samples": (self.samples, 4, 65536),
            "bounces": (self.bounces, 1, 64),
            "ambient": (self.ambient, 0, 100),
            "projector-blur-px": (self.projector_blur_px, 0, 100),
            "exposure": (self.exposure, 1e-6, 1e6),
            "blur-px": (self.blur_px, 0, 100),
            "vignetting": (self.vignetting, 0, 1),
            "mixing": (self.mixing, 0, 0.5),
            "electrons": (self.electrons, 1, math.inf),
            "read-noise": (self.read_noise, 0, 1e9),
            "gamma": (self.gamma, 0.1, 10),
        }
        for name, (value, low, high) in ranges.items():
            if value is not None and not low <= value <= high:
                raise InputError(f"--{name}: expected {low:g} to {high:g}, found {value:g}")
        if self.samples % 4 or math.isqrt(self.samples // 4) ** 2 != self.samples // 4:
            raise InputError(f"--samples: expected 4 times a square number (4, 16, 36, 64 ...), found {self.samples}")
