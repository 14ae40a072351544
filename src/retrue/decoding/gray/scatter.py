"""How far planes through stripe edges scatter, beside what their own edges say.

Edges of one stripe err alike: where the camera's pixels and the stripes beat, lines of them are off together, which a
single plane takes for the surface. Planes farther apart than their windows reach show it: on a smooth surface, third
differences of their values are noise. Where it bends more strongly, as at the rim of a ball, they are of one sign over
some cells: what they have in common there is left out.
"""

from __future__ import annotations

from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

FloatImage = NDArray[np.float32]

APART = 5  # cells from plane to plane of a difference: hardly an edge is in two windows
NEAR = 11  # cells, side of the square over which differences have a bend in common
AROUND = 15  # cells, side of the square over which the scatter is averaged: it differs from place to place
CLIPPED = 4.0  # sigmas: what is farther off is a step of the surface
FARTHEST = 20.0  # sigmas: and more would hide its neighbours' common part
BELIEF = 20.0  # differences that the planes' own word counts as


def scatter_level(value: FloatImage, variance: FloatImage, whole: NDArray[np.uint8]) -> FloatImage:
    """Variance that planes show, over their own, about each cell; nearer to 1 the fewer tell.

    Parameters
    ----------
    value, variance : of each cell's plane in its centre, (rows, columns).
    whole : 1 where its window lies on one surface.
    """
    total, known = (np.full(value.shape, 0.0, np.float32) for _ in range(2))
    for axis in range(2):
        length = value.shape[axis] - 3 * APART
        if length <= 0:
            continue
        off, expected = _third(value, axis, length), _third_variance(variance, axis, length)
        whole_way = _all_along(whole, axis, length)
        off /= np.sqrt(np.maximum(expected, np.float32(1e-12)))
        off = np.clip(off, -np.float32(FARTHEST), np.float32(FARTHEST), out=off)
        off *= whole_way
        off -= _sum_around(off, NEAR) / np.float32(NEAR**2)  # a little less beside a rim
        square = np.minimum(off * off, np.float32(CLIPPED**2))
        middle = _part(axis, 3 * APART // 2, length)
        total[middle] += square * whole_way
        known[middle] += whole_way
    squares, count = (_sum_around(image, AROUND) for image in (total, known))
    return cast(FloatImage, (squares + np.float32(BELIEF)) / (count + np.float32(BELIEF)))


def _third(value: FloatImage, axis: int, length: int) -> FloatImage:
    """Third differences of places `APART` apart along an array axis."""
    a, b, c, d = (value[_part(axis, place * APART, length)] for place in range(4))
    off = c - b
    off *= np.float32(3)
    off += a
    off -= d
    return off


def _third_variance(variance: FloatImage, axis: int, length: int) -> FloatImage:
    """Of such differences."""
    a, b, c, d = (variance[_part(axis, place * APART, length)] for place in range(4))
    total = b + c
    total *= np.float32(9)
    total += a
    total += d
    return total


def _all_along(whole: NDArray[np.uint8], axis: int, length: int) -> FloatImage:
    """1 where all cells of a difference are whole."""
    reach = 3 * APART + 1
    line = np.ones((reach, 1) if axis == 0 else (1, reach), np.uint8)
    return cv2.erode(whole, line, anchor=(0, 0))[_part(axis, 0, length)].astype(np.float32)


def _part(axis: int, first: int, length: int) -> tuple[slice, slice]:
    """Index of so many cells along an array axis."""
    cut = slice(first, first + length)
    return (cut, slice(None)) if axis == 0 else (slice(None), cut)


def _sum_around(image: FloatImage, side: int) -> FloatImage:
    square = (side, side)
    return cast(FloatImage, cv2.boxFilter(image, cv2.CV_32F, square, normalize=False, borderType=cv2.BORDER_CONSTANT))
