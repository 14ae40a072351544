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
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from retrue.decoding.gray.bend import plane_bias
from retrue.decoding.gray.bits import AxisCode
from retrue.decoding.gray.scatter import scatter_level
from retrue.geometry.arrays import BoolArray
from retrue.kernels import stripes as kernel

FloatImage = NDArray[np.float32]

EDGE_SIGMA = 0.05
"""Camera pixels: how well an edge is found when noise plays no part (JPEG, albedo, the shape of the edge)."""
WINDOW_SIGMA, WINDOW_RADIUS = 1.25, 3
"""Cells: standard deviation and reach of the Gaussian window."""
STEEPEST_CONTRAST = 0.3
"""Where brightness changes by more than this share from pixel to pixel, light leaks across and shifts the edge."""
LARGEST_RESIDUAL = 0.25
"""Stripes, RMS: edges that scatter more about their plane belong to several surfaces, or to none."""
LARGEST_SIGMA = 0.05
"""Stripes: above it, too few edges, or all of them to one side."""
MOMENTS = ("", "x", "xx", "y", "yy", "xy", "v", "xv", "yv")
"""Of the weights, and of what they are multiplied by."""


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """The N stripe edges of a band, each between a pixel and the next along the axis of comparison.

    Attributes
    ----------
    shape : (height, width) of the band's columns that were looked at.
    cell : side of a cell in pixels.
    place : (N,) flat index of the first of the two pixels, ascending.
    seen : (3, N) weight, 1 for an edge that noise does not disturb; position between the two pixels, 0 .. 1; n + 1/2.
    """

    shape: tuple[int, int]
    cell: int
    place: NDArray[np.int32]
    seen: FloatImage

    @property
    def cells(self) -> tuple[int, int]:
        """Rows and columns of cells, the last ones cut off by the border."""
        return -(-self.shape[0] // self.cell), -(-self.shape[1] // self.cell)


@dataclass(frozen=True, slots=True, eq=False)
class PlaneFit:
    """The fitted planes, one per cell.

    Attributes
    ----------
    planes : (3, rows, columns), sub-pixel n in the cell's centre, and its slopes along and across the axis.
    mean_square : of the distances of the window's edges from their own cell's plane, in stripes^2.
    variance : of the planes' n, in stripes^2, from how the edges scatter; grows where they lie to one side.
    error : the same, as the planes themselves scatter.
    cell, along : side of a cell in pixels, array axis of comparison.
    """

    planes: FloatImage
    mean_square: FloatImage
    variance: FloatImage
    error: FloatImage
    cell: int
    along: int


def find_edges(
    axis: AxisCode, contrast: FloatImage, noise: FloatImage, good: BoolArray, columns: slice, along: int, cell: int
) -> Edges:
    """Edges between neighbours that are both good and one stripe apart.

    `contrast` is white - black and `noise` the standard deviation of pattern - inverse, both (height, width); all good
    pixels are in `columns`.
    The difference of pattern and inverse is taken relative to the contrast, so that albedo does not shift the edge.
    """
    most = int(np.count_nonzero(good))
    place, seen = np.empty(most, np.int32), np.empty((3, most), np.float32)
    count = kernel.find_edges(
        axis.code,
        axis.near,
        axis.far,
        contrast,
        noise,
        good.view(np.uint8),
        (columns.start, columns.stop),
        along,
        EDGE_SIGMA,
        STEEPEST_CONTRAST,
        place,
        seen,
    )
    return Edges((good.shape[0], columns.stop - columns.start), cell, place[:count], seen[:, :count].copy())


def fit_planes(edges: Edges, along: int) -> PlaneFit:
    """Weighted least squares about every cell, in closed form from nine moments.

    x runs along the axis of comparison and y across it, both from the cell's centre.
    """
    cell, width = edges.cell, edges.shape[1]
    own = np.zeros((len(MOMENTS), *edges.cells), np.float32)
    room = np.zeros((edges.cells[1], len(MOMENTS)), np.float32)
    kernel.moments(edges.place, edges.seen, width, cell, along, room, own)
    sums = _windowed(dict(zip(MOMENTS, own, strict=True)), cell, along)

    per_weight = 1 / np.maximum(sums.pop(""), np.float32(1e-6))
    x, y, value, xx, xy, yy, xv, yv = (sums[n] * per_weight for n in ("x", "y", "v", "xx", "xy", "yy", "xv", "yv"))
    for moment, a, b in ((xx, x, x), (xy, x, y), (yy, y, y), (xv, x, value), (yv, y, value)):
        moment -= a * b
    determinant = np.maximum(xx * yy - xy * xy, np.float32(1e-6))
    slope_x = (yy * xv - xy * yv) / determinant
    slope_y = (xx * yv - xy * xv) / determinant
    value -= slope_x * x + slope_y * y
    lever = (yy * (x * x) - 2 * xy * (x * y) + xx * (y * y)) / determinant

    planes = np.stack([value, slope_x, slope_y], dtype=np.float32)
    own = np.zeros((3, *edges.cells), np.float32)
    kernel.misses(edges.place, edges.seen, planes, width, cell, along, room, own)
    window = _kernel(cell, 0)
    squares, weights, count = (_filtered(_filtered(image, window, 0), window, 1) for image in own)
    tiny = np.float32(1e-6)
    mean_square = cast(FloatImage, squares / (weights + tiny))
    of_weight_1 = squares / (count + tiny) + np.float32((EDGE_SIGMA / cell) ** 2)
    variance = cast(FloatImage, of_weight_1 * per_weight * (1 + np.maximum(lever, 0)) * np.float32(0.5 / cell**2))
    whole = ((mean_square < LARGEST_RESIDUAL**2) & (weights > tiny)).view(np.uint8)
    moments = cast("dict[str, FloatImage]", {"x": x, "y": y, "xx": xx, "yy": yy, "xy": xy})
    planes[0] -= plane_bias((planes[1], planes[2]), moments, np.sqrt(variance), whole, cell, along)
    return PlaneFit(planes, mean_square, variance, variance * scatter_level(planes[0], variance, whole), cell, along)


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


def _filtered(image: FloatImage, kernel: FloatImage, axis: int) -> FloatImage:
    """Correlation along one array axis; beyond the border there is nothing."""
    kernel_2d = kernel[None, :] if axis == 1 else kernel[:, None]
    return cast(FloatImage, cv2.filter2D(image, cv2.CV_32F, kernel_2d, borderType=cv2.BORDER_CONSTANT))
