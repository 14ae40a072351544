"""Which picture of a Gray-code capture shows what."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from typing import cast

import cv2
import numpy as np

from retrue.decoding.gray.faults import (
    CAPTURE,
    ends_with_white_and_black,
    explain_count,
    require_complements,
    require_light,
)
from retrue.errors import CaptureError, InputError
from retrue.geometry.arrays import Image
from retrue.patterns.gray_code import GrayCode


@dataclass(frozen=True, slots=True, eq=False)
class GraySequence:
    """The pictures by what they show, all grey, of one size and type.

    Attributes
    ----------
    patterns, inverses : of the columns' bits, and of the rows' bits, most significant first.
    names : of the pictures in `patterns` and `inverses`: (pattern, inverse) by axis and bit.
    white, black : made from the coarsest pairs where the capture has none.
    color : the white picture as it came, for the colours of the points.
    """

    patterns: tuple[list[Image], list[Image]]
    inverses: tuple[list[Image], list[Image]]
    names: tuple[list[tuple[str, str]], list[tuple[str, str]]]
    white: Image
    black: Image
    color: Image

    def part(self, rows: slice, columns: slice) -> GraySequence:
        """The same rows and columns of every picture."""

        def cut(images: Sequence[Image]) -> list[Image]:
            return [image[rows, columns] for image in images]

        (p, q), (r, s) = self.patterns, self.inverses
        white, black, color = cut([self.white, self.black, self.color])
        return GraySequence((cut(p), cut(q)), (cut(r), cut(s)), self.names, white, black, color)


def arrange(pattern: GrayCode, images: Sequence[Image], names: Sequence[str]) -> GraySequence:
    """Sort the pictures by what they show: pairs in the pattern's order; white and black last, first or absent.

    Raises `CaptureError` where their number, size or content does not fit, and names the picture.
    """
    if len(names) != len(images):
        raise InputError(f"names: expected one for each of {len(images)} pictures, found {len(names)}")
    _require_alike(images, names)
    grey = [_grey(image) for image in images]
    pair_count = sum(pattern.bits)
    if len(grey) not in (2 * pair_count, pattern.picture_count):
        raise CaptureError(CAPTURE, explain_count(pattern, grey, names))
    require_light(grey)
    if len(grey) == 2 * pair_count and ends_with_white_and_black(grey):
        raise CaptureError(CAPTURE, explain_count(pattern, grey, names))
    first = _first_pair(grey, names) if len(grey) == pattern.picture_count else 0
    pairs = range(first, first + 2 * pair_count, 2)
    require_complements(grey, names, pairs)

    patterns, inverses = [grey[index] for index in pairs], [grey[index + 1] for index in pairs]
    pair_names = [(names[index], names[index + 1]) for index in pairs]
    columns = pattern.bits[0]
    if len(grey) == pattern.picture_count:
        lit = 0 if first else len(grey) - 2
        white, black, color = grey[lit], grey[lit + 1], images[lit]
    else:
        coarse = [image for start in (0, 2 * columns) for image in grey[start : start + 4]]
        white, black = reduce(np.maximum, coarse), reduce(np.minimum, coarse)
        color = white
    return GraySequence(
        (patterns[:columns], patterns[columns:]),
        (inverses[:columns], inverses[columns:]),
        (pair_names[:columns], pair_names[columns:]),
        white,
        black,
        color,
    )


def _first_pair(grey: Sequence[Image], names: Sequence[str]) -> int:
    """Where the pairs start: 2 when white and black come first, else 0."""
    steps = [float(a[::4, ::4].mean()) - float(b[::4, ::4].mean()) for a, b in (grey[:2], grey[-2:])]
    comes_first = abs(steps[0]) > 1.1 * abs(steps[1])
    if not steps[0 if comes_first else 1] > 0:
        white, black = (names[0], names[1]) if comes_first else (names[-2], names[-1])
        raise CaptureError(
            CAPTURE, f"white and black are swapped: {white} is darker than {black}; expected white, then black"
        )
    return 2 if comes_first else 0


def _require_alike(images: Sequence[Image], names: Sequence[str]) -> None:
    for image, name in zip(images, names, strict=True):
        if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] != 3) or image.size == 0:
            raise CaptureError(CAPTURE, f"{name}: expected height x width (x 3), found shape {image.shape}")
        if image.dtype.name not in ("uint8", "uint16"):
            raise CaptureError(CAPTURE, f"{name}: expected 8 or 16 bits, found {image.dtype}")
        if image.shape[:2] != images[0].shape[:2]:
            sizes = [f"{picture.shape[1]} x {picture.shape[0]}" for picture in (image, images[0])]
            raise CaptureError(CAPTURE, f"sizes differ: {name} is {sizes[0]}, {names[0]} is {sizes[1]} pixels")
        if image.dtype != images[0].dtype:
            raise CaptureError(CAPTURE, f"depths differ: {name} is {image.dtype}, {names[0]} is {images[0].dtype}")


def _grey(image: Image) -> Image:
    return image if image.ndim == 2 else cast(Image, cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))
