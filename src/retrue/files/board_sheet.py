"""A board to print, true to size: its squares, circles and markers on a sheet, with a ruler that checks the printer."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from retrue.calibration.board import Board
from retrue.errors import InputError, require_path
from retrue.files.atomic import replaced_file
from retrue.files.sheet import Circle, Rectangle, Shape, Sheet, Text, pdf, svg
from retrue.geometry.arrays import BoolArray
from retrue.units import millimetres_per

PAPERS = {"A4": (210.0, 297.0), "A3": (297.0, 420.0), "A2": (420.0, 594.0), "A1": (594.0, 841.0), "A0": (841.0, 1189.0)}
PAPERS |= {"Letter": (215.9, 279.4), "Legal": (215.9, 355.6), "Tabloid": (279.4, 431.8)}
"""(width, height) in mm, upright."""
MARGIN = 6.0  # mm that printers leave white
FOOT = 16.0  # mm below the board for the ruler and the name
RULER = 100.0  # mm
RADIUS = {"circles": 0.3, "asymmetric-circles": 0.4}  # of the spacing


@dataclass(frozen=True, slots=True)
class BoardSheet:
    """The sheet, (width, height) of the board on it in mm, and whether the paper lies on its side."""

    sheet: Sheet
    size_mm: tuple[float, float]
    landscape: bool


def parse_paper(paper: str) -> tuple[float, float]:
    """(width, height) in mm of "A4", or of "300x200mm".

    >>> parse_paper("a3"), parse_paper("300x200mm")
    ((297.0, 420.0), (300.0, 200.0))
    """
    for name, size in PAPERS.items():
        if paper.lower() == name.lower():
            return size
    found = re.fullmatch(r"(\d{1,5}(?:\.\d+)?)x(\d{1,5}(?:\.\d+)?)\s*mm", paper)
    if found is None or not (float(found[1]) > 0 and float(found[2]) > 0):
        raise InputError(f"paper: expected {', '.join(PAPERS)}, or a size such as 300x200mm; found {paper!r}")
    return float(found[1]), float(found[2])


def lay_out_board(board: Board, name: str, paper: str) -> BoardSheet:
    """The board in the middle of that paper, upright or on its side, its name and a ruler of 100 mm below it.

    Raises
    ------
    InputError
        the board does not fit; says how large it is.

    >>> from retrue.calibration.board import parse_board
    >>> laid = lay_out_board(parse_board("chessboard:9x6:20mm"), "chessboard:9x6:20mm", "A4")
    >>> laid.size_mm, laid.landscape
    ((200.0, 140.0), True)
    """
    shapes, (width, height) = _shapes(board)
    upright = parse_paper(paper)
    for landscape in (False, True):
        paper_width, paper_height = upright[::-1] if landscape else upright
        if width + 2 * MARGIN <= paper_width and height + 2 * MARGIN + FOOT <= paper_height:
            left, top = (paper_width - width) / 2, (paper_height - FOOT - height) / 2
            foot = _foot(name, (paper_width, paper_height))
            moved = [shape.moved(left, top) for shape in shapes]
            return BoardSheet(Sheet((paper_width, paper_height), (*moved, *foot), name), (width, height), landscape)
    raise InputError(
        f"board: {name} is {width:g} x {height:g} mm and does not fit {paper}, which is {upright[0]:g} x "
        f"{upright[1]:g} mm with {MARGIN:g} mm of margin and {FOOT:g} mm for the ruler: "
        "take larger paper, or smaller squares"
    )


def write_board(path: str | Path, sheet: Sheet) -> None:
    """Write it as PDF or SVG, as the file's ending says; whole or not at all."""
    path = require_path(path, "write_board(path, sheet)")
    writers = {".pdf": pdf, ".svg": svg}
    if path.suffix.lower() not in writers:
        raise InputError(f"{path}: expected a name that ends in .pdf or .svg")
    content = writers[path.suffix.lower()](sheet)
    with replaced_file(path) as stream:
        stream.write(content)


def _shapes(board: Board) -> tuple[list[Shape], tuple[float, float]]:
    """All that is black, from the board's corner on, and its (width, height), in mm."""
    unit = millimetres_per(board.unit)
    side = board.spacing * unit
    if board.kind in RADIUS:
        radius = RADIUS[board.kind] * side
        centres = board.points * unit
        reach = centres.max(axis=0) + 2 * side
        circles: list[Shape] = [Circle(float(x) + side, float(y) + side, radius) for x, y in centres]
        return circles, (float(reach[0]), float(reach[1]))
    columns, rows = (board.columns, board.rows) if board.kind == "charuco" else (board.columns + 1, board.rows + 1)
    black = np.add.outer(np.arange(rows), np.arange(columns)) % 2 == 0
    shapes: list[Shape] = []
    if board.kind == "charuco":
        black = np.ones((rows, columns), np.bool_)
        for column, row, bits in _markers(board):
            black[row, column] = False
            shapes += _marker(column * side, row * side, side, board.marker * unit, bits)
    squares = [Rectangle(c * side, r * side, side, side) for r, c in zip(*np.nonzero(black), strict=True)]
    return [*(shape for shape in squares), *shapes], (columns * side, rows * side)


def _markers(board: Board) -> list[tuple[int, int, BoolArray]]:
    """Column and row of the square of each marker, and its bits, black border included, as OpenCV lays them out."""
    aruco: Any = cv2.aruco
    if not (board.dictionary.startswith("DICT_") and hasattr(aruco, board.dictionary)):
        raise InputError(f"board: expected a dictionary of OpenCV such as DICT_5X5_100, found {board.dictionary!r}")
    dictionary = aruco.getPredefinedDictionary(getattr(aruco, board.dictionary))
    if not len(dictionary.bytesList) >= (board.columns * board.rows) // 2:
        needed, found = (board.columns * board.rows) // 2, len(dictionary.bytesList)
        raise InputError(f"board: {board.dictionary} has {found} markers, this board needs {needed}: take a larger one")
    layout = aruco.CharucoBoard((board.columns, board.rows), board.spacing, board.marker, dictionary)
    cells = dictionary.markerSize + 2
    markers: list[tuple[int, int, BoolArray]] = []
    for number, corners in zip(layout.getIds().ravel().tolist(), layout.getObjPoints(), strict=True):
        column, row = (int(side) for side in np.mean(corners, axis=0)[:2] / board.spacing)
        picture = aruco.generateImageMarker(dictionary, number, cells)
        markers.append((column, row, np.asarray(picture) < 128))
    return markers


def _marker(x: float, y: float, side: float, marker: float, bits: BoolArray) -> list[Shape]:
    """One rectangle for each run of black bits in a row."""
    cell, gap = marker / len(bits), (side - marker) / 2
    shapes: list[Shape] = []
    for row, line in enumerate(bits):
        steps = np.flatnonzero(np.diff(np.concatenate([[0], line.astype(np.int8), [0]])))
        for start, end in zip(steps[::2], steps[1::2], strict=True):
            shapes.append(Rectangle(x + gap + start * cell, y + gap + row * cell, float(end - start) * cell, cell))
    return shapes


def _foot(name: str, paper: tuple[float, float]) -> Sequence[Shape]:
    """A ruler with a mark every 10 mm, what it is for, and the board's name, which is what `--board` takes."""
    left, base = (paper[0] - RULER) / 2, paper[1] - MARGIN - 3
    thin = 0.2
    shapes: list[Shape] = [Rectangle(left, base - 4, RULER, thin)]
    for mark in range(0, int(RULER) + 1, 10):
        length = 4.0 if mark % 50 == 0 else 2.5
        shapes.append(Rectangle(left + mark - thin / 2, base - 4 - length, thin, length))
    shapes.append(Text(left, base, 3.0, "print at 100 %: this ruler is 100 mm long"))
    shapes.append(Text(left, base - 10, 3.5, f"--board {name}"))
    return shapes
