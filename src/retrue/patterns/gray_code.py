"""Gray code: columns, then rows, each bit as a pattern and its inverse."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from retrue.errors import InputError
from retrue.geometry.arrays import whole_numbers
from retrue.ranges import require_number

MAX_PROJECTOR_SIDE = 16384
MAX_BITS = 14
ORDER = "columns-msb-pattern-inverse-rows-msb-pattern-inverse-white-black"

Axis = Literal[0, 1]
"""0: the columns' code, which tells projector x; 1: the rows' code, which tells projector y."""


@dataclass(frozen=True, slots=True)
class GrayCode:
    """A Gray-code sequence, as a spec; stripe k of an axis shows the bits of g = n ^ (n >> 1), n = k + offset.

    Stripe k covers the projector pixels k * step ... (k + 1) * step - 1, so that its centre lies at
    (k + 1/2) * step - 1/2. An axis takes as many bits as its largest n needs. OpenCV's GrayCodePattern and
    procam-calibration number from 0; scan3d-capture centres the stripes in the code: `offset` says so.

    Attributes
    ----------
    projector_size : (width, height).
    step : side in projector pixels of the smallest stripe.
    offset : n of the first column and of the first row.

    >>> GrayCode((1024, 768)).bits
    (10, 10)
    >>> GrayCode((1920, 1080), step=4).bits
    (9, 9)
    """

    projector_size: tuple[int, int]
    step: int = 1
    offset: tuple[int, int] = (0, 0)

    def __post_init__(self) -> None:
        width, height = whole_numbers(self.projector_size, (2,), "projector_size").tolist()
        if not (1 <= width <= MAX_PROJECTOR_SIDE and 1 <= height <= MAX_PROJECTOR_SIDE):
            raise InputError(
                f"projector_size: expected sides of 1 to {MAX_PROJECTOR_SIDE} pixels, found {width} x {height}"
            )
        require_number(self.step, "step", whole=True)
        whole_numbers(self.offset, (2,), "offset")
        if not 1 <= self.step <= min(width, height):
            raise InputError(f"step: expected 1 to {min(width, height)} projector pixels, found {self.step}")
        if not all(0 <= first < MAX_PROJECTOR_SIDE for first in self.offset):
            raise InputError(f"offset: expected 0 to {MAX_PROJECTOR_SIDE - 1}, found {self.offset}")
        if max(self.bits) > MAX_BITS:
            raise InputError(f"offset: expected codes of at most {MAX_BITS} bits, found {max(self.bits)}")

    @property
    def stripes(self) -> tuple[int, int]:
        """How many columns and rows the code tells apart; the last ones may be narrower than `step`."""
        width, height = self.projector_size
        return -(-width // self.step), -(-height // self.step)

    @property
    def bits(self) -> tuple[int, int]:
        """Bits of the columns' and of the rows' code."""
        columns, rows = self.stripes
        return (columns - 1 + self.offset[0]).bit_length(), (rows - 1 + self.offset[1]).bit_length()

    @property
    def picture_count(self) -> int:
        """Pattern and inverse of every bit, white and black."""
        return 2 * sum(self.bits) + 2

    @property
    def names(self) -> list[str]:
        """What each picture shows, in the order of `render`."""
        bits = [
            f"{axis} bit {bit} {kind}"
            for axis, count in zip(("column", "row"), self.bits, strict=True)
            for bit in range(count)
            for kind in ("pattern", "inverse")
        ]
        return [*bits, "white", "black"]

    def render(self) -> list[NDArray[np.uint8]]:
        """The pictures (height, width) to project, in the order that the spec's `ORDER` names."""
        width, height = self.projector_size
        pictures: list[NDArray[np.uint8]] = []
        for axis, (side, bits) in enumerate(zip((width, height), self.bits, strict=True)):
            n = np.arange(side) // self.step + self.offset[axis]
            gray = n ^ (n >> 1)
            for bit in reversed(range(bits)):
                stripes = np.where((gray >> bit) & 1, 255, 0).astype(np.uint8)
                pattern = np.broadcast_to(stripes[None, :] if axis == 0 else stripes[:, None], (height, width)).copy()
                pictures += [pattern, 255 - pattern]
        white = np.full((height, width), 255, dtype=np.uint8)
        return [*pictures, white, np.zeros_like(white)]
