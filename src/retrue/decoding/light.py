"""Where a picture still tells how bright it was."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray, Image
from retrue.kernels import surroundings as kernel

FULL = 0.99
"""Of full scale: from there on a sensor may have seen any more light; JPEG leaves 255 a little below itself."""

SENSOR_BITS = (10, 12, 14)
"""Of cameras whose pictures are stored in 16 bits, many as they come, in the lower of these."""

BLUR, BLUR_DOUBT = 0.4, 0.2
"""Variance of the camera's blur, of lens and pixel together, px^2, and one sigma of what it may be otherwise: a camera
in focus blurs by 0.45 to 0.77 px."""


def filling_their_scale(images: Sequence[Image]) -> Sequence[Image]:
    """Pictures of 16 bits, of which none uses more than a sensor's fewer, shifted up to the whole scale; others as
    they are. Else 4095 of 12 bits would not be known as the end of the scale, and all would look dark."""
    if not images or any(image.dtype != np.uint16 for image in images):
        return images
    brightest = max(int(image.max(initial=0)) for image in images)
    bits = next((bits for bits in SENSOR_BITS if brightest < 1 << bits), 16)
    return [image << np.uint16(16 - bits) for image in images] if bits < 16 else images


def saturated(pixels: Image) -> BoolArray:
    """(N,) where any channel of `pixels`, (N,) or (N, channels), is at its end."""
    end = pixels >= FULL * np.iinfo(pixels.dtype).max
    return end if end.ndim == 1 else end[:, 0] | end[:, 1] | end[:, 2]


def around(picture: Image, centre_px: FloatArray) -> Image:
    """(N, 9, channels) the pixels about each (x, y) of `centre_px`, all inside the picture (h, w, channels)."""
    height, width, channels = picture.shape
    found = np.empty((len(centre_px), 9, channels), picture.dtype)
    pixels, places = np.ascontiguousarray(picture).reshape(-1), np.rint(centre_px).astype(np.int64)
    kernel.gather(pixels, height, width, channels, np.ascontiguousarray(places), found.reshape(-1))
    return found


def mean_levels(picture: Image, centre_px: FloatArray) -> FloatArray:
    """(N, channels) their mean."""
    means = np.empty((len(centre_px), picture.shape[2]))
    kernel.mean_levels(around(picture, centre_px), means)
    return means
