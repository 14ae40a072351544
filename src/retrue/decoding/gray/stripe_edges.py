"""Sub-pixel projector coordinates: a plane through the edges of the stripes around each pixel.

Between stripes n and n + 1 one bit changes, and pattern and inverse are equally bright where the camera sees the
very edge, whatever blur, gamma and brightness: linear interpolation of their difference between two pixels, less what
`edge_shape` knows of it, finds it to some hundredths of a pixel, and there n + 1/2 holds exactly. A plane
n = a + b x + c y is fitted to the edges in a Gaussian window, with their true positions, so that a window that is cut
off by a border or a shadow is not biased. The planes are fitted about cells as wide as a stripe, and evaluated at every
pixel of the cell; all sums are separable filters over cells.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from retrue.decoding.gray.bend import plane_bias
from retrue.decoding.gray.bits import AxisCode, CodeImage, neighbours
from retrue.decoding.gray.edge_shape import PER_STRIPE, EdgeBias
from retrue.decoding.gray.scatter import scatter_level
from retrue.decoding.light import BLUR, BLUR_DOUBT
from retrue.geometry.arrays import BoolArray
from retrue.kernels import planes as planes_kernel
from retrue.kernels import stripes as kernel

FloatImage = NDArray[np.float32]

EDGE_SIGMA = 0.05
"""Camera pixels: how well an edge is found when noise plays no part (JPEG, albedo, the shape of the edge)."""
WINDOW_SIGMA, WINDOW_RADIUS = 1.25, 3
"""Cells: standard deviation and reach of the Gaussian window."""
STEEPEST_CONTRAST = 0.1
"""Where brightness changes by more than this share from pixel to pixel, light leaks across and shifts the edge by more
than can be told."""
MOST_STRIPES = 4
"""Between neighbours on one surface."""
AROUND = 17
"""Pixels, side of the square about an edge over which the width of its stripes is told."""
BESIDE, ABOUT = (1, 2), (AROUND // 2, AROUND // 2 + 1)
"""Rows above and below a band that its edges look at: their neighbours, and where that width is asked, all about."""
LARGEST_RESIDUAL = 0.25
"""Stripes, RMS: edges that scatter more about their plane belong to several surfaces, or to none."""
LARGEST_MISS = 1.0
"""Camera pixels, RMS: the same of stripes so wide that a quarter of one is no small miss of an edge."""
LARGEST_SIGMA = 0.05
"""Stripes: above it, too few edges, or all of them to one side."""
FOLDED = 4.0
"""Times the usual mean square by which edges miss their plane: above it the surface folds."""
FOLD_EVERY = 4
"""Cells along either axis, of which one tells what is usual."""
MARGIN = 16
"""Cells about those that hold edges, or points, that are looked at too."""
ALIGNED = 32
"""Cells, at multiples of which runs begin: sums round as those of whole rows do."""
MOMENTS = ("", "x", "xx", "y", "yy", "xy", "v", "xv", "yv")
"""Of the weights, and of what they are multiplied by."""
OF_WEIGHTS = MOMENTS[:6]


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """The N stripe edges of a band of rows, each between a pixel and the next along the axis of comparison.

    Attributes
    ----------
    place : (N,) flat index into the band of the first of the two pixels, ascending.
    seen : (3, N) weight, 1 for an edge that noise does not disturb; position between the two pixels, 0 .. 1; n + 1/2.
    """

    place: NDArray[np.int32]
    seen: FloatImage


@dataclass(frozen=True, slots=True, eq=False)
class PlaneFit:
    """The fitted planes, one per cell of the picture.

    Attributes
    ----------
    planes : (3, rows, columns), sub-pixel n in the cell's centre, and its slopes along and across the axis.
    sure : whether enough edges, on all sides, tell it.
    even : whether the window's edges lie on their own cell's plane.
    error : variance of n, in stripes^2, as the planes scatter.
    cell, along : side of a cell in pixels, array axis of comparison.
    """

    planes: FloatImage
    sure: NDArray[np.uint8]
    even: NDArray[np.uint8]
    error: FloatImage
    cell: int
    along: int


def find_edges(
    axis: AxisCode, contrast: FloatImage, noise: FloatImage, good: BoolArray, rows: slice, along: int, bias: EdgeBias
) -> Edges:
    """Edges between neighbours that are both good and one stripe apart, the first of them in `rows`.

    `contrast` is white - black and `noise` the standard deviation of pattern - inverse, both (height, width).
    The difference of pattern and inverse is taken relative to the contrast, so that albedo does not shift the edge;
    what a straight line misses it by is taken out, and what a sharp camera's blur makes of brightness that changes.
    """
    spacing = _stripes_per_pixel(axis.code, good, along) if bias.any() else contrast  # of no bias, any will do
    most = int(np.count_nonzero(good))
    place, seen = np.empty(most, np.int32), np.empty((3, most), np.float32)
    count = kernel.find_edges(
        axis.code,
        axis.near,
        axis.far,
        contrast,
        noise,
        good.view(np.uint8),
        (rows.start, rows.stop),
        along,
        EDGE_SIGMA,
        STEEPEST_CONTRAST,
        spacing,
        bias,
        PER_STRIPE,
        (BLUR, BLUR_DOUBT),
        place,
        seen,
    )
    return Edges(place[:count].copy(), seen[:, :count].copy())


def _stripes_per_pixel(code: CodeImage, good: BoolArray, along: int) -> FloatImage:
    """(height, width) mean steps of the code between good neighbours about each pixel."""
    here, there = neighbours(along)
    step = np.abs(code[there] - code[here])
    counted = good[here] & good[there] & (step <= MOST_STRIPES)
    found: list[FloatImage] = []
    for values in (step * counted, counted):
        image = np.zeros(code.shape, np.float32)
        image[here] = values
        around = cv2.boxFilter(image, cv2.CV_32F, (AROUND, AROUND), normalize=False, borderType=cv2.BORDER_CONSTANT)
        found.append(cast(FloatImage, around))
    return cast(FloatImage, found[0] / np.maximum(found[1], 1))


class PlaneFitter:
    """Weighted least squares about every cell of a picture, in closed form from nine moments.

    A window that a rim cuts off weighs its edges alike no more, and those nearest to it tell most: its planes' variance
    is that of what they are sums of, by six moments more, with the window's square.

    x runs along the axis of comparison and y across it, both from the cell's centre. Bands of rows that begin at
    multiples of a cell may be taken by several threads at a time; each step needs the one before of the bands around.
    """

    def __init__(self, shape: tuple[int, ...], cell: int, along: int, largest_residual: float) -> None:
        height, self._width = shape
        cells = -(-height // cell), -(-self._width // cell)  # the last ones cut off by the border
        self._cell, self._along, self._largest_residual = cell, along, largest_residual
        self._window, self._window_squared = (_kernels(cell, WINDOW_SIGMA / root) for root in (1.0, 2**0.5))
        self._sums, self._misses, self._planes, self._shape, self._loose = (
            np.zeros((count, *cells), np.float32) for count in (len(MOMENTS), 3, 3, 5, 2)
        )
        self._variance = np.zeros(cells, np.float32)
        self._even, self._sure, self._whole = (np.zeros(cells, np.uint8) for _ in range(3))

    def add(self, rows: range, edges: Edges) -> None:
        """First: the edges of every band."""
        room = np.zeros((self._sums.shape[2], len(MOMENTS)), np.float32)
        top = rows.start // self._cell
        kernel.moments(edges.place, edges.seen, self._width, self._cell, self._along, top, room, self._sums)

    def fit(self, rows: range, edges: Edges) -> None:
        """Second: the planes of a band, and by how much its edges miss them."""
        here = self._cells(rows)
        for around, inner, columns in self._windows(here):
            own = self._sums[around]
            sums, squares = (
                np.ascontiguousarray(_windowed(own[: len(names)], names, kernels, self._along)[:, *inner])
                for names, kernels in ((MOMENTS, self._window), (OF_WEIGHTS, self._window_squared))
            )
            planes, shape, loose = (np.empty((n, *sums.shape[1:]), np.float32) for n in (3, 5, 2))
            planes_kernel.solve(sums, squares, (self._cell**2 - 1) / 12, planes, shape, loose)
            for whole, part in ((self._planes, planes), (self._shape, shape), (self._loose, loose)):
                whole[:, here, columns] = part
        planes, frame = self._planes, (self._width, self._cell, self._along, here.start)
        kernel.misses(edges.place, edges.seen, planes, self._loose, *frame, self._misses)

    def judge(self, rows: range) -> None:
        """Third: how well the planes of a band fit."""
        here, window = self._cells(rows), self._window[0]
        for around, inner, columns in self._windows(here):
            missed = _filtered(_filtered(self._misses[around], window, 0), window, 1)[:, *inner]
            variance = np.empty(missed.shape[1:], np.float32)
            even, sure, whole = (np.empty(variance.shape, np.uint8) for _ in range(3))
            planes_kernel.judge(
                np.ascontiguousarray(missed),
                np.ascontiguousarray(self._loose[:, here, columns]),
                ((EDGE_SIGMA / self._cell) ** 2, 1 / self._cell**2),
                (self._largest_residual**2, LARGEST_SIGMA**2),
                variance,
                even,
                sure,
                whole,
            )
            for own, part in ((self._variance, variance), (self._even, even), (self._sure, sure), (self._whole, whole)):
                own[here, columns] = part

    def fitted(self) -> PlaneFit:
        """At last: the planes of all bands, without what bent surfaces make of them."""
        here = _filled(self._whole, 0), _filled(self._whole, 1)  # all points are of whole windows
        value, *slopes = (np.ascontiguousarray(own[here]) for own in self._planes)
        variance, whole = np.ascontiguousarray(self._variance[here]), np.ascontiguousarray(self._whole[here])
        moments = {name: own[here] for name, own in zip(("x", "y", "xx", "yy", "xy"), self._shape, strict=True)}
        bias, doubt = plane_bias((slopes[0], slopes[1]), moments, np.sqrt(variance), whole, self._cell, self._along)
        value -= bias
        doubt *= doubt
        self._variance[here] = variance * scatter_level(value, variance + doubt, self._flat(here, whole)) + doubt
        self._planes[0][here] = value
        return PlaneFit(self._planes, self._sure, self._even, self._variance, self._cell, self._along)

    def _flat(self, here: tuple[slice, slice], whole: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """1 where a whole window's edges miss their plane by no more than usual: where it folds they do."""
        variance, share = self._variance[here], self._loose[1][here].copy()
        few = slice(None, None, FOLD_EVERY), slice(None, None, FOLD_EVERY)
        whole = whole & (self._sums[0][here] > 0).view(np.uint8)
        told = whole[few].view(np.bool_)
        if not told.any():
            return whole
        share *= np.float32(FOLDED * np.median(variance[few][told] / share[few][told]))
        return whole & (variance < share).view(np.uint8)

    def _windows(self, here: slice) -> Iterator[tuple[tuple[slice, ...], tuple[slice, slice], slice]]:
        """Of those rows of cells the runs of columns that edges can be seen from, as their columns; the part of the
        picture's sums that their windows see; and where in this they are."""
        height, width = self._planes.shape[1:]
        top, bottom = max(here.start - WINDOW_RADIUS, 0), min(here.stop + WINDOW_RADIUS, height)
        filled = np.flatnonzero(self._sums[0, top:bottom].any(axis=0))
        ends = np.flatnonzero(np.diff(filled) > 2 * MARGIN)
        for first, last in zip(filled[np.r_[0, ends + 1]], filled[np.r_[ends, -1]], strict=True) if len(filled) else ():
            left, right = max(int(first) - MARGIN, 0) // ALIGNED * ALIGNED, min(int(last) + MARGIN + 1, width)
            start = left + WINDOW_RADIUS if left else 0
            stop = right - WINDOW_RADIUS if right < width else width
            inner = slice(here.start - top, here.stop - top), slice(start - left, stop - left)
            yield (slice(None), slice(top, bottom), slice(left, right)), inner, slice(start, stop)

    def _cells(self, rows: range) -> slice:
        """The rows of cells of a band."""
        return slice(rows.start // self._cell, -(-rows.stop // self._cell))


def _filled(cells: NDArray[np.uint8], axis: int) -> slice:
    """From the first to the last row, or column, that holds any, and as far as it tells of a bend."""
    filled = np.flatnonzero(cells.max(axis=1 - axis))
    return slice(max(int(filled[0]) - MARGIN, 0), int(filled[-1]) + MARGIN + 1) if len(filled) else slice(0, 1)


def _windowed(own: FloatImage, names: Sequence[str], kernels: Sequence[FloatImage], along: int) -> FloatImage:
    """Sums over the window from sums over single cells, by moment: about another centre they take lower ones along,
    the sum of (letter + offset)^power and whatever else the moment is of."""
    for letter, axis in (("x", along), ("y", 1 - along)):
        total = _filtered(own, kernels[0], axis)
        for taken in (1, 2):
            higher = [k for k, name in enumerate(names) if name.count(letter) >= taken]
            lower = _filtered(
                own[[names.index(names[k].replace(letter, "", taken)) for k in higher]], kernels[taken], axis
            )
            for k, added in zip(higher, lower, strict=True):
                total[k] += added if names[k].count(letter) == taken else 2 * added
        own = total
    return own


def _kernels(cell: int, spread: float) -> Sequence[FloatImage]:
    """A Gaussian window along one axis, of so many cells, times offset^power in pixels, for powers 0 to 2."""
    offset = np.arange(-WINDOW_RADIUS, WINDOW_RADIUS + 1, dtype=np.float64)
    return [(np.exp(-0.5 * (offset / spread) ** 2) * (cell * offset) ** power).astype(np.float32) for power in range(3)]


def _filtered(images: FloatImage, kernel: FloatImage, axis: int) -> FloatImage:
    """Correlation of (N, rows, columns) along rows or columns, all in one picture; beyond borders there is nothing."""
    count, rows, columns = images.shape
    if axis == 0:
        apart = np.zeros((count, rows + WINDOW_RADIUS, columns), np.float32)
        apart[:, :rows] = images
        images = apart
    kernel_2d = kernel[None, :] if axis == 1 else kernel[:, None]
    found = cv2.filter2D(images.reshape(-1, columns), cv2.CV_32F, kernel_2d, borderType=cv2.BORDER_CONSTANT)
    return cast(FloatImage, found.reshape(images.shape)[:, :rows])
