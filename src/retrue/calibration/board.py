"""The printed board, as a spec."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal, cast, get_args

import numpy as np

from retrue.errors import InputError, require_choice, require_kind
from retrue.geometry.arrays import FloatArray
from retrue.ranges import require_number
from retrue.units import UNITS

BoardKind = Literal["chessboard", "charuco", "circles", "asymmetric-circles"]

HOW = (
    "chessboard:COLUMNSxROWS:SQUARE (inner corners), circles:..., asymmetric-circles:..., "
    "or charuco:COLUMNSxROWS:SQUARE:MARKER:DICTIONARY (squares), such as chessboard:7x9:75mm"
)


@dataclass(frozen=True, slots=True)
class Board:
    """A flat board; its frame has z = 0, x along a row, y along a column, (0, 0) at its first corner.

    Attributes
    ----------
    kind : what is printed on it.
    columns, rows : inner corners of a chessboard, circles of a grid, squares of a ChArUco board.
    spacing : side of a square, or distance of two rows of circles, in `unit`.
    unit : the rig's unit of length will be this one.
    marker : side of a ChArUco marker, in `unit`.
    dictionary : of a ChArUco board, as OpenCV names it: "DICT_4X4_50".

    >>> board = parse_board("chessboard:7x9:75mm")
    >>> board.points.shape, board.points[-1].tolist(), board.unit
    ((63, 2), [450.0, 600.0], 'mm')
    """

    kind: BoardKind
    columns: int
    rows: int
    spacing: float
    unit: str
    marker: float = 0.0
    dictionary: str = ""

    def __post_init__(self) -> None:
        require_choice(self.kind, get_args(BoardKind), "board: kind")
        for count, name in ((self.columns, "columns"), (self.rows, "rows")):
            require_number(count, f"board: {name}", 3, 500, whole=True)
        require_number(self.spacing, "board: spacing", 0, above=True)
        require_number(self.marker, "board: marker", 0)
        require_choice(self.unit, UNITS, "board: unit")
        if self.kind == "charuco" and not 0 < self.marker < self.spacing:
            raise InputError(f"board: expected a marker smaller than its square, found {self.marker:g}")

    @property
    def grid(self) -> tuple[int, int]:
        """Columns and rows of measured points."""
        inner = self.kind == "charuco"
        return self.columns - inner, self.rows - inner

    @property
    def points(self) -> FloatArray:
        """(columns * rows, 2) measured points in the board's frame, row by row, in the order of OpenCV's finders."""
        columns, rows = self.grid
        row, column = np.divmod(np.arange(columns * rows, dtype=np.float64), columns)
        if self.kind == "asymmetric-circles":
            return np.stack([2 * column + row % 2, row], axis=-1) * self.spacing
        origin = 1 if self.kind == "charuco" else 0  # OpenCV puts a ChArUco board's origin at its outer edge
        return np.stack([column + origin, row + origin], axis=-1) * self.spacing


def parse_board(spec: str) -> Board:
    """The board that `KIND:COLUMNSxROWS:LENGTHunit[:MARKERunit:DICTIONARY]` describes.

    Raises `InputError`, which says how a spec is written.

    >>> parse_board("charuco:12x9:2cm:1.5cm:DICT_5X5_100").grid
    (11, 8)
    """
    require_kind(spec, str, "board")
    kind, *parts = spec.strip().split(":")
    counts = re.fullmatch(r"(\d{1,4})x(\d{1,4})", parts[0] if parts else "")
    if kind not in ("chessboard", "charuco", "circles", "asymmetric-circles") or counts is None:
        raise InputError(f"board: expected {HOW}; found {spec!r}")
    if len(parts) != (4 if kind == "charuco" else 2):
        raise InputError(f"board: expected {HOW}; found {spec!r}")
    spacing, unit = _length(parts[1], spec)
    columns, rows = int(counts[1]), int(counts[2])
    if kind != "charuco":
        return Board(cast(BoardKind, kind), columns, rows, spacing, unit)
    marker, marker_unit = _length(parts[2], spec)
    if marker_unit != unit:
        raise InputError(f"board: expected square and marker in one unit, found {unit} and {marker_unit}")
    return Board("charuco", columns, rows, spacing, unit, marker, parts[3])


def _length(text: str, spec: str) -> tuple[float, str]:
    found = re.fullmatch(r"(\d+\.?\d*|\.\d+)\s*([a-z]+)", text)
    if found is None or found[2] not in UNITS:
        raise InputError(f"board: expected a length with its unit ({', '.join(UNITS)}), found {text!r} in {spec!r}")
    return float(found[1]), found[2]
