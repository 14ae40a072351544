"""Points that a shift, or a step in space, puts where a plane has others: what each asks for, and what most do."""

from __future__ import annotations

import cython
from cython.cimports.libc.math import atan2, fabs, hypot, log

INFINITY = cython.declare(cython.double, float("inf"))
WIDER = cython.declare(cython.double, 1.001)  # than the reach, a strip is: rounding leaves nothing beyond the next
SMALLEST = cython.declare(cython.double, 1e-300)
NAN = cython.declare(cython.double, float("nan"))
PARALLEL = cython.declare(cython.double, 1e-10)  # of the squares: what parallel lines tell of a shift along them


def within_reach_of_mode(
    places: cython.const[cython.double][:, ::1],
    every: cython.Py_ssize_t,
    reach: cython.double,
    starts: cython.longlong[::1],
    sorted_places: cython.double[:, ::1],
    members: cython.uchar[::1],
) -> None:
    """`members` (N,) <- which places (2, N) lie within reach, along both axes, of the one with the most of them there.

    One of every so many is asked; of those that have as many, the first is it. Those near each are looked for in three
    of C strips of the first axis, wider than the reach; `starts` (C + 2,) and `sorted_places` (2, N) are room for them.
    """
    cython.declare(i=cython.Py_ssize_t, k=cython.Py_ssize_t, strip=cython.Py_ssize_t, place=cython.Py_ssize_t)
    count: cython.int
    best: cython.Py_ssize_t = 0
    most: cython.int = -1
    strips: cython.Py_ssize_t = starts.shape[0] - 2
    with cython.nogil:
        low, high = INFINITY, -INFINITY
        for k in range(places.shape[1]):
            x = places[0, k]
            if fabs(x) < INFINITY:
                low, high = min(low, x), max(high, x)
        width = max(WIDER * reach, (high - low) / (strips - 1), SMALLEST)
        for strip in range(strips + 2):
            starts[strip] = 0
        for k in range(places.shape[1]):
            if fabs(places[0, k]) < INFINITY:
                starts[cython.cast(cython.Py_ssize_t, (places[0, k] - low) / width) + 2] += 1
        for strip in range(2, strips + 2):
            starts[strip] += starts[strip - 1]
        for k in range(places.shape[1]):  # behind each strip's start, that of the next one
            if fabs(places[0, k]) < INFINITY:
                strip = cython.cast(cython.Py_ssize_t, (places[0, k] - low) / width) + 1
                place = starts[strip]
                sorted_places[0, place], sorted_places[1, place] = places[0, k], places[1, k]
                starts[strip] += 1
        i = 0
        while i < places.shape[1]:  # a range of unknown step would count in Python's numbers
            x, y, count = places[0, i], places[1, i], 0
            if fabs(x) < INFINITY:
                strip = cython.cast(cython.Py_ssize_t, (x - low) / width)
                for k in range(starts[max(strip - 1, 0)], starts[min(strip + 2, strips)]):
                    count += (fabs(sorted_places[0, k] - x) < reach) & (fabs(sorted_places[1, k] - y) < reach)
            if count > most:
                most, best = count, i
            i += every
        if most >= 0:
            x, y = places[0, best], places[1, best]
            for k in range(places.shape[1]):
                members[k] = (fabs(places[0, k] - x) < reach) & (fabs(places[1, k] - y) < reach)


def steps(
    places: cython.const[cython.double][:, ::1],
    forth: cython.const[cython.double][:, ::1],
    inverse_depth: cython.const[cython.double][::1],
    weights: cython.double[:, ::1],
    relative: cython.double[:, :, ::1],
    gaps: cython.double[::1],
) -> None:
    """`relative` (2, N, 2) <- log length and angle of the step p across the view that puts a point where it is.

    That is y ~ h + w p, with y (N, 2+) the places, h (N, 3) `forth` where the plane has the points, and `weights` w
    (2, N) <- plus or minus their inverse depth: such that p leads up either axis. `gaps` (N,) <- the larger of both
    components of y - h.
    """
    cython.declare(k=cython.Py_ssize_t, axis=cython.Py_ssize_t)
    with cython.nogil:
        for k in range(places.shape[0]):
            x, y = places[k, 0] - forth[k, 0] / forth[k, 2], places[k, 1] - forth[k, 1] / forth[k, 2]
            gaps[k] = max(fabs(x), fabs(y)) if x == x and y == y else NAN
            for axis in range(2):
                along, aside = (x, y) if axis == 0 else (y, x)
                w = -inverse_depth[k] if along < 0 else inverse_depth[k]
                scale = forth[k, 2] / w
                weights[axis, k] = w
                relative[axis, k, 0] = log(hypot(x * scale, y * scale) + SMALLEST)
                relative[axis, k, 1] = atan2(aside * scale, along * scale)


def shift_of_most(
    gradient: cython.const[cython.double][:, ::1],
    missed: cython.const[cython.double][::1],
    drawn: cython.const[cython.longlong][::1],
    reach: cython.double,
    shift: cython.double[::1],
) -> cython.longlong:
    """`shift` (2,) <- of those that two drawn rows ask for, the first that most agree with; how many do.

    Rows n agree with d where missed (N,) is gradient (2, N) d to within reach. Two ask for the smallest d that is so of
    both: (A^T A + e I)^-1 A^T (r, s), e only where the gradients are parallel.
    """
    cython.declare(i=cython.Py_ssize_t, j=cython.Py_ssize_t, k=cython.Py_ssize_t, count=cython.longlong)
    most: cython.longlong = -1
    shift[0], shift[1] = NAN, NAN
    with cython.nogil:
        for i in range(drawn.shape[0]):
            for j in range(i + 1, drawn.shape[0]):
                ax, ay, r = gradient[0, drawn[i]], gradient[1, drawn[i]], missed[drawn[i]]
                bx, by, s = gradient[0, drawn[j]], gradient[1, drawn[j]], missed[drawn[j]]
                xx, xy, yy = ax * ax + bx * bx, ax * ay + bx * by, ay * ay + by * by
                least = PARALLEL * (xx + yy) + SMALLEST
                right, down = ax * r + bx * s, ay * r + by * s
                xx, yy = xx + least, yy + least
                inverse = xx * yy - xy * xy
                x, y = (yy * right - xy * down) / inverse, (xx * down - xy * right) / inverse
                count = 0
                for k in range(missed.shape[0]):
                    count += fabs(missed[k] - (x * gradient[0, k] + y * gradient[1, k])) < reach
                if count > most:
                    most, shift[0], shift[1] = count, x, y
    return most
