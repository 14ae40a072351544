"""A capture of the calibration board from disk."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from retrue.calibration.board import Board
from retrue.calibration.detection import BoardCorners, BoardNotFound, find_board
from retrue.calibration.views import BoardCapture, Progress
from retrue.correspondences import Correspondences
from retrue.errors import CaptureError, require_kind, require_kinds, require_path
from retrue.files.image_header import read_image_header
from retrue.files.images import picture_paths, read_folder
from retrue.geometry.arrays import Image
from retrue.patterns.color_grid import ColorGrid
from retrue.patterns.gray_code import GrayCode
from retrue.patterns.pattern import Pattern

MARGIN = 3.0
"""Squares around the board that are decoded with it: its own edge, and some of the scene."""
NO_POINTS = Correspondences(np.empty((0, 2)), np.empty((0, 2)))


def read_board_captures(
    paths: Sequence[str | Path], pattern: Pattern, board: Board, progress: Progress = lambda message: None
) -> list[BoardCapture]:
    """Several poses, two at a time; raises as `read_board_capture` does. `progress` is told from any thread."""
    require_kinds(paths, (str, Path), "paths")

    def read(path: str | Path) -> BoardCapture:
        progress(f"reading {Path(path).name}")
        return read_board_capture(path, pattern, board)

    with ThreadPoolExecutor(2) as threads:
        return list(threads.map(read, paths))


def read_board_capture(path: str | Path, pattern: Pattern, board: Board) -> BoardCapture:
    """One pose of the board: a folder of a Gray code, or of two pictures, lit white and by the colour grid.

    Of a Gray code only the part around the board is decoded; where there is no board, nothing is.
    Raises `CaptureError` for pictures that do not belong together or do not decode, `FileError` for files that
    cannot be read.
    """
    path = require_path(path, "read_board_capture(path, pattern, board)")
    require_kind(pattern, (ColorGrid, GrayCode), "pattern", "retrue.read_pattern reads one")
    require_kind(board, Board, "board", "retrue.parse_board makes one of such a text")
    if not path.is_dir():
        raise CaptureError(path, "expected a folder with the pictures of one pose of the board")
    try:
        if isinstance(pattern, GrayCode):
            return _read_gray_code(path, pattern, board)
        return _read_color_grid(path, pattern, board)
    except CaptureError as error:
        raise CaptureError(path, error.problem) from error


def capture_size(path: str | Path) -> tuple[int, int]:
    """Width and height of a capture's pictures, from the header of the first. Raises as `read_board_capture` does."""
    return read_image_header(picture_paths(Path(path))[0]).size


def _read_gray_code(path: Path, pattern: GrayCode, board: Board) -> BoardCapture:
    from retrue.decoding.decode import decode
    from retrue.decoding.gray.sequence import arrange

    images, paths = read_folder(path)
    names = [entry.name for entry in paths]
    white = arrange(pattern, images, names).white
    corners = _corners(white, board)
    if corners is None:
        return BoardCapture(str(path), white, NO_POINTS)
    rows, columns = _around(corners, board, white)
    points = decode(pattern, [image[rows, columns] for image in images], names=names)
    camera_px = points.camera_px + np.array([columns.start, rows.start])
    return BoardCapture(str(path), white, Correspondences(camera_px, points.projector_px), corners)


def _read_color_grid(path: Path, pattern: ColorGrid, board: Board) -> BoardCapture:
    from retrue.decoding.blocks.decode_color_grid import decode_color_grid

    images, _ = read_folder(path, color=(0, 1))
    if len(images) != 2:
        raise CaptureError(path, f"expected two pictures, lit white and by the colour grid, found {len(images)}")
    white, grid = sorted(images, key=lambda image: -float(image.mean()))  # the grid is mostly black
    points = decode_color_grid(pattern, grid, white=white)  # which takes the print out, as far as it reflects at all
    return BoardCapture(str(path), white, points, _corners(white, board))


def _corners(white: Image, board: Board) -> BoardCorners | None:
    try:
        return find_board(white, board)
    except BoardNotFound:
        return None


def _around(corners: BoardCorners, board: Board, white: Image) -> tuple[slice, slice]:
    """Rows and columns of the picture around the board."""
    squares = np.ptp(corners.board_xy, axis=0).max() / board.spacing
    low, high = corners.pixels.min(axis=0), corners.pixels.max(axis=0)
    margin = MARGIN * float((high - low).max()) / squares
    first = np.maximum(low - margin, 0).astype(int).tolist()
    last = np.minimum(high + margin + 1, white.shape[1::-1]).astype(int).tolist()
    return slice(first[1], last[1]), slice(first[0], last[0])
