"""Pairs of pictures to stripe numbers and stripe edges, in integer arithmetic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from retrue.geometry.arrays import Image

CodeImage = NDArray[np.int16]


@dataclass(frozen=True, slots=True, eq=False)
class AxisCode:
    """What one axis of the code says in a band of rows.

    Attributes
    ----------
    code : (height, width), the number n whose Gray code the pixel sees.
    second_margin : (height, width), |pattern - inverse| of the bit that is second to least sure. At the edge of a
        stripe exactly one bit is undecided, and n is one of two neighbours; a second undecided bit means that n
        can be anything.
    near, far : |pattern - inverse| of the bit that changes between two neighbours, in the first and in the second
        of them; 0 where none changes. One pixel shorter than the band along the axis of comparison.
    """

    code: CodeImage
    second_margin: Image
    near: Image
    far: Image


def decode_axis(patterns: Sequence[Image], inverses: Sequence[Image], along: int) -> AxisCode:
    """Read one axis of the code, most significant bit first; `along` is the array axis of the neighbours."""
    shape, dtype = patterns[0].shape, patterns[0].dtype
    first, second = (np.full(shape, np.iinfo(dtype).max, dtype) for _ in range(2))
    bit = np.zeros(shape, np.uint8)
    code = np.zeros(shape, np.int16)
    here, there = neighbours(along)
    near, far = np.zeros_like(first[here]), np.zeros_like(first[here])
    for pattern, inverse in zip(patterns, inverses, strict=True):
        margin = cast(Image, cv2.absdiff(pattern, inverse))
        one = np.greater(pattern, inverse).view(np.uint8)
        np.bitwise_xor(bit, one, out=bit)
        np.left_shift(code, 1, out=code)
        np.bitwise_or(code, bit, out=code)
        np.minimum(second, np.maximum(first, margin), out=second)
        np.minimum(first, margin, out=first)
        changes = one[here] ^ one[there]
        np.maximum(near, margin[here] * changes, out=near)
        np.maximum(far, margin[there] * changes, out=far)
    return AxisCode(code, second, near, far)


def neighbours(along: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Index of the first and of the second pixel of every pair of neighbours along an array axis."""
    first, second, every = slice(None, -1), slice(1, None), slice(None)
    return ((first, every), (second, every)) if along == 0 else ((every, first), (every, second))
