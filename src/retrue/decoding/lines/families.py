"""One family of lines without the other, and where its lines run."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from retrue.geometry.arrays import BoolArray, FloatArray, Image

REACH = 9  # px along a line to either side: more than a pitch of lines up to 15 px apart
QUANTILE = 0.4  # along a line: the other family's lines take less than half of it, and are the brighter part
VALLEY = 6  # px across a line to either side, in which it has its gaps
STRETCH = (-6, -4.5, -3, -1.5, 0, 1.5, 3, 4.5, 6)  # px along a line: a line goes on, noise does not
NOISE_SIGMAS = 4.0
LEAST_CONTRAST = 2.0  # grey levels

Floats = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Family:
    """Lines of one direction.

    Attributes
    ----------
    along : (h, w, 2) unit vectors (x, y).
    picture : (h, w, 3) with the other family taken away.
    height : (h, w) by how much the line stands out of its gaps there; 0 beside lines.
    ridge : (h, w) the pixels nearest to the middle of a line.
    """

    along: FloatArray
    picture: Floats
    height: Floats
    ridge: BoolArray


def find_lines(picture: Image, along: FloatArray, across: FloatArray) -> Family:
    """The lines along `along` in `picture` (h, w, 3), whose neighbours lie along `across`, (h, w, 2) each.

    Where they cross, a line of the other family takes less than half of the way; so a quantile along this family's
    direction does not see it, and a line that is blurred into its neighbours is sharper than before.
    """
    pixels = np.indices(picture.shape[:2], dtype=np.float32)
    here, step = ((pixels, direction.astype(np.float32)) for direction in (along, across))
    samples = [_shifted(picture, here, t) for t in range(-REACH, REACH + 1)]
    seen = _of_rank(samples, round(QUANTILE * 2 * REACH)).astype(np.float32)
    clean = np.asarray(cv2.GaussianBlur(seen, (0, 0), 0.5), dtype=np.float32)
    sides: list[Floats] = []
    for sign in (-1, 1):
        least = _shifted(clean, step, sign)
        for t in range(2, VALLEY + 1):
            least = np.minimum(least, _shifted(clean, step, sign * t))
        sides.append(least)
    rise = (clean - np.maximum(*sides)).max(axis=-1)
    height = np.zeros_like(rise)
    for t in STRETCH:
        height += _shifted(rise, here, t) / np.float32(len(STRETCH))
    ridge = height > max(LEAST_CONTRAST, NOISE_SIGMAS * _noise(height))
    for t in (1, 2):
        ridge &= (height >= _shifted(height, step, -t)) & (height > _shifted(height, step, t))
    return Family(along, clean, np.where(ridge, height, np.float32(0)), ridge)


def _of_rank(samples: list[Image], rank: int) -> Image:
    """In each pixel the sample that so many are no larger than; by exchanging whole pictures, the smallest first."""
    for first in range(rank + 1):
        for index in range(len(samples) - 1, first, -1):
            one, other = samples[index - 1], samples[index]
            samples[index - 1], samples[index] = np.minimum(one, other), np.maximum(one, other)
    return samples[rank]


def _shifted(picture: Image, lines: tuple[Floats, Floats], t: float) -> Image:
    """`picture` as it is `t` px further along: `lines` are each pixel's place (y, x) and its direction (h, w, 2)."""
    (y, x), direction = lines
    there = np.float32(t) * direction
    return np.asarray(
        cv2.remap(picture, x + there[..., 0], y + there[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    )


def _noise(picture: Floats) -> float:
    """Standard deviation of one channel, from second differences along the rows."""
    change = np.abs(picture[::4, 2:] - 2 * picture[::4, 1:-1] + picture[::4, :-2])
    return float(np.median(change)) / (0.6745 * 6**0.5)
