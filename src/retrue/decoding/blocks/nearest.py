"""The nearest of many points, in a plane over which they are spread about evenly."""

from __future__ import annotations

import numpy as np

from retrue.geometry.arrays import FloatArray, IntArray
from retrue.geometry.compiling import MATRIX, OUT_MATRIX, VECTOR, compiled, numba


def nearest(places: FloatArray, points: FloatArray) -> tuple[FloatArray, IntArray]:
    """Distance (M,) from each of `points` (M, 2) to the nearest of `places` (N, 2), one or more, and its index (M,)."""
    distance, index = nearest_of_all(places, points, 1)
    return distance[:, 0], index[:, 0]


def nearest_of_all(places: FloatArray, points: FloatArray, count: int) -> tuple[FloatArray, IntArray]:
    """The same of the `count` nearest ones, (M, count), the nearest first; `places` has as many or more."""
    square, index = np.full((len(points), count), np.inf), np.zeros((len(points), count), dtype=np.int64)
    if len(points):
        corner = places.min(axis=0)
        _nearest(
            np.ascontiguousarray(places), np.ascontiguousarray(points), corner, np.ptp(places, axis=0), square, index
        )
    return np.sqrt(square), index


@compiled(numba.void(MATRIX, MATRIX, VECTOR, VECTOR, OUT_MATRIX, numba.types.Array(numba.int64, 2, "C")))
def _nearest(
    places: FloatArray, points: FloatArray, corner: FloatArray, size: FloatArray, square: FloatArray, index: IntArray
) -> None:
    """`square` (M, K), inf at first, and `index` <- by square buckets, two for each place, from inside outwards."""
    count, wanted = len(places), square.shape[1]
    left, top = corner
    width, height = size
    side = max(np.sqrt(width * height / count / 2), max(width, height) / count, 1e-9)
    columns, rows = int(width / side) + 1, int(height / side) + 1
    bucket, start = np.empty(count, np.int64), np.zeros(columns * rows + 2, np.int64)
    for n in range(count):
        bucket[n] = int((places[n, 1] - top) / side) * columns + int((places[n, 0] - left) / side)
        start[bucket[n] + 2] += 1
    for k in range(len(start) - 1):
        start[k + 1] += start[k]
    member = np.empty(count, np.int64)
    for n in range(count):  # moves each start to where the next one was
        member[start[bucket[n] + 1]] = n
        start[bucket[n] + 1] += 1
    for m in range(len(points)):
        # No place is nearer to a point outside the buckets than to where that enters them.
        x, y = min(max(points[m, 0] - left, 0.0), width), min(max(points[m, 1] - top, 0.0), height)
        column, row = int(x / side), int(y / side)
        margin = min(x - column * side, (column + 1) * side - x, y - row * side, (row + 1) * side - y)
        for ring in range(max(columns, rows)):
            if square[m, wanted - 1] <= max(margin + (ring - 1) * side, 0.0) ** 2:
                break
            for r in range(max(row - ring, 0), min(row + ring + 1, rows)):
                stride = 1 if abs(r - row) == ring else max(2 * ring, 1)
                for c in range(column - ring, column + ring + 1, stride):
                    if not 0 <= c < columns:
                        continue
                    for k in range(start[r * columns + c], start[r * columns + c + 1]):
                        dx, dy = places[member[k], 0] - points[m, 0], places[member[k], 1] - points[m, 1]
                        far = dx * dx + dy * dy
                        slot = wanted
                        while slot > 0 and square[m, slot - 1] > far:
                            if slot < wanted:
                                square[m, slot], index[m, slot] = square[m, slot - 1], index[m, slot - 1]
                            slot -= 1
                        if slot < wanted:
                            square[m, slot], index[m, slot] = far, member[k]
