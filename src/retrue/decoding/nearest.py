"""Nearest neighbours in the plane, by cells."""

from __future__ import annotations

import numpy as np

from retrue.geometry.arrays import FloatArray, IntArray
from retrue.kernels import links as kernel


def nearest(places: FloatArray, points: FloatArray) -> tuple[FloatArray, IntArray]:
    """Distance (M,) from each of `points` (M, 2) to the nearest of `places` (N, 2), one or more, and its index (M,)."""
    distance, index = nearest_of_all(places, points, 1)
    return distance[:, 0], index[:, 0]


def nearest_of_all(places: FloatArray, points: FloatArray, count: int) -> tuple[FloatArray, IntArray]:
    """The same of the `count` nearest ones, (M, count), the nearest first; `places` has as many or more.

    SciPy's k-d tree takes five to fifteen times as long, and its import longer than all of decoding.
    """
    square, index = np.empty((len(points), count)), np.empty((len(points), count), np.int64)
    start, room = np.zeros(4 * len(places) + 4, np.int64), np.empty((2, len(places)), np.int64)
    kernel.nearest(np.ascontiguousarray(places), np.ascontiguousarray(points), start, room, square, index)
    return np.sqrt(square), index
