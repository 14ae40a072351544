"""A picture at any place, compiled by Numba: the inner loop of measuring."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from retrue.geometry.arrays import FloatArray, Image
from retrue.geometry.compiling import MATRIX, OUT_MATRIX, VECTOR, compiled, inlined, numba

PICTURES: tuple[Any, ...] = tuple(
    numba.types.Array(depth, 3, "C", readonly=True) for depth in (numba.uint8, numba.uint16)
)


@inlined
def bilinear(picture: Image, x: float, y: float, color: FloatArray) -> None:
    """`color` (3,) <- `picture` (h, w, 3) at (x, y); outside as at its border."""
    height, width, _ = picture.shape
    x = min(x, width - 1.0) if x > 0 else 0.0  # NaN, too, stays inside
    y = min(y, height - 1.0) if y > 0 else 0.0
    column, row = min(int(x), max(width - 2, 0)), min(int(y), max(height - 2, 0))
    fx, fy = x - column, y - row
    right, below = min(column + 1, width - 1), min(row + 1, height - 1)
    for c in range(3):
        upper = picture[row, column, c] * (1 - fx) + picture[row, right, c] * fx
        lower = picture[below, column, c] * (1 - fx) + picture[below, right, c] * fx
        color[c] = upper * (1 - fy) + lower * fy


@compiled([numba.void(kind, MATRIX, MATRIX, MATRIX, MATRIX, VECTOR, VECTOR, OUT_MATRIX) for kind in PICTURES])
def _profiles(
    picture: Image,
    weights: FloatArray,
    p: FloatArray,
    u: FloatArray,
    v: FloatArray,
    t: FloatArray,
    s: FloatArray,
    out: FloatArray,
) -> None:
    color = np.empty(3)
    for n in range(len(p)):
        for i in range(len(t)):
            total = 0.0
            for beside in s:
                x = p[n, 0] + t[i] * u[n, 0] + beside * v[n, 0]
                y = p[n, 1] + t[i] * u[n, 1] + beside * v[n, 1]
                bilinear(picture, x, y, color)
                total += weights[n, 0] * color[0] + weights[n, 1] * color[1] + weights[n, 2] * color[2]
            out[n, i] = total / len(s)


def profiles(
    picture: Image, weights: FloatArray, p: FloatArray, u: FloatArray, v: FloatArray, t: FloatArray, s: FloatArray
) -> FloatArray:
    """(N, T) `weights` (N, 3) times the colour at p + t u + s v, mean over s: profiles along u. p, u, v (N, 2)."""
    out = np.empty((len(p), len(t)))
    _profiles(picture, weights, p, u, v, t, s, out)
    return out


@compiled([numba.void(kind, MATRIX, OUT_MATRIX) for kind in PICTURES])
def _sample(picture: Image, at: FloatArray, out: FloatArray) -> None:
    for n in range(len(at)):
        bilinear(picture, at[n, 0], at[n, 1], out[n])


def sample(picture: Image, at: FloatArray) -> NDArray[np.float64]:
    """Colours (..., 3) of `picture` at points (..., 2)."""
    out = np.empty((at.size // 2, 3))
    _sample(picture, np.ascontiguousarray(at).reshape(-1, 2), out)
    return out.reshape(*at.shape[:-1], 3)
