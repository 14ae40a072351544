"""The Gray-code pictures of a sequence: patterns and inverses by axis and bit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from retrue.decoding.sequence.arrange import ArrangedSequence
from retrue.geometry.arrays import Cut, Image

FEWEST_BITS = 3
"""Of an axis, to be read without its finest ones."""


@dataclass(frozen=True, slots=True)
class Stripes:
    """Where the stripes of one axis of a code lie in the projector.

    Attributes
    ----------
    axis : 0 of columns, 1 of rows.
    width_px, offset_px : of a stripe, and the first pixel of stripe 0.
    side : of the projector, along the axis.
    """

    axis: int
    width_px: int
    offset_px: float
    side: int

    @property
    def first(self) -> int:
        """The stripe that holds the projector's first pixel."""
        return int(-self.offset_px // self.width_px)

    @property
    def last(self) -> int:
        """The stripe that holds its last pixel."""
        return int((self.side - 1 - self.offset_px) // self.width_px)


@dataclass(frozen=True, slots=True, eq=False)
class GraySequence:
    """The pictures of one or both axes of a Gray code, all grey, of one size and type.

    Attributes
    ----------
    stripes : of each axis.
    patterns, inverses : of each axis, most significant bit first; one not taken is white + black less the other.
    names : of the pictures in `patterns` and `inverses`: (pattern, inverse) by axis and bit.
    paired : whether every pattern has an inverse that was taken.
    white, black : of the scene.
    """

    stripes: tuple[Stripes, ...]
    patterns: tuple[list[Image], ...]
    inverses: tuple[list[Image], ...]
    names: tuple[list[tuple[str, str]], ...]
    paired: bool
    white: Image
    black: Image

    def part(self, rows: Cut, columns: Cut) -> GraySequence:
        """The same rows and columns of every picture."""

        def cut(axes: tuple[list[Image], ...]) -> tuple[list[Image], ...]:
            return tuple([cut_picture(image, rows, columns) for image in images] for images in axes)

        white, black = (cut_picture(image, rows, columns) for image in (self.white, self.black))
        return replace(self, patterns=cut(self.patterns), inverses=cut(self.inverses), white=white, black=black)

    def coarser(self) -> GraySequence | None:
        """Without the finest bit of each axis, as stripes of twice the width; None where few bits are left."""
        if min(len(patterns) for patterns in self.patterns) <= FEWEST_BITS:
            return None
        return replace(
            self,
            stripes=tuple(replace(axis, width_px=2 * axis.width_px) for axis in self.stripes),
            patterns=tuple(patterns[:-1] for patterns in self.patterns),
            inverses=tuple(inverses[:-1] for inverses in self.inverses),
            names=tuple(names[:-1] for names in self.names),
        )


def cut_picture(image: Image, rows: Cut, columns: Cut) -> Image:
    """Those rows and columns of a picture; where their numbers are listed a copy, in order."""
    for axis, cut in enumerate((rows, columns)):
        image = image[(slice(None),) * axis + (cut,)] if isinstance(cut, slice) else np.take(image, cut, axis)
    return image


def gray_sequence(sequence: ArrangedSequence, axes: Sequence[int]) -> GraySequence:
    """The Gray code of those axes."""
    stripes: list[Stripes] = []
    patterns: list[list[Image]] = []
    inverses: list[list[Image]] = []
    names: list[list[tuple[str, str]]] = []
    paired = True
    for axis in axes:
        code = sequence.spec.gray(axis)
        assert code is not None
        stripes.append(Stripes(axis, code.step_px << code.lowest, code.offset_px, sequence.spec.projector_size[axis]))
        pairs: list[tuple[Image, Image]] = []
        said: list[tuple[str, str]] = []
        for _, pattern, inverse in code.bits:
            paired &= pattern is not None and inverse is not None
            pairs.append((_taken(sequence, pattern, inverse), _taken(sequence, inverse, pattern)))
            shown = [None if index is None else sequence.names[index] for index in (pattern, inverse)]
            said.append((shown[0] or f"{shown[1]} (inverted)", shown[1] or f"{shown[0]} (inverted)"))
        patterns.append([pattern for pattern, _ in pairs])
        inverses.append([inverse for _, inverse in pairs])
        names.append(said)
    return GraySequence(
        tuple(stripes), tuple(patterns), tuple(inverses), tuple(names), paired, sequence.white, sequence.black
    )


def _taken(sequence: ArrangedSequence, index: int | None, other: int | None) -> Image:
    """A picture, or what its inverse leaves of white and black."""
    if index is not None:
        return sequence.pictures[index]
    assert other is not None
    seen = sequence.pictures[other]
    inverted = sequence.white.astype(np.int32) + sequence.black - seen
    return np.clip(inverted, 0, np.iinfo(seen.dtype).max).astype(seen.dtype)
