"""Which picture shows what; names what does not belong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import cv2

from retrue.errors import CaptureError
from retrue.geometry.arrays import Image
from retrue.patterns.gray_code import GrayCode


@dataclass(frozen=True, slots=True, eq=False)
class GraySequence:
    """The pictures by what they show, all grey, of one size and type.

    Attributes
    ----------
    patterns, inverses : of the columns' bits and of the rows' bits, most significant first.
    white, black : None where the capture has none.
    color : the white picture as it came, for the colours of the points.
    """

    patterns: tuple[list[Image], list[Image]]
    inverses: tuple[list[Image], list[Image]]
    white: Image
    black: Image
    color: Image


def arrange(pattern: GrayCode, images: Sequence[Image], names: Sequence[str]) -> GraySequence:
    grey = [im if im.ndim == 2 else cast(Image, cv2.cvtColor(im, cv2.COLOR_RGB2GRAY)) for im in images]
    if len(images) != pattern.picture_count:
        raise CaptureError("capture", f"expected {pattern.picture_count} pictures, found {len(images)}")
    means = [float(im[::8, ::8].mean()) for im in grey]
    first = means[0] > means[1] and means[0] >= max(means[2:])
    wb = slice(0, 2) if first else slice(-2, None)
    bits = grey[2:] if first else grey[:-2]
    white, black = grey[wb]
    nx = 2 * pattern.bits[0]
    return GraySequence(
        (bits[0:nx:2], bits[nx::2]), (bits[1:nx:2], bits[nx + 1 :: 2]), white, black, list(images)[wb][0]
    )
