"""Which essential matrix the most matches agree with."""

from __future__ import annotations

import cython

INFINITY = cython.declare(cython.double, float("inf"))
MOST_LIMITS = cython.declare(cython.Py_ssize_t, 16)
ASKED = cython.declare(cython.Py_ssize_t, 16)  # every so many points, whether it is worth going on


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
    limits: cython.const[cython.double][::1],
    best: cython.longlong[::1],
    most: cython.double[::1],
) -> None:
    """`best` (L,) <- which of K essential matrices has the most agreement, and `most` (L,) <- how much, at each limit.

    x, y : (2, N) matches.

    That is the sum of 1 - square / limit, none below zero. -1 where none has more than `most` has already. One is given
    up where it falls short of them all even if all points to come agree.
    """
    cython.declare(i=cython.Py_ssize_t, k=cython.Py_ssize_t, j=cython.Py_ssize_t, m=cython.Py_ssize_t)
    cython.declare(start=cython.Py_ssize_t, stop=cython.Py_ssize_t)
    count: cython.Py_ssize_t = x.shape[1]
    number: cython.Py_ssize_t = limits.shape[0]
    gain = cython.declare(cython.double[16])
    square, share = cython.declare(cython.double[16]), cython.declare(cython.double[16])
    if number > MOST_LIMITS:
        raise ValueError("essential matrices: more limits than there is room for")
    for j in range(number):
        best[j] = -1
    with cython.nogil:
        for i in range(E.shape[0]):
            e0, e1, e2 = E[i, 0, 0], E[i, 0, 1], E[i, 0, 2]
            e3, e4, e5 = E[i, 1, 0], E[i, 1, 1], E[i, 1, 2]
            e6, e7, e8 = E[i, 2, 0], E[i, 2, 1], E[i, 2, 2]
            for j in range(number):
                gain[j] = 0.0
            start = 0
            while start < count:
                stop = min(ASKED, count - start)
                for m in range(stop):
                    u, v = y[0, start + m], y[1, start + m]
                    lx = e0 * x[0, start + m] + e1 * x[1, start + m] + e2
                    ly = e3 * x[0, start + m] + e4 * x[1, start + m] + e5
                    mx, my = e0 * u + e3 * v + e6, e1 * u + e4 * v + e7
                    value = lx * u + ly * v + e6 * x[0, start + m] + e7 * x[1, start + m] + e8
                    square[m] = value * value / (lx * lx + ly * ly + mx * mx + my * my)
                for j in range(number):
                    for m in range(stop):  # a branch on each would be guessed wrongly as often as not
                        part = 1 - square[m] / limits[j]
                        share[m] = part if part > 0 else 0.0
                    for m in range(stop):
                        gain[j] += share[m]
                start += ASKED
                hopeless: cython.bint = True
                for j in range(number):
                    hopeless = hopeless and gain[j] + (count - start) <= most[j]
                if hopeless:
                    break
            for j in range(number):
                if gain[j] > most[j]:
                    most[j], best[j] = gain[j], i
