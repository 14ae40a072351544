"""From light at the sensor to the numbers in a picture: everything that makes decoding hard."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from retrue.geometry.arrays import FloatArray

Mixing = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]
NO_MIXING: Mixing = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True, slots=True)
class CameraModel:
    """What a camera does to light.

    Attributes
    ----------
    exposure : picture value, 0 .. 1, of a white wall in full white light, before vignetting.
    mixing : rows: what the camera's red, green, blue see of the light's red, green, blue.
    blur_px : standard deviation of the lens's blur.
    vignetting : share of the light that is lost in the corners.
    electrons : of a full pixel; the shot noise is their square root. inf for none.
    read_noise : electrons.
    gamma : picture = light ** (1 / gamma).
    bayer : whether a colour mosaic samples the channels, which are then interpolated.
    """

    exposure: float = 0.7
    mixing: Mixing = NO_MIXING
    blur_px: float = 0.6
    vignetting: float = 0.0
    electrons: float = np.inf
    read_noise: float = 0.0
    gamma: float = 1.0
    bayer: bool = False

    def picture(self, light: FloatArray, seed: int = 0) -> NDArray[np.uint8]:
        """(h, w, 3) uint8 of light (h, w, 3); 1 is a white wall in full white light."""
        random = np.random.default_rng(seed)
        h, w = light.shape[:2]
        y, x = np.mgrid[0:h, 0:w]
        radius2 = ((x - (w - 1) / 2) ** 2 + (y - (h - 1) / 2) ** 2) / ((w / 2) ** 2 + (h / 2) ** 2)
        seen: FloatArray = gaussian_blur(light, self.blur_px) @ np.asarray(self.mixing).T
        seen *= (self.exposure * (1 - self.vignetting * radius2))[..., None]
        if np.isfinite(self.electrons):
            counted = np.minimum(seen, 1.0) * self.electrons
            spread = np.sqrt(np.maximum(counted, 0.0) + self.read_noise**2)
            seen = (counted + spread * random.normal(size=seen.shape)) / self.electrons
        if self.bayer:
            seen = _demosaic(seen)
        value = np.clip(seen, 0.0, 1.0) ** (1 / self.gamma) * 255
        return np.floor(value + 0.5).astype(np.uint8)


def gaussian_blur(image: FloatArray, sigma: float) -> FloatArray:
    """`image` (h, w, channels) blurred by a Gaussian, its border repeated outwards."""
    if sigma <= 0:
        return image
    reach = int(np.ceil(4 * sigma))
    weights: FloatArray = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    weights /= weights.sum()
    for axis in (0, 1):
        pad = [(0, 0)] * image.ndim
        pad[axis] = (reach, reach)
        padded = np.pad(image, pad, mode="edge")
        size = int(image.shape[axis])
        total = np.zeros_like(image)
        for shift in range(len(weights)):
            window = slice(shift, shift + size)
            total += weights[shift] * (padded[window] if axis == 0 else padded[:, window])
        image = total
    return image


def _demosaic(seen: FloatArray) -> FloatArray:
    """Sample red, green, green, blue in 2x2 tiles, and fill in between by the mean of the nearest samples."""
    h, w = seen.shape[:2]
    y, x = np.mgrid[0:h, 0:w] % 2
    masks = ((y == 0) & (x == 0), (y + x) == 1, (y == 1) & (x == 1))
    result = np.empty_like(seen)
    for channel, mask in enumerate(masks):
        values = np.pad(np.where(mask, seen[..., channel], 0.0), 1, mode="reflect")
        weights = np.pad(mask.astype(np.float64), 1, mode="reflect")
        total, weight = np.zeros((h, w)), np.zeros((h, w))
        for dy in range(3):
            for dx in range(3):
                factor = (1, 2, 1)[dy] * (1, 2, 1)[dx]
                total += factor * values[dy : dy + h, dx : dx + w]
                weight += factor * weights[dy : dy + h, dx : dx + w]
        result[..., channel] = np.where(mask, seen[..., channel], total / weight)
    return result
