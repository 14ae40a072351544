"""A picture at any place, compiled by Numba: the inner loop of measuring."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from retrue.geometry.arrays import FloatArray, Image
from retrue.geometry.compiling import called, numba

PICTURES: tuple[Any, ...] = tuple(
    numba.types.Array(depth, 3, "C", readonly=True) for depth in (numba.uint8, numba.uint16)
)

WORTH_A_THREAD = 100  # blocks: waking a thread takes as long as measuring some ten
PART = 64  # blocks that a thread takes at a time
_OTHER = ThreadPoolExecutor(1)


def in_two_threads(work: Callable[[slice], None], count: int) -> None:
    """`work`, which lets go of the interpreter, on all parts of 0 .. count; with a second thread, if a core is free."""
    if count < WORTH_A_THREAD:
        work(slice(0, count))
        return
    parts = iter([slice(k, min(k + PART, count)) for k in range(0, count, PART)])

    def share() -> None:
        for part in parts:
            work(part)

    other = _OTHER.submit(share)
    share()
    if not other.cancel():
        other.result()


@called
def bilinear(picture: Image, x: float, y: float) -> tuple[float, float, float]:
    """The colour of `picture` (h, w, 3) at (x, y); outside as at its border. It has two rows and columns, or more."""
    height, width, _ = picture.shape
    x = min(x, width - 1.0) if x > 0 else 0.0  # NaN, too, stays inside
    y = min(y, height - 1.0) if y > 0 else 0.0
    c, r = min(int(x), width - 2), min(int(y), height - 2)
    fx, fy = x - c, y - r
    d = fx * fy
    a, b, c1, r1 = 1 - fx - fy + d, fx - d, c + 1, r + 1
    e = fy - d
    return (
        a * picture[r, c, 0] + b * picture[r, c1, 0] + e * picture[r1, c, 0] + d * picture[r1, c1, 0],
        a * picture[r, c, 1] + b * picture[r, c1, 1] + e * picture[r1, c, 1] + d * picture[r1, c1, 1],
        a * picture[r, c, 2] + b * picture[r, c1, 2] + e * picture[r1, c, 2] + d * picture[r1, c1, 2],
    )


@called
def read_profile(
    picture: Image,
    weights: FloatArray,
    x: float,
    y: float,
    u: FloatArray,
    v: FloatArray,
    sign: float,
    t: FloatArray,
    s: FloatArray,
    profile: FloatArray,
) -> None:
    """`profile` (T,) <- `weights` (3,) times the colour at (x, y) + sign t u + s v, mean over s; u, v (2,)."""
    for i in range(len(t)):
        total = 0.0
        for beside in s:
            along = sign * t[i]
            red, green, blue = bilinear(picture, x + along * u[0] + beside * v[0], y + along * u[1] + beside * v[1])
            total += weights[0] * red + weights[1] * green + weights[2] * blue
        profile[i] = total / len(s)
