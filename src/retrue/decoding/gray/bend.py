"""What a plane makes of a bent surface: a slow error that no residual shows, taken out by the planes of the neighbours.

A plane n = a + b x + c y that is fitted in a window to a field n(x, y) which bends errs in the cell's centre by

    1/2 n_xx (s_xx - m_x^2) + 1/2 n_yy (s_yy - m_y^2) + n_xy (s_xy - m_x m_y),

m the mean place of what was fitted, from the centre, and s its moments about that mean. On a ball it is several times
the noise, and of one sign. The second derivatives are those of the slopes from cell to cell. Where a surface is flat
they are noise, which would only be added: a plane stays as it is unless it errs by more than its own sigma, beyond
doubt, and so do most cells around it, and more than share its edges.
Source: the bias of local linear regression, Ruppert and Wand, "Multivariate locally weighted least squares
regression", Annals of Statistics 22 (1994), for a field of degree two, where it is exact.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

FloatImage = NDArray[np.float32]

APART = 2  # cells between which slopes are compared: nearer ones come of the same edges
CENTRED = 0.5  # cells from the centre that the mean place of a window lies, which is then cut off by no rim
REACH = 7  # cells, side of the square over which a bend is averaged; at a rim those inside tell
BEYOND_DOUBT = 4.0  # standard errors of what is taken out
MOST = 0.5  # of the cells around that know their bend
ALIKE = 20  # cells whose slopes share most of their edges: 4 pi WINDOW_SIGMA^2


def plane_bias(
    slopes: tuple[FloatImage, FloatImage],
    moments: Mapping[str, FloatImage],
    sigma: FloatImage,
    whole: NDArray[np.uint8],
    cell: int,
    along: int,
) -> FloatImage:
    """By how much each cell's plane errs in the cell's centre; 0 where no neighbours tell, or where that is noise.

    Parameters
    ----------
    slopes : along the axis of comparison x, and across it, y.
    moments : "x", "y" mean place, "xx", "yy", "xy" about it, in pixels.
    sigma : of the plane in the cell's centre.
    whole : 1 where the window lies on one surface.
    """
    across = 1 - along
    x, y = moments["x"], moments["y"]
    whole = whole & (x * x + y * y < np.float32(CENTRED * cell) ** 2).view(np.uint8)
    terms = (
        (slopes[0], along, 0.5 * (moments["xx"] - x * x)),
        (slopes[1], across, 0.5 * (moments["yy"] - y * y)),
        (slopes[0], across, 0.5 * (moments["xy"] - x * y)),
        (slopes[1], along, 0.5 * (moments["xy"] - x * y)),
    )
    changes = [(*_change(slope, whole, cell, axis), lever) for slope, axis, lever in terms]
    bias = np.zeros(whole.shape, np.float32)
    for change, known, lever in changes:
        bias += lever * _averaged(change, known)
    bent = np.abs(bias) > sigma
    if bent.any():
        bent &= bias * bias > np.float32(BEYOND_DOUBT**2) * _variance(changes)
        known = (bias != 0).astype(np.float32)
        bent &= _sum_around(bent.astype(np.float32)) > np.maximum(np.float32(MOST) * _sum_around(known), ALIKE)
    return np.where(bent, bias, np.float32(0))


def _variance(changes: Sequence[tuple[FloatImage, FloatImage, FloatImage]]) -> FloatImage:
    """Of the bias, from how the changes of slope (what, where known, lever) scatter around each cell."""
    variance = np.zeros(changes[0][0].shape, np.float32)
    for change, known, lever in changes:
        count = np.maximum(_sum_around(known), np.float32(1))
        scatter = _sum_around(change * change) / count - _averaged(change, known) ** 2
        variance += lever * lever * np.maximum(scatter, 0) / np.maximum(count / np.float32(ALIKE), 1)
    return variance


def _change(slope: FloatImage, whole: NDArray[np.uint8], cell: int, axis: int) -> tuple[FloatImage, FloatImage]:
    """Of the slope per pixel along an array axis, times 1 where it is known, and that."""
    here = [slice(None), slice(None)]
    first, last = list(here), list(here)
    here[axis], first[axis], last[axis] = slice(APART, -APART), slice(None, -2 * APART), slice(2 * APART, None)
    change, known = (np.zeros(slope.shape, np.float32) for _ in range(2))
    if slope.shape[axis] > 2 * APART:
        there = tuple(here)
        known[there] = whole[there] & whole[tuple(first)] & whole[tuple(last)]
        change[there] = (slope[tuple(last)] - slope[tuple(first)]) / np.float32(2 * APART * cell)
    return change * known, known


def _averaged(change: FloatImage, known: FloatImage) -> FloatImage:
    """Over the neighbours that know it."""
    sums, counts = (_sum_around(image) for image in (change, known))
    return cast(FloatImage, sums / np.maximum(counts, np.float32(1)))


def _sum_around(image: FloatImage) -> FloatImage:
    square = (REACH, REACH)
    return cast(FloatImage, cv2.boxFilter(image, cv2.CV_32F, square, normalize=False, borderType=cv2.BORDER_CONSTANT))
