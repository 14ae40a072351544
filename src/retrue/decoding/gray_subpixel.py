"""Sub-pixel projector coordinates: a plane through the edges of the stripes around each pixel.

Between stripes n and n + 1 one bit changes, and pattern and inverse are equally bright where the camera sees the
very edge, whatever blur, gamma and brightness: linear interpolation of their difference between two pixels finds
it to some hundredths of a pixel, and there n + 1/2 holds exactly. A plane n = a + b x + c y is fitted to the edges
in a Gaussian window about every pixel, with their true positions, so that a window that is cut off by a border or
a shadow is not biased. All sums are separable filters.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from retrue.decoding.gray_bits import AxisCode, neighbours
from retrue.geometry.arrays import BoolArray

FloatImage = NDArray[np.float32]

EDGE_SIGMA = 0.05
"""Camera pixels: how well an edge is found when noise plays no part (JPEG, albedo, the shape of the edge)."""
STEEPEST_CONTRAST = 0.3
"""Where brightness changes by more than this share from pixel to pixel, light leaks across and shifts the edge."""


@dataclass(frozen=True, slots=True)
class Window:
    """A Gaussian window; moment(p) is its kernel times offset^p."""

    sigma: float

    @property
    def radius(self) -> int:
        return int(np.ceil(2.4 * self.sigma))

    def moment(self, power: int) -> FloatImage:
        offset = np.arange(-self.radius, self.radius + 1, dtype=np.float32)
        return cast(FloatImage, np.exp(-0.5 * (offset / self.sigma) ** 2) * offset**power).astype(np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """Stripe edges between neighbours, stored at the first of the two pixels.

    Attributes
    ----------
    weight : (height, width), 1 for an edge that noise does not disturb, 0 where there is none.
    fraction : (height, width), position between the two pixels, 0 .. 1.
    value : (height, width), n + 1/2.
    """

    weight: FloatImage
    fraction: FloatImage
    value: FloatImage


@dataclass(frozen=True, slots=True, eq=False)
class PlaneFit:
    """The fitted planes at every pixel.

    Attributes
    ----------
    value : (height, width), sub-pixel n.
    residual : (height, width), RMS of the edges about the plane of their own pixel, in stripes.
    sigma : (height, width), standard deviation of `value`, in stripes; grows where the edges lie to one side.
    """

    value: FloatImage
    residual: FloatImage
    sigma: FloatImage


def find_edges(axis: AxisCode, contrast: FloatImage, noise: FloatImage, good: BoolArray, along: int) -> Edges:
    """Edges between neighbours that are both good and one stripe apart.

    `contrast` is white - black and `noise` the standard deviation of pattern - inverse, both (height, width).
    The difference of pattern and inverse is taken relative to the contrast, so that albedo does not shift the edge.
    """
    here, there = neighbours(along)
    change = np.abs(contrast[there] - contrast[here])
    flat = (change <= STEEPEST_CONTRAST * np.minimum(contrast[there], contrast[here]) + 3 * noise[here]).view(np.uint8)
    kernel = np.ones((3, 1) if along == 0 else (1, 3), np.uint8)
    flat = cast(NDArray[np.uint8], cv2.erode(flat, kernel)).view(np.bool_)
    step = axis.code[there] - axis.code[here]
    usable = (np.abs(step) == 1) & good[here] & good[there] & flat
    near, far = axis.near.astype(np.float32), axis.far.astype(np.float32)
    noise_px = noise[here] / np.maximum(near + far, 1)
    near *= contrast[there]
    far *= contrast[here]
    shape, dtype = axis.code.shape, np.float32
    weight, fraction, value = (np.zeros(shape, dtype) for _ in range(3))
    weight[here] = usable * (EDGE_SIGMA**2 / (EDGE_SIGMA**2 + noise_px * noise_px))
    np.divide(near, near + far, out=fraction[here], where=usable)
    np.add(axis.code[here], 0.5 * step, out=value[here], where=usable, casting="unsafe")
    return Edges(weight, fraction, value)


def fit_planes(edges: Edges, window: Window, along: int) -> PlaneFit:
    """Weighted least squares in the window about every pixel, in closed form from nine moments.

    x runs along the axis of comparison, y across it, both from the pixel.
    """
    w, f, v = edges.weight, edges.fraction, edges.value
    wf, wv = w * f, w * v

    def along_sum(image: FloatImage, power: int) -> FloatImage:
        return _filtered(image, window.moment(power), along)

    def across_sum(image: FloatImage, power: int) -> FloatImage:
        return _filtered(image, window.moment(power), 1 - along)

    row_1 = along_sum(w, 0)
    row_x = along_sum(w, 1) + along_sum(wf, 0)
    row_xx = along_sum(w, 2) + 2 * along_sum(wf, 1) + along_sum(wf * f, 0)
    row_v = along_sum(wv, 0)
    row_xv = along_sum(wv, 1) + along_sum(wv * f, 0)

    total = across_sum(row_1, 0)
    scale = 1 / np.maximum(total, 1e-6)
    x, y, value = across_sum(row_x, 0) * scale, across_sum(row_1, 1) * scale, across_sum(row_v, 0) * scale
    xx = across_sum(row_xx, 0) * scale - x * x
    xy = across_sum(row_x, 1) * scale - x * y
    yy = across_sum(row_1, 2) * scale - y * y
    xv = across_sum(row_xv, 0) * scale - x * value
    yv = across_sum(row_v, 1) * scale - y * value
    per_determinant = 1 / np.maximum(xx * yy - xy * xy, 1e-6)
    slope_x = (yy * xv - xy * yv) * per_determinant
    slope_y = (xx * yv - xy * xv) * per_determinant
    fitted = value - slope_x * x - slope_y * y
    lever = 1 + (yy * x * x - 2 * xy * x * y + xx * y * y) * per_determinant

    off = v - fitted - slope_x * f
    squares = _filtered(_filtered(w * off * off, window.moment(0), along), window.moment(0), 1 - along) * scale
    sigma = np.sqrt(0.5 * (squares + EDGE_SIGMA**2) * scale * np.maximum(lever, 1))
    return PlaneFit(fitted, np.sqrt(squares), sigma)


def _filtered(image: FloatImage, kernel: FloatImage, axis: int) -> FloatImage:
    """Correlation along one array axis; beyond the border there is nothing."""
    one = np.ones(1, np.float32)
    x, y = (kernel, one) if axis == 1 else (one, kernel)
    return cast(FloatImage, cv2.sepFilter2D(image, cv2.CV_32F, x, y, borderType=cv2.BORDER_CONSTANT))
