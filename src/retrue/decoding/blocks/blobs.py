"""Bright blobs on their darker surroundings: the blocks of a colour grid, and other things that look like one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from retrue.geometry.arrays import FloatArray, IntArray
from retrue.geometry.compiling import OUT_MATRIX, compiled, numba

Gray = NDArray[np.uint8]

REACH = 9  # px to the darkest neighbour: more than half a block, so that it reaches into the gap
RIM = 2  # px to the brightest neighbour: less than a gap, so that it stays off the next block
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
    """Blobs of about 4 to 2 REACH px in an RGB picture (h, w, 3), each cut at half its own height.

    A pixel belongs to a block when it is nearer to the brightest value within RIM than to the darkest within
    REACH: a dim block beside a bright one keeps its own threshold, and so does one in the shade.
    """
    reach = np.ones((2 * REACH + 1, 2 * REACH + 1), np.uint8)
    floor = cast(Gray, cv2.erode(picture, reach))
    mask = _nearer_to_top(cast(Gray, cv2.subtract(picture, floor)), reach)
    runs = np.empty((mask.size // 2 + len(mask), 4), np.int32)
    runs = runs[: _find_runs(mask, runs)]
    blobs = np.zeros((len(runs), 6))
    _measure(runs, *mask.shape, blobs)
    area, middle, shape = blobs[:, 0], blobs[:, 1:3], blobs[:, [3, 4, 4, 5]].reshape(-1, 2, 2)
    fill = area / (4 * np.pi * np.sqrt(np.maximum(blobs[:, 3] * blobs[:, 5] - blobs[:, 4] ** 2, 1e-9)))
    keep = (area >= MIN_AREA) & (area <= MAX_AREA) & (fill > MIN_FILL)
    centre = middle[keep]
    column, row = np.round(centre).astype(np.int64).T
    smooth = cast(Gray, cv2.blur(picture, (3, 3)))
    color = smooth[row, column].astype(np.float64) - floor[row, column]
    return Blocks(centre, shape[keep], color)


_RUNS = numba.types.Array(numba.int32, 2, "C")


@compiled(numba.int64(numba.types.Array(numba.uint8, 2, "C"), _RUNS))
def _find_runs(mask: Gray, runs: NDArray[np.int32]) -> int:
    """`runs` <- row, first and last column of all that is lit in each row, and a run of the same blob, the blob's first
    one itself; returns their number. Runs are linked that lie above each other."""
    count, above, above_end = 0, 0, 0
    for y in range(mask.shape[0]):
        begin, x, width = count, 0, mask.shape[1]
        while x < width:
            if mask[y, x] == 0:
                x += 1
                continue
            first = x
            while x < width and mask[y, x] != 0:
                x += 1
            runs[count, 0], runs[count, 1], runs[count, 2], runs[count, 3] = y, first, x - 1, count
            while above < above_end and runs[above, 2] < first:
                above += 1
            k = above
            while k < above_end and runs[k, 1] < x:
                a, b = runs[count, 3], k
                while runs[a, 3] != a:
                    a = runs[a, 3]
                while runs[b, 3] != b:
                    b = runs[b, 3]
                runs[max(a, b), 3] = min(a, b)
                runs[count, 3] = min(a, b)
                k += 1
            count += 1
        above, above_end = begin, count
    for k in range(count):
        runs[k, 3] = runs[runs[k, 3], 3]  # of an earlier one, which is linked to the first by now
    return count


@compiled(numba.void(numba.types.Array(numba.int32, 2, "C"), numba.int64, numba.int64, OUT_MATRIX))
def _measure(runs: NDArray[np.int32], height: int, width: int, blobs: FloatArray) -> None:
    """`blobs` (N, 6) <- area, centroid x, y and second moments xx, xy, yy, at the first run of each; area 0 of all
    others, and of what touches the border."""
    for n in range(len(runs)):
        y, a, b, k = float(runs[n, 0]), float(runs[n, 1]), float(runs[n, 2]), runs[n, 3]
        area = b - a + 1
        along = area * (a + b) / 2
        blobs[k, 0] += area
        blobs[k, 1] += along
        blobs[k, 2] += area * y
        blobs[k, 3] += (b * (b + 1) * (2 * b + 1) - (a - 1) * a * (2 * a - 1)) / 6
        blobs[k, 4] += along * y
        blobs[k, 5] += area * y * y
    for n in range(len(runs)):
        if runs[n, 0] in (0, height - 1) or runs[n, 1] == 0 or runs[n, 2] == width - 1:
            blobs[runs[n, 3], 0] = 0
    for k in range(len(blobs)):
        area = blobs[k, 0]
        if area > 0:
            for i in range(1, 6):
                blobs[k, i] /= area
            blobs[k, 3] -= blobs[k, 1] * blobs[k, 1]
            blobs[k, 4] -= blobs[k, 1] * blobs[k, 2]
            blobs[k, 5] -= blobs[k, 2] * blobs[k, 2]


def _nearer_to_top(added: Gray, reach: Gray) -> Gray:
    """Mask (h, w) of the pixels that belong to a block, from what they add to their floor, (h, w, 3)."""
    red, green, blue = cv2.split(added)
    height = cast(Gray, cv2.max(cv2.max(red, green), blue))
    top = cv2.dilate(height, np.ones((2 * RIM + 1, 2 * RIM + 1), np.uint8))
    bottom = cv2.erode(height, reach)
    middle = cv2.addWeighted(top, 0.5, bottom, 0.5, 0)
    least = max(MIN_CONTRAST, NOISE_SIGMAS * _noise(height))
    _, visible = cv2.threshold(cv2.subtract(top, bottom), least, 255, cv2.THRESH_BINARY)
    return cast(Gray, cv2.bitwise_and(cv2.compare(height, middle, cv2.CMP_GT), visible))


def _noise(height: Gray) -> float:
    """Standard deviation of the pixel noise, from the median second difference along a sample of rows."""
    counts = np.zeros(2 * 255 + 1, np.int64)
    _count_changes(height, counts)
    total = np.cumsum(counts)
    middle = np.searchsorted(total, [(total[-1] - 1) // 2, total[-1] // 2], side="right")
    return float(middle.mean()) / (0.6745 * 6**0.5) if total[-1] else 0.0


@compiled(numba.void(numba.types.Array(numba.uint8, 2, "C"), numba.types.Array(numba.int64, 1, "C")))
def _count_changes(height: Gray, counts: IntArray) -> None:
    for y in range(0, height.shape[0], 7):
        for x in range(1, height.shape[1] - 1):
            counts[abs(int(height[y, x - 1]) - 2 * int(height[y, x]) + int(height[y, x + 1]))] += 1
