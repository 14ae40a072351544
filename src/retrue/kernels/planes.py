"""Planes through the stripe edges of windows: from their moments, and how well they fit."""

from __future__ import annotations

import cython

TINY = cython.declare(cython.float, 1e-6)


def solve(
    sums: cython.const[cython.float][:, :, ::1],
    planes: cython.float[:, :, ::1],
    shape: cython.float[:, :, ::1],
    loose: cython.float[:, :, ::1],
) -> None:
    """Of each window's `sums` (9, R, C) of w, wx, wxx, wy, wyy, wxy, wv, wxv, wyv the plane v = a + b x + c y.

    `planes` (3, R, C) <- a, b, c; `shape` (5, R, C) <- mean x, mean y, and the second moments xx, yy, xy about these;
    `loose` (2, R, C) <- 1 over the sum of weights, and by how much a's variance exceeds that of a mean.
    """
    cython.declare(r=cython.Py_ssize_t, c=cython.Py_ssize_t, per=cython.float, x=cython.float, y=cython.float)
    cython.declare(v=cython.float, xx=cython.float, xy=cython.float, yy=cython.float, xv=cython.float)
    cython.declare(yv=cython.float, det=cython.float, b=cython.float, d=cython.float, lever=cython.float)
    with cython.nogil:
        for r in range(sums.shape[1]):
            for c in range(sums.shape[2]):
                per = sums[0, r, c]
                per = 1 / (per if per > TINY else TINY)
                x, y, v = sums[1, r, c] * per, sums[3, r, c] * per, sums[6, r, c] * per
                xx = sums[2, r, c] * per - x * x
                yy = sums[4, r, c] * per - y * y
                xy = sums[5, r, c] * per - x * y
                xv = sums[7, r, c] * per - x * v
                yv = sums[8, r, c] * per - y * v
                det = xx * yy - xy * xy
                det = det if det > TINY else TINY
                b, d = (yy * xv - xy * yv) / det, (xx * yv - xy * xv) / det
                lever = (yy * (x * x) - 2 * xy * (x * y) + xx * (y * y)) / det
                planes[0, r, c], planes[1, r, c], planes[2, r, c] = v - (b * x + d * y), b, d
                shape[0, r, c], shape[1, r, c] = x, y
                shape[2, r, c], shape[3, r, c], shape[4, r, c] = xx, yy, xy
                loose[0, r, c], loose[1, r, c] = per, 1 + (lever if lever > 0 else 0)


def judge(
    misses: cython.const[cython.float][:, :, ::1],
    loose: cython.const[cython.float][:, :, ::1],
    floor: cython.float,
    scale: cython.float,
    largest: cython.float,
    mean_square: cython.float[:, ::1],
    variance: cython.float[:, ::1],
    whole: cython.uchar[:, ::1],
) -> None:
    """Of each window's `misses` (3, R, C), sums of w off^2, of w and of 1: `mean_square` <- mean of off^2; `variance`
    <- that of the plane's a, `loose` as `solve` has it; `whole` <- whether the mean is below `largest`.

    An edge of weight 1 scatters by at least `floor`; `scale` makes sums of weights of what `solve` divided by.
    """
    cython.declare(r=cython.Py_ssize_t, c=cython.Py_ssize_t, square=cython.float, own=cython.float)
    with cython.nogil:
        for r in range(misses.shape[1]):
            for c in range(misses.shape[2]):
                square = misses[0, r, c] / (misses[1, r, c] + TINY)
                own = misses[0, r, c] / (misses[2, r, c] + TINY) + floor
                mean_square[r, c] = square
                variance[r, c] = own * loose[0, r, c] * loose[1, r, c] * scale
                whole[r, c] = (square < largest) & (misses[1, r, c] > TINY)
