"""What a plane makes of a bent surface: a slow error that no residual shows, taken out by the planes of the neighbours.

A plane n = a + b x + c y that is fitted in a window to a field n(x, y) which bends errs in the cell's centre by

    1/2 n_xx (s_xx - m_x^2) + 1/2 n_yy (s_yy - m_y^2) + n_xy (s_xy - m_x m_y),

m the mean place of what was fitted, from the centre, and s its moments about that mean. On a ball it is several times
the noise, and of one sign. The second derivatives are those of the slopes from cell to cell. Where a surface is flat
they are noise, which would only be added: a plane stays as it is unless it errs by more than its own sigma, beyond
doubt, and so do most cells around it, and more than share its edges. Where it stays, what it may err by widens sigma.
Source: the bias of local linear regression, Ruppert and Wand, "Multivariate locally weighted least squares
regression", Annals of Statistics 22 (1994), for a field of degree two, where it is exact.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from retrue.kernels import bend as kernel

FloatImage = NDArray[np.float32]

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
) -> tuple[FloatImage, FloatImage]:
    """By how much each cell's plane errs in the cell's centre, beyond doubt; and what else it may err by there.

    Both 0 where no neighbours tell, the one where the other is not.

    Parameters
    ----------
    slopes : along the axis of comparison x, and across it, y.
    moments : "x", "y" mean place, "xx", "yy", "xy" about it, in pixels.
    sigma : of the plane in the cell's centre.
    whole : 1 where the window lies on one surface.
    """
    room, told = np.empty((6, REACH, whole.shape[1]), np.float32), np.empty_like(whole)
    bias, bent = np.empty(whole.shape, np.float32), np.empty_like(whole)
    frame = APART, 2 * APART * cell, along
    shape = moments["x"], moments["y"], moments["xx"], moments["yy"], moments["xy"], np.float32(CENTRED * cell) ** 2
    count = kernel.bias(*slopes, whole, *frame, *shape, sigma, ALIKE, BEYOND_DOUBT, room, told, bias, bent)
    if not count > ALIKE:
        return np.zeros_like(bias), bias
    told = np.float32(MOST) * _sum_around((bias != 0).astype(np.float32))
    sure = bent.view(np.bool_) & (_sum_around(bent.astype(np.float32)) > np.maximum(told, ALIKE))
    return np.where(sure, bias, np.float32(0)), np.where(sure, np.float32(0), bias)


def _sum_around(image: FloatImage) -> FloatImage:
    square = (REACH, REACH)
    return cast(FloatImage, cv2.boxFilter(image, cv2.CV_32F, square, normalize=False, borderType=cv2.BORDER_CONSTANT))
