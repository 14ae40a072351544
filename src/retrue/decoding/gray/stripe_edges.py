"""Sub-pixel projector coordinates: a plane through the edges of the stripes around each pixel.

Between stripes n and n + 1 one bit changes, and pattern and inverse are equally bright where the camera sees the
very edge, whatever blur, gamma and brightness: linear interpolation of their difference between two pixels finds
it to some hundredths of a pixel, and there n + 1/2 holds exactly. A plane n = a + b x + c y is fitted to the edges
in a Gaussian window, with their true positions, so that a window that is cut off by a border or a shadow is not
biased. The planes are fitted about cells as wide as a stripe, and evaluated at every pixel of the cell; all sums
are separable filters over cells.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from retrue.decoding.gray.bend import plane_bias
from retrue.decoding.gray.bits import AxisCode, neighbours
from retrue.geometry.arrays import BoolArray

FloatImage = NDArray[np.float32]

EDGE_SIGMA = 0.05
"""Camera pixels: how well an edge is found when noise plays no part (JPEG, albedo, the shape of the edge)."""
WINDOW_SIGMA, WINDOW_RADIUS = 1.25, 3
"""Cells: standard deviation and reach of the Gaussian window."""
LARGEST_RESIDUAL = 0.25
"""Stripes, RMS: edges that scatter more about their plane belong to several surfaces, or to none."""
STEEPEST_CONTRAST = 0.3
"""Where brightness changes by more than this share from pixel to pixel, light leaks across and shifts the edge."""


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """Stripe edges between neighbours, stored at the first of the two pixels.

    Attributes
    ----------
    shape : (height, width) of the band; the arrays are padded to whole cells.
    cell : side of a cell in pixels.
    weight : 1 for an edge that noise does not disturb, 0 where there is none.
    fraction : position between the two pixels, 0 .. 1.
    value : n + 1/2.
    """

    shape: tuple[int, ...]
    cell: int
    weight: FloatImage
    fraction: FloatImage
    value: FloatImage


@dataclass(frozen=True, slots=True, eq=False)
class PlaneFit:
    """The fitted planes.

    Attributes
    ----------
    value : (height, width), sub-pixel n of every pixel.
    mean_square : one per cell, of the distances of the window's edges from their own cell's plane, in stripes^2.
    variance : one per cell, of `value`, in stripes^2; grows where the edges lie to one side.
    """

    value: FloatImage
    mean_square: FloatImage
    variance: FloatImage
    cell: int

    def pixels(self, cells: NDArray[Any]) -> NDArray[Any]:
        """One value per cell (uint8 or float32) as one per pixel."""
        height, width = self.value.shape
        return _per_pixel(cells, self.cell)[:height, :width]


def find_edges(
    axis: AxisCode, contrast: FloatImage, noise: FloatImage, good: BoolArray, along: int, cell: int
) -> Edges:
    """Edges between neighbours that are both good and one stripe apart.

    `contrast` is white - black and `noise` the standard deviation of pattern - inverse, both (height, width).
    The difference of pattern and inverse is taken relative to the contrast, so that albedo does not shift the edge.
    """
    here, there = neighbours(along)
    contrast_here, contrast_there = contrast[here], contrast[there]
    change = np.abs(contrast_there - contrast_here)
    flat = change <= STEEPEST_CONTRAST * np.minimum(contrast_there, contrast_here) + 3 * noise[here]
    reach = np.ones((3, 1) if along == 0 else (1, 3), np.uint8)
    usable = cast(NDArray[np.uint8], cv2.erode(flat.view(np.uint8), reach))
    usable &= (np.abs(axis.code[there] - axis.code[here]) == 1).view(np.uint8)
    usable &= (good[here] & good[there]).view(np.uint8)

    near, far = axis.near.astype(np.float32), axis.far.astype(np.float32)
    signal = np.square((near + far) * np.float32(EDGE_SIGMA))
    near *= contrast_there
    far *= contrast_here
    height, width = axis.code.shape
    weight, fraction, value = (np.zeros((height + -height % cell, width + -width % cell), np.float32) for _ in range(3))
    pairs = slice(near.shape[0]), slice(near.shape[1])
    np.multiply(signal / (signal + np.square(noise[here])), usable, out=weight[pairs])
    np.divide(near, near + far + np.float32(1e-9), out=fraction[pairs])
    np.multiply(axis.code[here] + axis.code[there], np.float32(0.5), out=value[pairs])
    return Edges((height, width), cell, weight, fraction, value)


def fit_planes(edges: Edges, along: int) -> PlaneFit:
    """Weighted least squares about every cell, in closed form from nine moments.

    x runs along the axis of comparison and y across it, both from the cell's centre.
    """
    cell, w, v = edges.cell, edges.weight, edges.value
    inner_x, inner_y = (_inside_cell(w.shape, cell, axis) for axis in (along, 1 - along))
    x = edges.fraction + inner_x
    wx, wv, wy = w * x, w * v, w * inner_y
    own = {"": w, "x": wx, "xx": wx * x, "y": wy, "yy": wy * inner_y, "xy": wx * inner_y}
    own |= {"v": wv, "xv": wv * x, "yv": wv * inner_y}
    sums = _windowed({name: _per_cell(image, cell) for name, image in own.items()}, cell, along)

    per_weight = 1 / np.maximum(sums.pop(""), np.float32(1e-6))
    x, y, value, xx, xy, yy, xv, yv = (sums[n] * per_weight for n in ("x", "y", "v", "xx", "xy", "yy", "xv", "yv"))
    for moment, a, b in ((xx, x, x), (xy, x, y), (yy, y, y), (xv, x, value), (yv, y, value)):
        moment -= a * b
    determinant = np.maximum(xx * yy - xy * xy, np.float32(1e-6))
    slope_x = (yy * xv - xy * yv) / determinant
    slope_y = (xx * yv - xy * xv) / determinant
    value -= slope_x * x + slope_y * y
    lever = (yy * (x * x) - 2 * xy * (x * y) + xx * (y * y)) / determinant

    slopes = cast(FloatImage, slope_x), cast(FloatImage, slope_y)
    slope_x, slope_y, value = (_per_pixel(image, cell) for image in (slope_x, slope_y, value))
    fitted = value + slope_x * inner_x + slope_y * inner_y
    off = cast(FloatImage, v - fitted - slope_x * edges.fraction)
    off *= off
    off *= w
    kernel = _kernel(cell, 0)
    squares, weights, count = (
        _filtered(_filtered(_per_cell(image, cell), kernel, 0), kernel, 1)
        for image in (off, w, (w > 0).astype(np.float32))
    )
    tiny = np.float32(1e-6)
    mean_square = cast(FloatImage, squares / (weights + tiny))
    of_weight_1 = squares / (count + tiny) + np.float32((EDGE_SIGMA / cell) ** 2)
    variance = cast(FloatImage, of_weight_1 * per_weight * (1 + np.maximum(lever, 0)) * np.float32(0.5 / cell**2))
    whole = ((mean_square < LARGEST_RESIDUAL**2) & (weights > tiny)).view(np.uint8)
    moments = cast("dict[str, FloatImage]", {"x": x, "y": y, "xx": xx, "yy": yy, "xy": xy})
    bias = plane_bias(slopes, moments, whole, cell, along)
    fitted -= _per_pixel(bias, cell)
    height, width = edges.shape
    return PlaneFit(fitted[:height, :width], mean_square, variance, cell)


def _windowed(own: dict[str, FloatImage], cell: int, along: int) -> dict[str, FloatImage]:
    """Sums over the window from sums over single cells: a moment about another centre takes the lower ones along."""
    k0, k1, k2 = (_kernel(cell, power) for power in range(3))

    def shifted(image: FloatImage, first: FloatImage, axis: int) -> FloatImage:
        """Sum of first + offset * image."""
        return _filtered(first, k0, axis) + _filtered(image, k1, axis)

    def twice_shifted(image: FloatImage, first: FloatImage, second: FloatImage, axis: int) -> FloatImage:
        """Sum of second + 2 offset * first + offset^2 * image."""
        return shifted(2 * first, second, axis) + _filtered(image, k2, axis)

    across = 1 - along
    one, y, v = (_filtered(own[name], k0, along) for name in ("", "y", "v"))
    x, xy, xv = (shifted(own[name], own["x" + name], along) for name in ("", "y", "v"))
    xx = twice_shifted(own[""], own["x"], own["xx"], along)
    yy, yv = (_filtered(own[name], k0, along) for name in ("yy", "yv"))
    sums = {"": one, "x": x, "xx": xx, "v": v, "xv": xv}
    sums = {name: _filtered(image, k0, across) for name, image in sums.items()}
    sums |= {"y": shifted(one, y, across), "xy": shifted(x, xy, across), "yv": shifted(v, yv, across)}
    return sums | {"yy": twice_shifted(one, y, yy, across)}


def _kernel(cell: int, power: int) -> FloatImage:
    """The window along one axis, times offset^power in pixels."""
    offset = np.arange(-WINDOW_RADIUS, WINDOW_RADIUS + 1, dtype=np.float64)
    return (np.exp(-0.5 * (offset / WINDOW_SIGMA) ** 2) * (cell * offset) ** power).astype(np.float32)


def _inside_cell(shape: tuple[int, ...], cell: int, axis: int) -> FloatImage:
    """Coordinate along an array axis of every pixel, from the centre of its cell; broadcasts over the other axis."""
    offset = np.arange(shape[axis], dtype=np.float32) % cell - np.float32((cell - 1) / 2)
    return offset[:, None] if axis == 0 else offset[None, :]


def _per_cell(image: FloatImage, cell: int) -> FloatImage:
    """Mean over each cell."""
    size = (image.shape[1] // cell, image.shape[0] // cell)
    return cast(FloatImage, cv2.resize(image, size, interpolation=cv2.INTER_AREA))


def _per_pixel(image: NDArray[Any], cell: int) -> NDArray[Any]:
    """The cell's value, for each of its pixels."""
    size = (image.shape[1] * cell, image.shape[0] * cell)
    return cast(NDArray[Any], cv2.resize(image, size, interpolation=cv2.INTER_NEAREST))


def _filtered(image: FloatImage, kernel: FloatImage, axis: int) -> FloatImage:
    """Correlation along one array axis; beyond the border there is nothing."""
    kernel_2d = kernel[None, :] if axis == 1 else kernel[:, None]
    return cast(FloatImage, cv2.filter2D(image, cv2.CV_32F, kernel_2d, borderType=cv2.BORDER_CONSTANT))
