"""Pairs of pictures to stripe numbers and stripe edges, in integer arithmetic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from retrue.geometry.arrays import BoolArray, Image
from retrue.kernels import pixels
from retrue.kernels import stripes as kernel

CodeImage = NDArray[np.int16]
Runs = NDArray[np.int32]
"""(M, 3): row, first and one past the last column of runs of pixels."""
SHORTEST_GAP = 32
"""Pixels: runs that less parts are one."""
RUNS_AT_A_TIME = 64
"""So that what is known of their pixels stays in the processor's cache from bit to bit."""
ROOM = 513
"""What the kernel takes at a time, and one more."""


@dataclass(frozen=True, slots=True, eq=False)
class AxisCode:
    """What one axis of the code says in a band of rows; anything where it was not read.

    Attributes
    ----------
    code : (height, width), the number n whose Gray code the pixel sees.
    second_margin : (height, width), |pattern - inverse| of the bit that is second to least sure. At the edge of a
        stripe exactly one bit is undecided, and n is one of two neighbours; a second undecided bit means that n
        can be anything.
    near, far : (height, width), |pattern - inverse| of the bit that changes between a pixel and the next along the
        axis of comparison, in the first and in the second of them; 0 where none changes.
    """

    code: CodeImage
    second_margin: Image
    near: Image
    far: Image


def decode_axis(
    patterns: Sequence[Image], inverses: Sequence[Image], along: int, where: BoolArray | None = None
) -> AxisCode:
    """Read one axis of the code, most significant bit first; `along` is the array axis of the neighbours.

    `where` (height, width): the pixels to read; all, if not given.
    """
    shape, dtype = patterns[0].shape, patterns[0].dtype
    runs = runs_of(np.ones(shape, np.bool_) if where is None else where)
    first, second = (np.full(shape, np.iinfo(dtype).max, dtype) for _ in range(2))
    code, near, far = np.zeros(shape, np.int16), np.zeros(shape, dtype), np.zeros(shape, dtype)
    room = np.empty((4, ROOM), dtype)
    for start in range(0, len(runs), RUNS_AT_A_TIME):
        part = runs[start : start + RUNS_AT_A_TIME]
        for pattern, inverse in zip(patterns, inverses, strict=True):
            kernel.add_bit(pattern, inverse, part, along, room, code, first, second, near, far)
    return AxisCode(code, second, near, far)


def runs_of(where: BoolArray) -> Runs:
    """The runs of pixels that hold all of those."""
    height, width = where.shape
    found = np.empty((height * (width // SHORTEST_GAP + 1), 3), np.int32)
    return found[: pixels.spans(where.view(np.uint8), SHORTEST_GAP, found)]


def neighbours(along: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Index of the first and of the second pixel of every pair of neighbours along an array axis."""
    first, second, every = slice(None, -1), slice(1, None), slice(None)
    return ((first, every), (second, every)) if along == 0 else ((every, first), (every, second))
