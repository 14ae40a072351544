"""Planes through the stripe edges of windows: from their moments, and how well they fit."""

from __future__ import annotations

import cython

TINY = cython.declare(cython.float, 1e-6)
CHUNK = cython.declare(cython.Py_ssize_t, 256)  # cells that are taken at a time


def solve(
    sums: cython.const[cython.float][:, :, ::1],
    squares: cython.const[cython.float][:, :, ::1],
    spread: cython.float,
    planes: cython.float[:, :, ::1],
    shape: cython.float[:, :, ::1],
    loose: cython.float[:, :, ::1],
) -> None:
    """Of each window's `sums` (9, R, C) of w, wx, wxx, wy, wyy, wxy, wv, wxv, wyv the plane v = a + b x + c y.

    `planes` (3, R, C) <- a, b, c; `shape` (5, R, C) <- mean x, mean y, and the second moments xx, yy, xy about these;
    `loose` (2, R, C) <- by how much a value in the centre moves a; and the plane's variance about there, over places of
    variance `spread` in x and in y, of values that scatter by 1 over their own weight u. With w = k u, k the window, it
    is that of M^-1 Q M^-1, M the moments of w, and Q, of which are `squares` (6, R, C), those of k w.
    """
    cython.declare(r=cython.Py_ssize_t, c=cython.Py_ssize_t, i=cython.Py_ssize_t, count=cython.Py_ssize_t)
    cython.declare(p=cython.float, a=cython.float, b=cython.float, d=cython.float, e=cython.float, f=cython.float)
    cython.declare(g=cython.float, h=cython.float, k=cython.float, s=cython.float, t=cython.float)
    w = cython.declare(cython.float[256])
    x = cython.declare(cython.float[256])
    xx = cython.declare(cython.float[256])
    y = cython.declare(cython.float[256])
    yy = cython.declare(cython.float[256])
    xy = cython.declare(cython.float[256])
    v = cython.declare(cython.float[256])
    xv = cython.declare(cython.float[256])
    yv = cython.declare(cython.float[256])
    q = cython.declare(cython.float[256])
    qx = cython.declare(cython.float[256])
    qxx = cython.declare(cython.float[256])
    qy = cython.declare(cython.float[256])
    qyy = cython.declare(cython.float[256])
    qxy = cython.declare(cython.float[256])
    lever = cython.declare(cython.float[256])
    varied = cython.declare(cython.float[256])
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
                for i in range(count):
                    q[i] = squares[0, r, c + i]
                    qx[i] = squares[1, r, c + i]
                    qxx[i] = squares[2, r, c + i]
                    qy[i] = squares[3, r, c + i]
                    qyy[i] = squares[4, r, c + i]
                    qxy[i] = squares[5, r, c + i]
                for i in range(count):  # which nobody else can write to: many are made at a time
                    p = w[i]
                    p = one / (p if p > TINY else TINY)
                    a, b, d = x[i] * p, y[i] * p, v[i] * p
                    e, f, g = xx[i] * p - a * a, yy[i] * p - b * b, xy[i] * p - a * b
                    h, k = xv[i] * p - a * d, yv[i] * p - b * d
                    w[i], x[i], y[i], xx[i], yy[i], xy[i] = p, a, b, e, f, g
                    p = e * f - g * g
                    p = one / (p if p > TINY else TINY)
                    e, f, g = e * p, f * p, g * p
                    h, k = f * h - g * k, e * k - g * h
                    v[i], xv[i], yv[i] = d - (h * a + k * b), h, k
                    s, t = f * a - g * b, e * b - g * a
                    h, k = s * a + t * b, q[i]
                    lever[i] = h = w[i] * (one + (h if h > 0 else h - h))
                    # About the mean place, the plane is the sum of w v times 1 - s x - t y, f x - g y and e y - g x.
                    qxx[i], qyy[i] = qxx[i] - a * (qx[i] + qx[i] - a * k), qyy[i] - b * (qy[i] + qy[i] - b * k)
                    qxy[i], qx[i], qy[i] = qxy[i] - a * qy[i] - b * qx[i] + a * b * k, qx[i] - a * k, qy[i] - b * k
                    k = k - 2 * (s * qx[i] + t * qy[i] - s * t * qxy[i]) + s * s * qxx[i] + t * t * qyy[i]
                    k = k + spread * ((f * f + g * g) * qxx[i] + (e * e + g * g) * qyy[i] - 2 * g * (e + f) * qxy[i])
                    k = k * (w[i] * w[i])
                    varied[i] = k if k > 0 and k < h else h  # which it is at most, but for rounding
                for i in range(count):
                    planes[0, r, c + i] = v[i]
                    planes[1, r, c + i] = xv[i]
                    planes[2, r, c + i] = yv[i]
                    shape[0, r, c + i] = x[i]
                    shape[1, r, c + i] = y[i]
                    shape[2, r, c + i] = xx[i]
                    shape[3, r, c + i] = yy[i]
                    shape[4, r, c + i] = xy[i]
                    loose[0, r, c + i] = lever[i]
                    loose[1, r, c + i] = varied[i]
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
    """How well planes fit, of each window's `misses` (3, R, C): sums of w off^2, of w, and of what
    w off^2 should be where w is 1 over the variance.

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
                variance[r, c] = own * loose[1, r, c] * scale
            for c in range(misses.shape[2]):
                even[r, c] = misses[0, r, c] / (misses[1, r, c] + TINY) < rough
                sure[r, c] = variance[r, c] < most
                whole[r, c] = even[r, c] & (misses[1, r, c] > TINY)
