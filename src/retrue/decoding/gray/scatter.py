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
EVERY = 2  # cells along either axis, of which one is looked at: its neighbours rest on the same edges
NEAR = 9  # looked at, side of the square over which differences have a bend in common
AROUND = 7  # looked at, side of the square over which the scatter is averaged: it differs from place to place
CLIPPED = 4.0  # sigmas of the scatter around: what is farther off is a step of the surface
ROUNDS = 2  # of which the first takes the planes' own word for the scatter around
FARTHEST = 20.0  # sigmas: and more would hide its neighbours' common part
BELIEF = 20.0 / EVERY**2  # differences that the planes' own word counts as


def scatter_level(value: FloatImage, variance: FloatImage, whole: NDArray[np.uint8]) -> FloatImage:
    """Variance that planes show, over their own, about each cell; nearer to 1 the fewer tell.

    Parameters
    ----------
    value, variance : of each cell's plane in its centre, (rows, columns).
    whole : 1 where its window lies on one surface.
    """
    height, width = value.shape
    cells = -(-height // EVERY), -(-width // EVERY)
    differences = [found for axis in range(2) if (found := _differences(value, variance, whole, axis)) is not None]
    level: FloatImage = np.ones(cells, np.float32)
    for _ in range(ROUNDS):
        total, known = (np.zeros(cells, np.float32) for _ in range(2))
        for middle, square, told in differences:
            total[middle] += np.minimum(square, np.float32(CLIPPED**2) * level[middle]) * told
            known[middle] += told
        squares, count = (_sum_around(image, AROUND) for image in (total, known))
        level = cast(FloatImage, (squares + np.float32(BELIEF)) / (count + np.float32(BELIEF)))
    return np.repeat(np.repeat(level, EVERY, axis=0), EVERY, axis=1)[:height, :width]


def _differences(
    value: FloatImage, variance: FloatImage, whole: NDArray[np.uint8], axis: int
) -> tuple[tuple[slice, ...], FloatImage, FloatImage] | None:
    """Where the differences along an array axis lie among the cells looked at, their squares in sigmas, and 1 where
    all their cells are whole; None where there is no room for any."""
    length = value.shape[axis] - 3 * APART
    if length <= 0:
        return None
    off, expected = _third(value, axis, length), _third_variance(variance, axis, length)
    told = _all_along(whole, axis, length)
    off /= np.sqrt(np.maximum(expected, np.float32(1e-12)))
    off = np.clip(off, -np.float32(FARTHEST), np.float32(FARTHEST), out=off)
    off *= told
    off -= _sum_around(off, NEAR) / np.float32(NEAR**2)  # a little less beside a rim
    off *= off
    first = [0, 0]
    first[axis] = 3 * APART // 2 // EVERY
    return tuple(slice(start, start + count) for start, count in zip(first, off.shape, strict=True)), off, told


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
    """Index of so many cells along an array axis, and of all along the other, of which those are taken that count."""
    cut, every = slice(first, first + length, EVERY), slice(None, None, EVERY)
    return (cut, every) if axis == 0 else (every, cut)


def _sum_around(image: FloatImage, side: int) -> FloatImage:
    square = (side, side)
    return cast(FloatImage, cv2.boxFilter(image, cv2.CV_32F, square, normalize=False, borderType=cv2.BORDER_CONSTANT))
