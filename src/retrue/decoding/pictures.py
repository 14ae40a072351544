"""What every decoder of one picture does to it first, and what it says of it last."""

from __future__ import annotations

from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from retrue.decoding.light import mean_levels
from retrue.errors import InputError
from retrue.geometry.arrays import FloatArray, Image

GRAY_CHROMA = 6.0  # grey levels between channels that noise and white balance explain
DARK_SHARE, BRIGHT_SHARE = 0.1, 0.9  # of full scale


def scene_light(image: Image, black: Image | None, white: Image | None) -> Image:
    """The picture as RGB, without the room's light and without paint, as far as those are known."""
    picture = rgb(image, "image")
    if black is not None:
        dark = rgb(black, "black")
        _same_size(picture, dark, "black")
        picture = cast(Image, cv2.subtract(picture, dark))
    if white is not None:
        lit = rgb(white, "white")
        _same_size(picture, lit, "white")
        full = lit if black is None else cast(Image, cv2.subtract(lit, rgb(black, "black")))
        # Where white light adds next to nothing there is nothing to divide by, and nothing to see.
        least = 0.04 * float(full.max())
        picture = np.asarray(cv2.divide(picture, np.maximum(full, np.asarray(max(least, 1), full.dtype)), scale=200.0))
        picture = np.minimum(picture, 255).astype(np.uint8)
    return picture


def rgb(image: Image, name: str) -> Image:
    """`image` in three channels, or an `InputError` that names it."""
    image = np.asarray(image)
    if image.dtype.name not in ("uint8", "uint16") or image.ndim not in (2, 3) or image.size == 0:
        raise InputError(f"{name}: expected a picture (h, w, 3) of uint8 or uint16, found {image.dtype} {image.shape}")
    if image.ndim == 3 and image.shape[2] == 3:
        return np.ascontiguousarray(image)
    if image.ndim == 2 or image.shape[2] == 1:
        return np.repeat(image.reshape(*image.shape[:2], 1), 3, axis=2)
    raise InputError(f"{name}: expected three channels (red, green, blue), found {image.shape[2]}")


def seen_levels(picture: Image, places_px: FloatArray, name: str) -> FloatArray:
    """(N, 3) mean of the pixels about each place (N, 2), in the picture's own levels."""
    return mean_levels(rgb(picture, name), places_px)


def seen_colors(picture: Image, places_px: FloatArray, name: str) -> NDArray[np.uint8]:
    """(N, 3) the same in eight bits."""
    return eight_bits(seen_levels(picture, places_px, name), picture)


def eight_bits(levels: FloatArray, picture: Image) -> NDArray[np.uint8]:
    """Levels of a picture, in 0 .. 255."""
    full = float(np.iinfo(picture.dtype).max)
    return np.clip(np.rint(levels * (255 / full)), 0, 255).astype(np.uint8)


def _same_size(image: Image, other: Image, name: str) -> None:
    if image.shape != other.shape or image.dtype != other.dtype:
        raise InputError(
            f"{name}: expected {image.dtype} {image.shape} as the picture, found {other.dtype} {other.shape}"
        )


def coverage(points: FloatArray, width: int, height: int) -> float:
    """Share of the picture inside the convex hull of the points."""
    if len(points) < 3:
        return 0.0
    hull = cv2.convexHull(points.astype(np.float32))
    return float(cv2.contourArea(hull)) / (width * height)


def unusable_picture(picture: Image) -> str:
    """Why nobody could decode colours from a picture (h, w, 3), in one sentence; empty where it may be decoded."""
    few = picture[::3, ::3].astype(np.float64)
    full = float(np.iinfo(picture.dtype).max)
    bright = np.percentile(few.max(axis=-1), 99)
    if bright < DARK_SHARE * full:
        return "too dark: expose longer, or dim the room and brighten the projector"
    if np.median(few.min(axis=-1)) > BRIGHT_SHARE * full:
        return "overexposed: expose shorter"
    chroma = np.percentile(few.max(axis=-1) - few.min(axis=-1), 99) * 255 / full
    return "not a colour picture" if chroma < GRAY_CHROMA else ""
