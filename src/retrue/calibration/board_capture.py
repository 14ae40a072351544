"""From the pictures of one pose of the board to its corners and the code around them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from retrue.calibration.board import Board
from retrue.calibration.detection import BoardCorners, BoardNotFound, find_board
from retrue.calibration.views import BoardCapture, picture_size
from retrue.correspondences import Correspondences
from retrue.errors import CaptureError
from retrue.geometry.arrays import Image
from retrue.patterns.color_grid import ColorGrid
from retrue.patterns.line_grid import LineGrid
from retrue.patterns.pattern import Pattern

MARGIN = 3.0
"""Squares around the board that are decoded with it: its own edge, and some of the scene."""
NO_POINTS = Correspondences(np.empty((0, 2)), np.empty((0, 2)))


def see_board(name: str, pattern: Pattern, images: Sequence[Image], names: Sequence[str], board: Board) -> BoardCapture:
    """One pose of the board, from a Gray code, or from two pictures, lit white and by the grid.

    Of a Gray code only the part around the board is decoded; where there is no board, nothing is.

    Parameters
    ----------
    name : of the pose.
    names : of the pictures, for messages.

    Raises
    ------
    CaptureError
        the pictures do not belong together or do not decode.
    """
    if isinstance(pattern, ColorGrid | LineGrid):
        from retrue.decoding.decode import decode_picture

        if len(images) != 2:
            raise CaptureError(name, f"expected two pictures, lit white and by the grid, found {len(images)}")
        white, grid = sorted(images, key=lambda image: -float(image.mean()))  # the grid is mostly black
        points = decode_picture(pattern, grid, white=white)  # which takes the print out, if it reflects at all
        return BoardCapture(name, white, points, _corners(white, board))
    from retrue.decoding.sequence.arrange import arrange
    from retrue.decoding.sequence.decode_sequence import decode_arranged

    sequence = arrange(pattern, images, names)
    corners = _corners(sequence.white, board)
    if corners is None:
        return BoardCapture(name, sequence.white, NO_POINTS)
    rows, columns = _around(corners, board, sequence.white)
    points = decode_arranged(sequence.part(rows, columns))
    camera_px = points.camera_px + np.array([columns.start, rows.start])
    whole = Correspondences(
        camera_px, points.projector_px, camera_size=picture_size(sequence.white), projector_size=pattern.projector_size
    )
    return BoardCapture(name, sequence.white, whole, corners)


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
