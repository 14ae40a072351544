"""Pictures that a projector shows."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from retrue.devices.protocols import ProjectorDriver
from retrue.errors import InputError
from retrue.geometry.arrays import Image

Picture = NDArray[np.uint8]
"""(h, w, 3), red green blue."""


def fitting(picture: Image, projector: ProjectorDriver, name: str = "picture") -> Picture:
    """The picture (h, w) or (h, w, 3) for that projector; an `InputError` where it is of another size or depth."""
    width, height = projector.size
    if picture.dtype != np.uint8:
        raise InputError(f"{name}: expected 8 bits a channel, found {picture.dtype}")
    if picture.shape[:2] != (height, width):
        raise InputError(
            f"{name}: expected {width} x {height} pixels for {projector.name}, "
            f"found {picture.shape[1]} x {picture.shape[0]}: make the pattern for this projector"
        )
    return picture if picture.ndim == 3 else np.repeat(picture[..., None], 3, axis=2)


def black_and_white(size: tuple[int, int]) -> tuple[Picture, Picture]:
    """Of a projector of that (width, height)."""
    width, height = size
    black = np.zeros((height, width, 3), np.uint8)
    return black, np.full_like(black, 255)


def tag_pictures(size: tuple[int, int]) -> list[NDArray[np.uint8]]:
    """Three pictures (h, w, 3) that nobody shows for their own sake: two opposite checkers, and bars."""
    width, height = size
    column, row = np.arange(width) * 6 // width, np.arange(height)[:, None] * 4 // height
    bits = [(column + row) % 2, (column + row + 1) % 2, column % 2 + 0 * row]
    return [np.repeat((255 * bit).astype(np.uint8)[..., None], 3, axis=2) for bit in bits]


def fine_picture(size: tuple[int, int]) -> Picture:
    """Black and white in blocks of all small sizes, side by side: as much as there can be in a picture."""
    width, height = size
    column, row = np.arange(width), np.arange(height)[:, None]
    block = 1 + column * 8 // width
    bit = (column // block + row // block) % 2
    return np.repeat((255 * bit).astype(np.uint8)[..., None], 3, axis=2)


def mean_light(picture: NDArray[np.uint8]) -> float:
    """Share, 0 to 1, of the projector's white that a picture lets out."""
    return float(picture.mean()) / 255


def coarse_change(one: NDArray[np.uint8], other: NDArray[np.uint8]) -> float:
    """Share of full scale, 0 to 1, by which two pictures differ where any camera would see it: blurred widely."""
    small = [cv2.resize(picture, (12, 9), interpolation=cv2.INTER_AREA).astype(np.float64) for picture in (one, other)]
    return float(np.abs(small[0] - small[1]).mean()) / 255
