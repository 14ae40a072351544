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

from collections.abc import Mapping
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

FloatImage = NDArray[np.float32]
Cut = tuple[slice, slice]

APART = 2  # cells between which slopes are compared: nearer ones come of the same edges
CENTRED = 0.5  # cells from the centre that the mean place of a window lies, which is then cut off by no rim
REACH = 7  # cells, side of the square over which a bend is averaged; at a rim those inside tell
BEYOND_DOUBT = 8.0  # standard errors of what is taken out; two or three independent bends tell these
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
    known = {axis: _known(whole, axis) for axis in (along, across)}
    counts = {axis: np.maximum(_sum_around(own), np.float32(1)) for axis, own in known.items()}
    changes = [(_change(slope, cell, axis, known[axis]), lever, counts[axis]) for slope, axis, lever in terms]
    means = [_sum_around(change) / count for change, _, count in changes]
    bias = sum((lever * mean for mean, (_, lever, _) in zip(means, changes, strict=True)), np.zeros_like(x))
    bent = np.abs(bias) > sigma
    if bent.any():
        variance = np.zeros_like(x)  # of the bias, from how the changes of slope scatter around each cell
        for mean, (change, lever, count) in zip(means, changes, strict=True):
            scatter = np.maximum(_sum_around(change * change) / count - mean * mean, 0)
            variance += lever * lever * scatter / np.maximum(count / np.float32(ALIKE), 1)
        bent &= bias * bias > np.float32(BEYOND_DOUBT**2) * variance
        told = np.float32(MOST) * _sum_around((bias != 0).astype(np.float32))
        bent &= _sum_around(bent.astype(np.float32)) > np.maximum(told, ALIKE)
    return np.where(bent, bias, np.float32(0))


def _known(whole: NDArray[np.uint8], axis: int) -> FloatImage:
    """1 where the cells on both sides along an array axis tell how the slope changes."""
    known = np.zeros(whole.shape, np.float32)
    if whole.shape[axis] > 2 * APART:
        here, first, last = _beside(axis)
        known[here] = whole[here] & whole[first] & whole[last]
    return known


def _change(slope: FloatImage, cell: int, axis: int, known: FloatImage) -> FloatImage:
    """Of the slope per pixel along an array axis; 0 where it is not known."""
    change = np.zeros(slope.shape, np.float32)
    if slope.shape[axis] > 2 * APART:
        here, first, last = _beside(axis)
        change[here] = (slope[last] - slope[first]) * known[here] / np.float32(2 * APART * cell)
    return change


def _beside(axis: int) -> tuple[Cut, Cut, Cut]:
    """Index of the cells that have others on both sides, and of these."""
    cuts = (slice(APART, -APART), slice(None, -2 * APART), slice(2 * APART, None))
    here, first, last = ((cut, slice(None)) if axis == 0 else (slice(None), cut) for cut in cuts)
    return here, first, last


def _sum_around(image: FloatImage) -> FloatImage:
    square = (REACH, REACH)
    return cast(FloatImage, cv2.boxFilter(image, cv2.CV_32F, square, normalize=False, borderType=cv2.BORDER_CONSTANT))
