"""Bright blobs on their darker surroundings: the blocks of a colour grid, and other things that look like one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from retrue.geometry.arrays import FloatArray
from retrue.kernels import blobs as kernel

Gray = NDArray[np.uint8]

FLOOR_PX = 9  # to the darkest neighbour: more than half a block, so that it reaches into the gap
TOP_PX = 2  # to the brightest neighbour: less than a gap, so that it stays off the next block
NOISE_SIGMAS = 5.0
MIN_CONTRAST = 5  # grey levels
MIN_AREA, MAX_AREA = 9, 900  # px
MIN_FILL = 0.8  # of the ellipse of its own moments: squares fill 0.95, rings and chains of blobs less


@dataclass(frozen=True, slots=True, eq=False)
class Blocks:
    """N blobs, in pixels of the picture they were found in.

    Attributes
    ----------
    centre : (N, 2) centroid (x, y).
    shape : (N, 2, 2) second moments of the blob, px^2: of a parallelogram (e1 e1^T + e2 e2^T) / 12.
    color : (N, 3) what the block adds to its surroundings.
    """

    centre: FloatArray
    shape: FloatArray
    color: FloatArray

    def __len__(self) -> int:
        return len(self.centre)

    def area(self) -> FloatArray:
        """(N,) of the blobs' parallelograms, over 12: the square root of det(shape)."""
        return np.sqrt(np.maximum(self.shape[:, 0, 0] * self.shape[:, 1, 1] - self.shape[:, 0, 1] ** 2, 1e-9))


def find_blocks(picture: Gray) -> Blocks:
    """Blobs of about 4 to 2 FLOOR_PX px in an RGB picture (h, w, 3), each cut at half its own height.

    A pixel belongs to a block when it is nearer to the brightest value within TOP_PX than to the darkest within
    FLOOR_PX: a dim block beside a bright one keeps its own threshold, and so does one in the shade.
    """
    reach = np.ones((2 * FLOOR_PX + 1, 2 * FLOOR_PX + 1), np.uint8)
    floor = cast(Gray, cv2.erode(picture, reach))
    area, centre, shape = _moments(_nearer_to_top(cast(Gray, cv2.subtract(picture, floor)), reach))
    fill = area / (4 * np.pi * np.sqrt(np.maximum(shape[:, 0] * shape[:, 3] - shape[:, 1] ** 2, 1e-9)))
    keep = np.flatnonzero(fill > MIN_FILL)
    centre, light = centre[keep], np.empty((len(keep), 3))
    kernel.added_light(picture, floor, centre, light)
    return Blocks(centre, shape[keep].reshape(-1, 2, 2), light)


def _moments(mask: Gray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Area (N,), centroid (N, 2) and second moments xx, xy, xy, yy (N, 4) of the blobs in a mask (h, w)."""
    runs = np.empty((mask.size // 2 + len(mask), 4), np.int32)
    runs = runs[: kernel.find_runs(mask, runs)]
    blobs = np.zeros((len(runs), 6))
    blobs = blobs[: kernel.measure_blobs(runs, mask.shape[0], mask.shape[1], MIN_AREA, MAX_AREA, blobs)]
    return blobs[:, 0], blobs[:, 1:3], blobs[:, [3, 4, 4, 5]]


def _nearer_to_top(added: Gray, reach: Gray) -> Gray:
    """Mask (h, w) of the pixels that belong to a block, from what they add to their floor, (h, w, 3)."""
    red, green, blue = cv2.split(added)
    height = cast(Gray, cv2.max(cv2.max(red, green), blue))
    top = cv2.dilate(height, np.ones((2 * TOP_PX + 1, 2 * TOP_PX + 1), np.uint8))
    bottom = cv2.erode(height, reach)
    middle = cv2.addWeighted(top, 0.5, bottom, 0.5, 0)
    least = max(MIN_CONTRAST, NOISE_SIGMAS * _noise(height))
    _, visible = cv2.threshold(cv2.subtract(top, bottom), least, 255, cv2.THRESH_BINARY)
    return cast(Gray, cv2.bitwise_and(cv2.compare(height, middle, cv2.CMP_GT), visible))


def _noise(height: Gray) -> float:
    """Standard deviation of the pixel noise, from the median second difference along a sample of rows."""
    counts = np.zeros(2 * 255 + 1, np.int64)
    kernel.count_changes(height, counts)
    total = np.cumsum(counts)
    middle = np.searchsorted(total, [(total[-1] - 1) // 2, total[-1] // 2], side="right")
    return float(middle.mean()) / (0.6745 * 6**0.5) if total[-1] else 0.0
