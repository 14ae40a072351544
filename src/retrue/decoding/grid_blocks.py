"""Bright blobs on their darker surroundings: the blocks of a colour grid, and other things that look like one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from retrue.geometry.arrays import FloatArray

Gray = NDArray[np.uint8]

REACH = 9  # px to the darkest neighbour: more than half a block, so that it reaches into the gap
RIM = 2  # px to the brightest neighbour: less than a gap, so that it stays off the next block
NOISE_SIGMAS = 5.0
MIN_CONTRAST = 5  # grey levels
MIN_AREA, MAX_AREA = 9, 900  # px


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


def find_blocks(picture: Gray) -> Blocks:
    """Blobs of about 4 to 2 REACH px in an RGB picture (h, w, 3), each cut at half its own height.

    A pixel belongs to a block when it is nearer to the brightest value within RIM than to the darkest within
    REACH: a dim block beside a bright one keeps its own threshold, and so does one in the shade.
    """
    floor = cast(Gray, cv2.erode(picture, np.ones((2 * REACH + 1, 2 * REACH + 1), np.uint8)))
    added = cast(Gray, cv2.subtract(picture, floor))
    height = np.asarray(cv2.max(cv2.max(added[..., 0], added[..., 1]), added[..., 2]))
    rim = np.ones((2 * RIM + 1, 2 * RIM + 1), np.uint8)
    reach = np.ones((2 * REACH + 1, 2 * REACH + 1), np.uint8)
    top = cv2.dilate(height, rim)
    bottom = cv2.erode(height, reach)
    middle = cv2.addWeighted(top, 0.5, bottom, 0.5, 0)
    contrast = cv2.subtract(top, bottom)
    threshold = max(MIN_CONTRAST, NOISE_SIGMAS * _noise(height))
    _, visible = cv2.threshold(contrast, threshold, 255, cv2.THRESH_BINARY)
    mask = cv2.bitwise_and(cv2.compare(height, middle, cv2.CMP_GT), visible)
    _, labels, stats, centroids = cv2.connectedComponentsWithStats(mask, connectivity=4, ltype=cv2.CV_32S)
    area = stats[:, cv2.CC_STAT_AREA]
    keep = (area >= MIN_AREA) & (area <= MAX_AREA)
    keep[0] = False
    h, w = mask.shape
    left, up = stats[:, cv2.CC_STAT_LEFT], stats[:, cv2.CC_STAT_TOP]
    keep &= (left > 0) & (up > 0)
    keep &= (left + stats[:, cv2.CC_STAT_WIDTH] < w) & (up + stats[:, cv2.CC_STAT_HEIGHT] < h)
    shape = _second_moments(np.asarray(labels), centroids, area)
    # A square fills 0.92 of the ellipse of its own moments; clutter, rings and chains of blobs fill less.
    with np.errstate(invalid="ignore", divide="ignore"):
        ellipse = 4 * np.pi * np.sqrt(np.maximum(np.linalg.det(shape), 0))
        keep &= area > 0.8 * ellipse
    centre, shape = centroids[keep], shape[keep]
    pixel = np.round(centre).astype(int)
    smooth = np.asarray(cv2.blur(picture, (3, 3)))
    color = smooth[pixel[:, 1], pixel[:, 0]].astype(float) - floor[pixel[:, 1], pixel[:, 0]]
    return Blocks(centre, shape, color)


def _noise(height: Gray) -> float:
    """Standard deviation of the pixel noise, from the median second difference along a sample of rows."""
    rows = height[::7].astype(np.int16)
    if rows.shape[1] < 3:
        return 0.0
    return float(np.median(np.abs(rows[:, :-2] - 2 * rows[:, 1:-1] + rows[:, 2:]))) / (0.6745 * 6**0.5)


def _second_moments(labels: NDArray[np.int32], centroids: FloatArray, area: NDArray[np.int32]) -> FloatArray:
    flat = np.flatnonzero(labels)
    owner = labels.ravel()[flat]
    y, x = np.divmod(flat, labels.shape[1])
    dx, dy = x - centroids[owner, 0], y - centroids[owner, 1]
    count = len(area)
    scale = np.maximum(area, 1)
    shape = np.empty((count, 2, 2))
    shape[:, 0, 0] = np.bincount(owner, dx * dx, count) / scale
    shape[:, 1, 1] = np.bincount(owner, dy * dy, count) / scale
    shape[:, 0, 1] = shape[:, 1, 0] = np.bincount(owner, dx * dy, count) / scale
    return shape
