"""Pictures of the board by two cameras, from disk."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from retrue.calibration.board import Board
from retrue.calibration.views import Progress, StereoCapture
from retrue.errors import require_kind, require_kinds
from retrue.files.board_captures import read_board_capture
from retrue.files.images import read_image
from retrue.files.pairs import Pair, stereo_pairs
from retrue.patterns.pattern import PATTERNS, Pattern
from retrue.through_code import match_through_code


def read_stereo_captures(
    paths: Sequence[str | Path],
    board: Board,
    pattern: Pattern | None = None,
    progress: Progress = lambda message: None,
) -> list[StereoCapture]:
    """Poses of the board by two cameras, the first one's picture and the second one's.

    Parameters
    ----------
    paths : two folders, of the first camera's pictures and of the second one's; one folder that holds both; or pairs.
        Pictures of one number belong together. With a pattern each of them is a folder, as `read_board_capture` takes.
    pattern : what a projector showed in every pose, where both cameras saw it: they are matched through it.

    Raises
    ------
    CaptureError, FileError : of pictures that are missing, unreadable, or do not decode; names them.
    InputError : paths that make no pairs.
    """
    require_kinds(paths, (str, Path), "paths")
    require_kind(board, Board, "board", "retrue.parse_board makes one of such a text")
    if pattern is not None:
        require_kind(pattern, PATTERNS, "pattern", "retrue.read_pattern reads one")

    def read(pair: Pair) -> StereoCapture:
        left, right = pair
        progress(f"reading {left.name} and {right.name}")
        name = f"{left.name}, {right.name}"
        if pattern is None:
            return StereoCapture(name, read_image(left, grey=True), read_image(right, grey=True))
        first, second = (read_board_capture(side, pattern, board) for side in pair)
        return StereoCapture(name, first.white, second.white, match_through_code(first.points, second.points))

    with ThreadPoolExecutor(2) as threads:
        return list(threads.map(read, stereo_pairs([Path(path) for path in paths], coded=pattern is not None)))
