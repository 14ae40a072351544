"""Captures of the calibration board from disk."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from retrue.calibration.board import Board
from retrue.calibration.board_capture import see_board
from retrue.calibration.views import BoardCapture, Progress
from retrue.errors import CaptureError, require_kind, require_kinds, require_path
from retrue.files.images import read_folder
from retrue.patterns.gray_code import GrayCode
from retrue.patterns.pattern import PATTERNS, Pattern


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
    """One pose of the board: a folder of a Gray code, or of two pictures, lit white and by the grid.

    Of a Gray code only the part around the board is decoded; where there is no board, nothing is.
    Raises `CaptureError` for pictures that do not belong together or do not decode, `FileError` for files that
    cannot be read.
    """
    path = require_path(path, "read_board_capture(path, pattern, board)")
    require_kind(pattern, PATTERNS, "pattern", "retrue.read_pattern reads one")
    require_kind(board, Board, "board", "retrue.parse_board makes one of such a text")
    if not path.is_dir():
        raise CaptureError(path, "expected a folder with the pictures of one pose of the board")
    images, paths = read_folder(path, color=() if isinstance(pattern, GrayCode) else (0, 1))
    try:
        return see_board(str(path), pattern, images, [entry.name for entry in paths], board)
    except CaptureError as error:
        raise CaptureError(path, error.problem) from error
