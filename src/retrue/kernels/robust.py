"""Sums under Tukey's biweight; the statistics are those of `geometry.robust`. NaN has no weight."""

from __future__ import annotations

import cython
from cython.cimports.libc.math import sqrt

INFINITY = cython.declare(cython.double, float("inf"))


def reweighted_level(
    values: cython.const[cython.double][::1],
    level: cython.double,
    cutoff: cython.double,
    correction: cython.double,
    smallest: cython.double,
    steps: cython.Py_ssize_t,
) -> cython.double:
    """Standard deviation under the weights that it gives, times root `correction`; `steps` from `level` on."""
    for _ in range(steps):
        scale = 1 / (cutoff * level)
        number, squares = 0.0, 0.0
        for k in range(values.shape[0]):
            relative = values[k] * scale
            inside = 1 - relative * relative
            if inside > 0:
                inside *= inside
                number += inside
                squares += inside * values[k] * values[k]
        level = sqrt(squares * correction / number) if number > 0 else 0.0
        if not level > smallest:
            level = smallest
    return level


def biweights(
    values: cython.const[cython.double][::1], level: cython.double, cutoff: cython.double, weights: cython.double[::1]
) -> None:
    """(1 - (r / cutoff level)^2)^2, zero beyond."""
    scale = 1 / (cutoff * level)
    for k in range(values.shape[0]):
        relative = values[k] * scale
        inside = 1 - relative * relative
        weights[k] = inside * inside if inside > 0 else 0.0


def block_sums(
    values: cython.const[cython.double][::1],
    weights: cython.const[cython.double][::1],
    blocks: cython.const[cython.longlong][::1],
    number: cython.double[::1],
    total: cython.double[::1],
) -> None:
    """Add up the weights, and the weighted values, of each block."""
    for k in range(values.shape[0]):
        if weights[k] > 0:
            number[blocks[k]] += weights[k]
            total[blocks[k]] += weights[k] * values[k]


def number_blocks(
    points: cython.const[cython.double][:, ::1],
    group: cython.const[cython.longlong][::1],
    per_side: cython.longlong,
    extent: cython.double[:, ::1],
    blocks: cython.longlong[::1],
) -> None:
    """Number the cells of a grid over the extent of each group of points; -1 in group -1.

    extent : (G, 4) room for the lowest and highest x and y of each group.
    """
    for k in range(extent.shape[0]):
        extent[k, 0], extent[k, 1], extent[k, 2], extent[k, 3] = INFINITY, -INFINITY, INFINITY, -INFINITY
    for k in range(points.shape[0]):
        which: cython.Py_ssize_t = group[k]
        if which >= 0:
            x, y = points[k, 0], points[k, 1]
            extent[which, 0], extent[which, 1] = min(extent[which, 0], x), max(extent[which, 1], x)
            extent[which, 2], extent[which, 3] = min(extent[which, 2], y), max(extent[which, 3], y)
    for k in range(points.shape[0]):
        which = group[k]
        blocks[k] = -1
        if which >= 0:
            width, height = extent[which, 1] - extent[which, 0], extent[which, 3] - extent[which, 2]
            column: cython.longlong = 0
            row: cython.longlong = 0
            if width > 0:
                column = cython.cast(cython.longlong, (points[k, 0] - extent[which, 0]) / width * per_side)
            if height > 0:
                row = cython.cast(cython.longlong, (points[k, 1] - extent[which, 2]) / height * per_side)
            column, row = min(column, per_side - 1), min(row, per_side - 1)
            blocks[k] = (which * per_side + row) * per_side + column
