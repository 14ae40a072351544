"""Planes through the stripe edges of windows: from their moments, and how well they fit."""

from __future__ import annotations

import cython

TINY = cython.declare(cython.float, 1e-6)
CHUNK = cython.declare(cython.Py_ssize_t, 256)  # cells that are taken at a time


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
    cython.declare(r=cython.Py_ssize_t, c=cython.Py_ssize_t, i=cython.Py_ssize_t, count=cython.Py_ssize_t)
    cython.declare(p=cython.float, a=cython.float, b=cython.float, d=cython.float, e=cython.float, f=cython.float)
    cython.declare(g=cython.float, h=cython.float, k=cython.float)
    w = cython.declare(cython.float[256])
    x = cython.declare(cython.float[256])
    xx = cython.declare(cython.float[256])
    y = cython.declare(cython.float[256])
    yy = cython.declare(cython.float[256])
    xy = cython.declare(cython.float[256])
    v = cython.declare(cython.float[256])
    xv = cython.declare(cython.float[256])
    yv = cython.declare(cython.float[256])
    lever = cython.declare(cython.float[256])
    one: cython.float = 1
    with cython.nogil:
        for r in range(sums.shape[1]):
            c = 0
            while c < sums.shape[2]:
                count = min(CHUNK, sums.shape[2] - c)
                for i in range(count):
                    w[i] = sums[0, r, c + i]
                    x[i] = sums[1, r, c + i]
                    xx[i] = sums[2, r, c + i]
                    y[i] = sums[3, r, c + i]
                    yy[i] = sums[4, r, c + i]
                    xy[i] = sums[5, r, c + i]
                    v[i] = sums[6, r, c + i]
                    xv[i] = sums[7, r, c + i]
                    yv[i] = sums[8, r, c + i]
                for i in range(count):  # which nobody else can write to: many are made at a time
                    p = w[i]
                    p = one / (p if p > TINY else TINY)
                    a, b, d = x[i] * p, y[i] * p, v[i] * p
                    e, f, g = xx[i] * p - a * a, yy[i] * p - b * b, xy[i] * p - a * b
                    h, k = xv[i] * p - a * d, yv[i] * p - b * d
                    w[i], x[i], y[i], xx[i], yy[i], xy[i] = p, a, b, e, f, g
                    p = e * f - g * g
                    p = p if p > TINY else TINY
                    h, k = (f * h - g * k) / p, (e * k - g * h) / p
                    p = (f * (a * a) - (g + g) * (a * b) + e * (b * b)) / p
                    v[i], xv[i], yv[i] = d - (h * a + k * b), h, k
                    lever[i] = one + (p if p > 0 else p - p)
                for i in range(count):
                    planes[0, r, c + i] = v[i]
                    planes[1, r, c + i] = xv[i]
                    planes[2, r, c + i] = yv[i]
                    shape[0, r, c + i] = x[i]
                    shape[1, r, c + i] = y[i]
                    shape[2, r, c + i] = xx[i]
                    shape[3, r, c + i] = yy[i]
                    shape[4, r, c + i] = xy[i]
                    loose[0, r, c + i] = w[i]
                    loose[1, r, c + i] = lever[i]
                c += CHUNK


def judge(
    misses: cython.const[cython.float][:, :, ::1],
    loose: cython.const[cython.float][:, :, ::1],
    noise: tuple[cython.float, cython.float],
    limits: tuple[cython.float, cython.float],
    variance: cython.float[:, ::1],
    even: cython.uchar[:, ::1],
    sure: cython.uchar[:, ::1],
    whole: cython.uchar[:, ::1],
) -> None:
    """How well planes fit, of each window's `misses` (3, R, C): sums of w off^2, of w and of 1.

    `variance` <- that of the plane's a, `loose` as `solve` has it; `even` <- whether the mean of off^2 is below the
    first of `limits`, `sure` <- the variance below the second; `whole` <- even, and by any edge at all. `noise`: by how
    much an edge of weight 1 scatters at least, and what makes sums of weights of what `solve` divided by.
    """
    cython.declare(r=cython.Py_ssize_t, c=cython.Py_ssize_t, own=cython.float, floor=cython.float)
    cython.declare(scale=cython.float, rough=cython.float, most=cython.float)
    floor, scale = noise[0], noise[1]
    rough, most = limits[0], limits[1]
    with cython.nogil:
        for r in range(misses.shape[1]):
            for c in range(misses.shape[2]):
                own = misses[0, r, c] / (misses[2, r, c] + TINY) + floor
                variance[r, c] = own * loose[0, r, c] * loose[1, r, c] * scale
            for c in range(misses.shape[2]):
                even[r, c] = misses[0, r, c] / (misses[1, r, c] + TINY) < rough
                sure[r, c] = variance[r, c] < most
                whole[r, c] = even[r, c] & (misses[1, r, c] > TINY)
