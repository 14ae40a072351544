"""Coloured lines: a sequence of columns and one of rows, every few neighbours unique in each (De Bruijn)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from retrue.errors import InputError, require_kind
from retrue.geometry.arrays import FloatArray, whole_numbers, whole_size
from retrue.patterns.color_grid import whole_colors
from retrue.ranges import require_number
from retrue.shown import ShortRepr, Shown

COLUMN_COLORS = ((255, 0, 191), (255, 191, 0), (0, 64, 255), (0, 255, 128))
ROW_COLORS = ((191, 0, 255), (255, 0, 0), (0, 255, 255), (128, 255, 0))
"""Hues a quarter turn apart, those of the rows halfway between those of the columns: no row looks like a column."""

WINDOW = 3  # neighbouring lines of one direction that are unique
COUNT = len(COLUMN_COLORS) ** WINDOW + WINDOW - 1  # lines of one direction, as many as that allows
WIDTH_SHARE = 0.27  # of the pitch: lines so narrow stay apart when out of focus
SMALLEST_PITCH = 4  # pixels: lines of one pixel and the gaps to measure them in


@dataclass(frozen=True, slots=True, repr=False)
class Lines(ShortRepr):
    """A family of parallel lines; the middle of line k lies at projector pixel origin + k * pitch.

    Attributes
    ----------
    colors : red, green, blue, 0 .. 255, of each colour.
    sequence : index into `colors` of each line.
    origin, pitch, width : of the first line's middle, from line to line, and across a line, in projector pixels.
    """

    colors: tuple[tuple[int, int, int], ...]
    sequence: tuple[int, ...]
    origin: float
    pitch: float
    width: float

    def __post_init__(self) -> None:
        colors = whole_colors(self.colors, "colors")
        sequence = tuple(whole_numbers(self.sequence, (None,), "sequence").tolist())
        require_number(self.origin, "origin")
        for name in ("pitch", "width"):
            require_number(getattr(self, name), name, 0, above=True)
        if not sequence:
            raise InputError("line grid: expected a sequence of one line or more, found none")
        if not all(0 <= k < len(colors) for k in sequence):
            raise InputError(f"line grid: expected indices 0 .. {len(colors) - 1} in the sequence, one for each colour")
        if not 0 < self.width < self.pitch:
            raise InputError(f"line grid: expected 0 < width < pitch, found {self.width:g} and {self.pitch:g}")
        object.__setattr__(self, "colors", colors)
        object.__setattr__(self, "sequence", sequence)

    def middles(self) -> FloatArray:
        """Projector pixel (N,) of the middle of each line, across it.

        >>> Lines(((255, 0, 0), (0, 255, 0)), (0, 1, 0), origin=11, pitch=8, width=3).middles().tolist()
        [11.0, 19.0, 27.0]
        """
        return self.origin + self.pitch * np.arange(len(self.sequence), dtype=np.float64)

    def coverage(self, side: int) -> FloatArray:
        """(N, side) how much of each pixel each line covers."""
        middle, pixel = self.middles()[:, None], np.arange(side)
        start = np.maximum(middle - self.width / 2, pixel - 0.5)
        end = np.minimum(middle + self.width / 2, pixel + 0.5)
        return np.clip(end - start, 0.0, 1.0)

    def _shown(self) -> Shown:
        return f"{len(self.sequence)} of {len(self.colors)} colors, {self.width:g} px every {self.pitch:g} px", {}


@dataclass(frozen=True, slots=True, repr=False)
class LineGrid(ShortRepr):
    """Coloured columns over coloured rows, as a spec; one family alone makes coloured stripes, and one coordinate.

    Attributes
    ----------
    projector_size : (width, height).
    columns, rows : the upright and the level lines; None: there are none.
    """

    projector_size: tuple[int, int]
    columns: Lines | None = None
    rows: Lines | None = None

    def __post_init__(self) -> None:
        width, height = size = whole_size(self.projector_size, "projector_size")
        object.__setattr__(self, "projector_size", size)
        if self.columns is None and self.rows is None:
            raise InputError("line grid: expected columns, rows or both, found neither")
        for name, lines, side in (("columns", self.columns, width), ("rows", self.rows, height)):
            if lines is None:
                continue
            require_kind(lines, Lines, name)
            first, last = lines.middles()[[0, -1]] + np.array([-0.5, 0.5]) * lines.width
            if not (first >= -0.5 and last <= side - 0.5):
                raise InputError(
                    f"line grid: expected {name} between -0.5 and {side - 0.5:g}, the ends of the projector's picture, "
                    f"found lines from {first:g} to {last:g}"
                )

    def render(self) -> NDArray[np.uint8]:
        """The picture to project, (height, width, 3); where lines cross, the column is seen.

        >>> lines = Lines(((255, 0, 0), (0, 255, 0)), (0, 1), origin=1, pitch=3, width=1)
        >>> grid = LineGrid((6, 4), columns=lines)
        >>> grid.render()[0, :, 0].tolist(), grid.render()[0, :, 1].tolist()
        ([0, 255, 0, 0, 0, 0], [0, 0, 0, 0, 255, 0])
        """
        width, height = self.projector_size
        picture = np.zeros((height, width, 3))
        for lines, side, axis in ((self.rows, height, 1), (self.columns, width, 0)):
            if lines is None:
                continue
            covered = lines.coverage(side)
            color = np.expand_dims(covered.T @ np.array(lines.colors, dtype=np.float64)[list(lines.sequence)], axis)
            free = np.expand_dims(1 - covered.sum(axis=0), (axis, 2))
            picture = picture * free + color
        return np.floor(picture + 0.5).astype(np.uint8)

    def _shown(self) -> Shown:
        width, height = self.projector_size
        families = [
            f"{len(lines.sequence)} {name} every {lines.pitch:g} px"
            for name, lines in (("columns", self.columns), ("rows", self.rows))
            if lines is not None
        ]
        return f"{width} x {height} px, {', '.join(families)}", {}


def make_line_grid(projector_size: tuple[int, int] = (800, 600)) -> LineGrid:
    """Columns and rows over the whole of the projector's picture; the same size gives the same grid, always.

    Any three neighbouring columns have colours that no other three have, nor have any three rows: a De Bruijn sequence
    of each direction.

    Raises
    ------
    InputError
        where the picture is too small for lines and gaps.

    >>> grid = make_line_grid((1024, 768))
    >>> len(grid.columns.sequence), grid.columns.pitch, grid.rows.pitch, grid.rows.width
    (66, 15.0, 11.0, 3.0)
    """
    projector_size = whole_size(projector_size, "projector_size")
    sequence = de_bruijn(len(COLUMN_COLORS), WINDOW)
    families: list[Lines] = []
    for colors, side, name in zip((COLUMN_COLORS, ROW_COLORS), projector_size, ("width", "height"), strict=True):
        pitch = side // COUNT
        if not pitch >= SMALLEST_PITCH:
            raise InputError(
                f"line grid: expected a {name} of {COUNT * SMALLEST_PITCH} pixels or more, for {COUNT} lines, "
                f"found {side}"
            )
        width = 2 * round((WIDTH_SHARE * pitch - 1) / 2) + 1  # odd: its middle is the middle of a pixel
        origin = (side - 1 - (COUNT - 1) * pitch) // 2
        families.append(Lines(colors, sequence, float(origin), float(pitch), float(width)))
    return LineGrid(projector_size, *families)


def de_bruijn(colors: int, window: int) -> tuple[int, ...]:
    """A shortest sequence that has every word of `window` colours once: colors^window + window - 1 long.

    Lyndon words in order, one after the other (Fredricksen, Maiorana 1978).

    >>> de_bruijn(2, 3)
    (0, 0, 0, 1, 0, 1, 1, 1, 0, 0)
    """
    sequence: list[int] = []
    word = [-1]
    while word:
        word[-1] += 1
        if window % len(word) == 0:
            sequence += word
        word = (word * window)[:window]
        while word and word[-1] == colors - 1:
            word.pop()
    return (*sequence, *sequence[: window - 1])
