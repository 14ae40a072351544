"""Find the board in a picture, to a fraction of a pixel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from retrue.calibration.board import Board
from retrue.errors import DegenerateError, InputError
from retrue.geometry.arrays import FloatArray, Image
from retrue.geometry.homography import apply_homography, fit_homography
from retrue.shown import ShortRepr, Shown, counted
from retrue.values import ByValue

LARGE_PICTURE = 1000  # pixels: a board in it is also found in half of them
SMALLEST_PART = 12  # corners of a chessboard that is only partly seen: fewer are as likely clutter


def opencv() -> Any:
    """Loaded when the first picture is looked at; its stubs leave out half of what is used here."""
    import cv2

    return cv2


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BoardCorners(ByValue, ShortRepr):
    """Corners of one picture.

    Attributes
    ----------
    board_xy : (N, 2) where they lie on the board, in its unit. Of a chessboard in part, up to a whole number of
        squares: the pose of the board takes that up.
    pixels : (N, 2) where they lie in the picture.
    complete : whether the whole board was found.
    """

    board_xy: FloatArray
    pixels: FloatArray
    complete: bool

    def _shown(self) -> Shown:
        return (
            f"{counted(len(self.pixels), 'corner')}, {'the whole board' if self.complete else 'a part of the board'}",
            {},
        )


class BoardNotFound(InputError):
    """A picture without the board; says why where that can be told."""


def find_board(image: Image, board: Board) -> BoardCorners:
    """The board's corners in `image` (grey or RGB, 8 or 16 bit). Raises `BoardNotFound`."""
    grey = _grey(image)
    found = _FINDERS[board.kind](grey, board)
    if found is None:
        raise BoardNotFound(_why_not(grey, board))
    return found


def glimpse_board(image: Image, board: Board) -> BoardCorners | None:
    """The whole board, where it is seen easily: as quick as a live picture needs, and None at once where it is not."""
    grey = _grey(image)
    if board.kind != "chessboard":
        return _FINDERS[board.kind](grey, board)
    step = -(-max(grey.shape) // LARGE_PICTURE)
    cv2 = opencv()
    small = grey if step == 1 else cv2.resize(grey, None, fx=1 / step, fy=1 / step, interpolation=cv2.INTER_AREA)
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
    found, corners = cv2.findChessboardCorners(small, (board.columns, board.rows), flags=flags)
    if not found:
        return None
    return BoardCorners(board.points, _refined(grey, (_pixels(corners) + 0.5) * step - 0.5), True)


def _find_chessboard(grey: Image, board: Board) -> BoardCorners | None:
    size = (board.columns, board.rows)
    if (pixels := _whole_grid(grey, size)) is not None:
        return BoardCorners(board.points, _refined(grey, pixels), True)
    seen = _visible_grid(grey)
    if seen is None or len(seen[0]) < SMALLEST_PART or not _fits(seen[1], size):
        return None
    pixels, (columns, rows) = seen
    part = Board(board.kind, columns, rows, board.spacing, board.unit)
    pixels = _refined(grey, pixels)
    return BoardCorners(part.points, pixels, False) if _is_flat(part.points, pixels) else None


def _whole_grid(grey: Image, size: tuple[int, int]) -> FloatArray | None:
    """The corners of the whole chessboard, to a pixel or so; of a large picture, in half its size if that will do."""
    cv2 = opencv()
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
    if max(grey.shape) >= LARGE_PICTURE:
        half = cv2.resize(grey, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        found, corners = cv2.findChessboardCorners(half, size, flags=flags)
        if found:
            return 2 * _pixels(corners) + 0.5
    found, corners = cv2.findChessboardCorners(grey, size, flags=flags)
    if not found:
        found, corners = cv2.findChessboardCornersSB(grey, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    return _pixels(corners) if found else None


def _find_charuco(grey: Image, board: Board) -> BoardCorners | None:
    from retrue.calibration.charuco import charuco_corners

    found = charuco_corners(grey, board)
    if found is None:
        return None
    rows, pixels = found
    return BoardCorners(board.points[rows], pixels, len(rows) == len(board.points))


def _find_circles(grey: Image, board: Board) -> BoardCorners | None:
    cv2 = opencv()
    symmetric = board.kind == "circles"
    grid = cv2.CALIB_CB_SYMMETRIC_GRID if symmetric else cv2.CALIB_CB_ASYMMETRIC_GRID
    for flags in (grid, grid | cv2.CALIB_CB_CLUSTERING):
        found, centres = cv2.findCirclesGrid(grey, (board.columns, board.rows), flags=flags)
        if found:
            return BoardCorners(board.points, _pixels(centres), True)
    return None


_FINDERS: dict[str, Callable[[Image, Board], BoardCorners | None]] = {
    "chessboard": _find_chessboard,
    "charuco": _find_charuco,
    "circles": _find_circles,
    "asymmetric-circles": _find_circles,
}


def _refined(grey: Image, pixels: FloatArray) -> FloatArray:
    """Saddle points to sub-pixel, in a window that stays within the squares around each corner."""
    cv2 = opencv()
    apart = np.linalg.norm(pixels[:, None] - pixels[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    half = int(np.clip(0.35 * apart.min(), 2, 11))
    corners = pixels.astype(np.float32).reshape(-1, 1, 2)
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)
    return _pixels(cv2.cornerSubPix(grey, corners, (half, half), (-1, -1), criteria))


def _visible_grid(grey: Image) -> tuple[FloatArray, tuple[int, int]] | None:
    """Whatever chessboard grid is visible: its corners, columns and rows."""
    cv2 = opencv()
    flags = cv2.CALIB_CB_LARGER | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE
    found, corners, kinds = cv2.findChessboardCornersSBWithMeta(grey, (3, 3), flags)
    if not found:
        return None
    rows, columns = np.asarray(kinds).shape[:2]
    return _pixels(corners), (columns, rows)


def _fits(grid: tuple[int, int], size: tuple[int, int]) -> bool:
    """Whether the grid, as it lies or turned by a quarter, is no larger than that."""
    return min(grid) <= min(size) and max(grid) <= max(size)


def _is_flat(board_xy: FloatArray, pixels: FloatArray) -> bool:
    """Whether a homography explains the corners: clutter that looks like a chessboard does not."""
    try:
        homography = fit_homography(board_xy, pixels, source_sigma=0.0)
    except DegenerateError:
        return False
    mapped = apply_homography(homography, board_xy)
    step = np.linalg.norm(np.diff(pixels, axis=0), axis=1).min()
    return bool(np.abs(mapped - pixels).max() < 0.1 * step)


def _why_not(grey: Image, board: Board) -> str:
    size = f"{board.columns}x{board.rows}"
    low, high = np.percentile(grey, [2, 99])
    if high < 40:
        return f"board not found: the picture is too dark (brightest {high:.0f} of 255); expose longer"
    if low > 230:
        return "board not found: the picture is overexposed; expose shorter"
    from retrue.calibration.charuco import markers_seen

    seen = markers_seen(grey, board)
    expected = f"{board.kind}:{size}"
    if seen and board.kind == "charuco":
        return f"board not found: expected {expected}, {seen}; is all of it as --board says?"
    if seen:
        return (
            f"board not found: expected {expected}, but {seen}: a ChArUco board? "
            "Say charuco:COLUMNSxROWS:SQUARE:MARKER:DICTIONARY"
        )
    if board.kind in ("chessboard", "charuco") and (grid := _visible_grid(grey)) and len(grid[0]) >= SMALLEST_PART:
        columns, rows = grid[1]
        if board.kind == "charuco":
            return (
                f"board not found: no marker of {expected} is seen, but {columns}x{rows} inner corners; check --board"
            )
        return f"board not found: expected {size} inner corners, a grid of {columns}x{rows} is visible; check --board"
    return f"board not found: expected {expected}; is it whole, sharp, evenly lit, with a white margin?"


def _grey(image: Image) -> Image:
    cv2 = opencv()
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    return grey if grey.dtype == np.uint8 else (grey // 257).astype(np.uint8)


def _pixels(corners: Any) -> FloatArray:
    return np.asarray(corners, dtype=np.float64).reshape(-1, 2)
