"""Bright blobs of a mask: their moments, the light they add, and which colour each has."""

from __future__ import annotations

import cython
from cython.cimports.libc.math import sqrt

INFINITY = cython.declare(cython.double, float("inf"))


def count_changes(height: cython.const[cython.uchar][:, ::1], counts: cython.longlong[::1]) -> cython.void:
    """`counts` (511,) += how often each size of the second difference occurs along every seventh row."""
    cython.declare(y=cython.Py_ssize_t, x=cython.Py_ssize_t)
    with cython.nogil:
        for y in range(0, height.shape[0], 7):
            for x in range(1, height.shape[1] - 1):
                ends = cython.cast(cython.int, height[y, x - 1]) + cython.cast(cython.int, height[y, x + 1])
                change = ends - 2 * cython.cast(cython.int, height[y, x])
                counts[change if change >= 0 else -change] += 1


def find_runs(mask: cython.const[cython.uchar][:, ::1], runs: cython.int[:, ::1]) -> cython.Py_ssize_t:
    """`runs` <- row, first and last column of all that is lit in each row, and a run of the same blob, the blob's first
    one itself; returns their number. Runs are linked that lie above each other."""
    y: cython.Py_ssize_t
    with cython.nogil:
        count, above, above_end = 0, 0, 0
        width = mask.shape[1]
        for y in range(mask.shape[0]):
            begin: cython.Py_ssize_t = count
            x: cython.Py_ssize_t = 0
            while x < width:
                if mask[y, x] == 0:
                    x += 1
                    continue
                first: cython.Py_ssize_t = x
                while x < width and mask[y, x] != 0:
                    x += 1
                runs[count, 0], runs[count, 1], runs[count, 2], runs[count, 3] = y, first, x - 1, count
                while above < above_end and runs[above, 2] < first:
                    above += 1
                k: cython.Py_ssize_t = above
                while k < above_end and runs[k, 1] < x:
                    a: cython.Py_ssize_t = runs[count, 3]
                    b: cython.Py_ssize_t = k
                    while runs[a, 3] != a:
                        a = runs[a, 3]
                    while runs[b, 3] != b:
                        b = runs[b, 3]
                    runs[max(a, b), 3] = min(a, b)
                    runs[count, 3] = min(a, b)
                    k += 1
                count += 1
            above, above_end = begin, count
        for k in range(count):
            runs[k, 3] = runs[runs[k, 3], 3]  # of an earlier one, which is linked to the first by now
    return count


def measure_blobs(
    runs: cython.const[cython.int][:, ::1],
    height: cython.Py_ssize_t,
    width: cython.Py_ssize_t,
    least: cython.double,
    most: cython.double,
    blobs: cython.double[:, ::1],
) -> cython.Py_ssize_t:
    """`blobs` (N, 6), zeros at first <- area, centroid x, y and second moments xx, xy, yy of those of an area between
    `least` and `most` that do not touch the border, as many as are returned."""
    n: cython.Py_ssize_t
    with cython.nogil:
        for n in range(runs.shape[0]):
            y: cython.double = runs[n, 0]
            a: cython.double = runs[n, 1]
            b: cython.double = runs[n, 2]
            k: cython.Py_ssize_t = runs[n, 3]
            area = b - a + 1
            along = area * (a + b) / 2
            blobs[k, 0] += area
            blobs[k, 1] += along
            blobs[k, 2] += area * y
            blobs[k, 3] += (b * (b + 1) * (2 * b + 1) - (a - 1) * a * (2 * a - 1)) / 6
            blobs[k, 4] += along * y
            blobs[k, 5] += area * y * y
        for n in range(runs.shape[0]):
            if runs[n, 0] == 0 or runs[n, 0] == height - 1 or runs[n, 1] == 0 or runs[n, 2] == width - 1:
                blobs[runs[n, 3], 0] = 0
        count: cython.Py_ssize_t = 0
        for n in range(runs.shape[0]):
            area = blobs[n, 0]
            if not (area > 0 and least <= area <= most):
                continue
            x, y = blobs[n, 1] / area, blobs[n, 2] / area
            xx, xy, yy = blobs[n, 3] / area - x * x, blobs[n, 4] / area - x * y, blobs[n, 5] / area - y * y
            blobs[count, 0], blobs[count, 1], blobs[count, 2] = area, x, y
            blobs[count, 3], blobs[count, 4], blobs[count, 5] = xx, xy, yy
            count += 1
    return count


@cython.cfunc
@cython.nogil
@cython.inline
@cython.exceptval(check=False)
def _nearest_pixel(x: cython.double) -> cython.Py_ssize_t:
    """Of two that are as near, the even one, as NumPy rounds."""
    pixel: cython.Py_ssize_t = cython.cast(cython.Py_ssize_t, x + 0.5)
    return pixel - 1 if pixel - x == 0.5 and pixel % 2 == 1 else pixel


def added_light(
    picture: cython.const[cython.uchar][:, :, ::1],
    floor: cython.const[cython.uchar][:, :, ::1],
    centre: cython.const[cython.double][:, ::1],
    light: cython.double[:, ::1],
) -> cython.void:
    """`light` (N, 3) <- the mean of the nine pixels about each `centre` (N, 2), rounded, less the `floor` there."""
    cython.declare(n=cython.Py_ssize_t, k=cython.Py_ssize_t, r=cython.Py_ssize_t, c=cython.Py_ssize_t)
    total: cython.int
    with cython.nogil:
        for n in range(centre.shape[0]):
            column = _nearest_pixel(centre[n, 0])
            row = _nearest_pixel(centre[n, 1])
            for k in range(3):
                total = 0
                for r in range(row - 1, row + 2):
                    for c in range(column - 1, column + 2):
                        total += cython.cast(cython.int, picture[r, c, k])
                light[n, k] = (2 * total + 9) // 18 - cython.cast(cython.int, floor[row, column, k])


def brightest(
    amounts: cython.const[cython.double][:, ::1],
    around: cython.const[cython.longlong][:, ::1],
    level: cython.double[:, ::1],
) -> cython.void:
    """`level` (N, 3) <- the brightest of each channel of `amounts` in the blocks `around` (N, M) each, -1: none."""
    cython.declare(red=cython.double, green=cython.double, blue=cython.double, least=cython.double)
    cython.declare(n=cython.Py_ssize_t, k=cython.Py_ssize_t)
    with cython.nogil:
        for n in range(around.shape[0]):
            red, green, blue = 0.0, 0.0, 0.0
            for k in range(around.shape[1]):
                m = around[n, k]
                if m >= 0:
                    red, green, blue = max(red, amounts[m, 0]), max(green, amounts[m, 1]), max(blue, amounts[m, 2])
            least = 0.15 * max(red, green, blue)
            level[n, 0], level[n, 1], level[n, 2] = max(red, least), max(green, least), max(blue, least)


def nearest_colors(
    seen: cython.const[cython.double][:, ::1],
    centres: cython.const[cython.double][:, ::1],
    label: cython.longlong[::1],
    margin: cython.double[::1],
) -> cython.void:
    """`label` (N,) <- the nearest of `centres` (K, 3) to each of `seen` (N, 3); `margin` 0 .. 1 over the second one."""
    cython.declare(n=cython.Py_ssize_t, k=cython.Py_ssize_t)
    with cython.nogil:
        for n in range(seen.shape[0]):
            first, second = INFINITY, INFINITY
            label[n] = 0
            for k in range(centres.shape[0]):
                r, g, b = seen[n, 0] - centres[k, 0], seen[n, 1] - centres[k, 1], seen[n, 2] - centres[k, 2]
                distance = r * r + g * g + b * b
                if distance < first:
                    first, second, label[n] = distance, first, k
                elif distance < second:
                    second = distance
            first, second = sqrt(first), sqrt(second)
            margin[n] = (second - first) / max(second + first, 1e-9)
