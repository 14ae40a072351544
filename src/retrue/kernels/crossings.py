"""Crossings of lines near each other: which is the next one along each line."""

from __future__ import annotations

import cython
from cython.cimports.libc.math import fabs

NONE = cython.declare(cython.Py_ssize_t, -1)
INFINITY = cython.declare(cython.double, float("inf"))


def along_axes(
    at: cython.const[cython.double][:, ::1],
    axes: cython.const[cython.double][:, :, ::1],
    strip: cython.const[cython.longlong][::1],
    start: cython.const[cython.longlong][::1],
    order: cython.const[cython.longlong][::1],
    rank: cython.const[cython.longlong][::1],
    farthest: cython.double,
    aside: cython.double,
    least: cython.double,
    neighbour: cython.longlong[:, ::1],
) -> cython.void:
    """`neighbour` (N, 4) <- of each place (N, 2) the nearest along both axes (N, 2, 2), then against them, or -1.

    Less than `farthest` ahead, and aside by less than that share of it, or than `least`, which it is ahead at least; of
    equally near ones that of least `rank`. Each lies in an upright strip, as wide as it may be aside or more; `order`
    has those of each from its start on, from above.
    """
    cython.declare(n=cython.Py_ssize_t, m=cython.Py_ssize_t, k=cython.Py_ssize_t, s=cython.Py_ssize_t)
    cython.declare(low=cython.Py_ssize_t, high=cython.Py_ssize_t, middle=cython.Py_ssize_t, axis=cython.Py_ssize_t)
    cython.declare(side=cython.Py_ssize_t, strips=cython.Py_ssize_t)
    nearest_yet = cython.declare(cython.double[4])
    strips = start.shape[0] - 1
    with cython.nogil:
        for n in range(at.shape[0]):
            for side in range(4):
                nearest_yet[side], neighbour[n, side] = INFINITY, NONE
            top, bottom = at[n, 1] - farthest, at[n, 1] + farthest
            for s in range(max(strip[n] - 1, 0), min(strip[n] + 2, strips)):
                low, high = start[s], start[s + 1]
                while low < high:
                    middle = (low + high) // 2
                    if at[order[middle], 1] < top:
                        low = middle + 1
                    else:
                        high = middle
                for k in range(low, start[s + 1]):
                    m = order[k]
                    if not at[m, 1] < bottom:
                        break
                    x, y = at[m, 0] - at[n, 0], at[m, 1] - at[n, 1]
                    for axis in range(2):
                        along = x * axes[n, axis, 0] + y * axes[n, axis, 1]
                        across = fabs(x * axes[n, axis, 1] - y * axes[n, axis, 0])
                        far = fabs(along)
                        if least < far < farthest and across < max(aside * far, least):
                            side = axis if along > 0 else axis + 2
                            if far < nearest_yet[side] or (
                                far == nearest_yet[side] and rank[m] < rank[neighbour[n, side]]
                            ):
                                nearest_yet[side], neighbour[n, side] = far, m
