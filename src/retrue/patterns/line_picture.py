"""The spec of a line grid, read from the picture that was projected."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from retrue.errors import InputError
from retrue.geometry.arrays import BoolArray, Image, IntArray
from retrue.patterns.line_grid import LineGrid, Lines

DARK = 16  # grey levels that a gap may have
FEWEST = 3  # lines that make a family
NOT_ONE = "expected a picture of a line grid, coloured columns and rows of one width, evenly spaced, on black"


def read_line_picture(picture: Image) -> LineGrid:
    """The line grid that `picture` (h, w, 3), uint8, shows: the very pixels to project, no photograph.

    The pixel row with the least light lies in a gap of the rows and shows the columns alone; so does the pixel column
    with the least light for the rows.

    Raises
    ------
    InputError
        where that is no line grid: lines of different widths or distances, or other things between them.

    >>> from retrue.patterns.line_grid import make_line_grid
    >>> grid = make_line_grid((800, 600))
    >>> read = read_line_picture(grid.render())
    >>> read.columns.middles()[:3].tolist(), read.rows.pitch, bool((read.render() == grid.render()).all())
    ([9.0, 21.0, 33.0], 9.0, True)
    """
    if picture.dtype != np.uint8 or picture.ndim != 3:
        raise InputError(f"{NOT_ONE}, in eight bits a channel")
    lit: BoolArray = picture.max(axis=-1) > DARK
    height, width = lit.shape
    columns = _family(picture[int(lit.sum(axis=1).argmin())], "columns")
    rows = _family(picture[:, int(lit.sum(axis=0).argmin())], "rows")
    if columns is None and rows is None:
        raise InputError(f"{NOT_ONE}, found no lines")
    grid = LineGrid((width, height), columns, rows)
    shown = grid.render()
    beside = np.ones((height, width), dtype=bool)
    if columns is not None and rows is not None:  # at a crossing either line may be on top
        beside = ~((rows.coverage(height).sum(axis=0) > 0)[:, None] & (columns.coverage(width).sum(axis=0) > 0))
    if not (np.abs(shown.astype(np.int64) - picture)[beside] <= DARK).all():
        raise InputError(f"{NOT_ONE}, found more than that in it")
    return grid


def _span(values: IntArray) -> str:
    return f"{values[0]} to {values[-1]}" if len(values) > 1 else "".join(map(str, values))


def _family(profile: NDArray[np.uint8], name: str) -> Lines | None:
    """The lines that a row of pixels (N, 3) crosses; None where there are none."""
    lit = np.concatenate([[0], (profile.max(axis=-1) > DARK).astype(np.int64), [0]])
    first, end = np.flatnonzero(np.diff(lit) > 0), np.flatnonzero(np.diff(lit) < 0)
    if not len(first):
        return None
    widths, steps = np.unique(end - first), np.unique(np.diff(first))
    if not (len(first) >= FEWEST and len(widths) == 1 and len(steps) == 1 and widths[0] < steps[0]):
        raise InputError(f"{NOT_ONE}, found {name} of widths {_span(widths)} px every {_span(steps)} px")
    colors, sequence = np.unique(profile[(first + end) // 2], axis=0, return_inverse=True)
    return Lines(
        tuple((int(r), int(g), int(b)) for r, g, b in colors),
        tuple(sequence.ravel().tolist()),
        origin=float(first[0] + (widths[0] - 1) / 2),
        pitch=float(steps[0]),
        width=float(widths[0]),
    )
