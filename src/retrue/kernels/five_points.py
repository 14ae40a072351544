"""Which essential matrix the most matches agree with."""

from __future__ import annotations

import cython

INFINITY = cython.declare(cython.double, float("inf"))


@cython.cfunc
@cython.nogil
@cython.inline
@cython.exceptval(check=False)
def _sampson_square(
    E: cython.const[cython.double][:, ::1], x: cython.double, y: cython.double, u: cython.double, v: cython.double
) -> cython.double:
    """Squared Sampson distance of (x, y, 1) and (u, v, 1)."""
    lx, ly = E[0, 0] * x + E[0, 1] * y + E[0, 2], E[1, 0] * x + E[1, 1] * y + E[1, 2]
    mx, my = E[0, 0] * u + E[1, 0] * v + E[2, 0], E[0, 1] * u + E[1, 1] * v + E[2, 1]
    value = lx * u + ly * v + E[2, 0] * x + E[2, 1] * y + E[2, 2]
    below = lx * lx + ly * ly + mx * mx + my * my
    return value * value / below if below > 0 else INFINITY


def sampson_squares(
    E: cython.const[cython.double][:, ::1],
    x: cython.const[cython.double][:, ::1],
    y: cython.const[cython.double][:, ::1],
    squares: cython.double[::1],
) -> None:
    """`squares` (N,) <- squared Sampson distances of matches (N, 2) to one essential matrix."""
    cython.declare(k=cython.Py_ssize_t)
    with cython.nogil:
        for k in range(x.shape[0]):
            squares[k] = _sampson_square(E, x[k, 0], x[k, 1], y[k, 0], y[k, 1])


def most_agreed(
    E: cython.const[cython.double][:, :, ::1],
    x: cython.const[cython.double][:, ::1],
    y: cython.const[cython.double][:, ::1],
    limit: cython.double,
) -> int:
    """Index of the one of K essential matrices with the most agreement: sums of 1 - square / limit, none below zero.

    One is given up where it falls short even if all points to come agree.
    """
    cython.declare(i=cython.Py_ssize_t, k=cython.Py_ssize_t)
    best: cython.Py_ssize_t = 0
    count: cython.Py_ssize_t = x.shape[0]
    most, scale = -1.0, 1 / limit
    with cython.nogil:
        for i in range(E.shape[0]):
            gain = 0.0
            for k in range(count):
                agreed = 1 - _sampson_square(E[i], x[k, 0], x[k, 1], y[k, 0], y[k, 1]) * scale
                if agreed > 0:
                    gain += agreed
                elif gain + (count - k - 1) <= most:
                    break
            if gain > most:
                most, best = gain, i
    return best
