"""Sums under Tukey's biweight; the statistics are those of `geometry.robust`. NaN has no weight."""

from __future__ import annotations

import cython
from cython.cimports.libc.math import sqrt


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
