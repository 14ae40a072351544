"""From captures to views: the board found, and what of it is known in both devices."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from retrue.calibration.board import Board
from retrue.calibration.detection import BoardCorners, find_board
from retrue.calibration.observations import View
from retrue.calibration.projector_corners import fit_projector_corners
from retrue.correspondences import Correspondences, repeated_in, same_points
from retrue.errors import InputError
from retrue.geometry.arrays import FloatArray, Image, IntArray
from retrue.rasters import check_alike
from retrue.shown import ShortRepr, Shown, counted
from retrue.values import ByValue

FEWEST_CORNERS = 8
Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BoardCapture(ByValue, ShortRepr):
    """One pose of the board, lit white, and the dense code of the same moment; `corners` where found already."""

    name: str
    white: Image
    points: Correspondences
    corners: BoardCorners | None = None

    def _shown(self) -> Shown:
        width, height = picture_size(self.white)
        board = "" if self.corners is None else f", {counted(len(self.corners.pixels), 'corner')} of the board"
        return f"{self.name}, {width} x {height} px, {counted(len(self.points), 'point')}{board}", {}


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class StereoCapture(ByValue, ShortRepr):
    """One pose of the board, seen by two cameras; `points` where both saw a projected code (`match_through_code`)."""

    name: str
    left: Image
    right: Image
    points: Correspondences | None = None

    def _shown(self) -> Shown:
        sizes = (f"{width} x {height} px" for width, height in map(picture_size, (self.left, self.right)))
        return f"{self.name}, {' and '.join(sizes)}", {}


Capture = BoardCapture | StereoCapture


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A capture that was not used, and why."""

    name: str
    reason: str


def picture_size(image: Image) -> tuple[int, int]:
    """(width, height)."""
    return image.shape[1], image.shape[0]


def see_views(captures: Sequence[Capture], board: Board, progress: Progress) -> tuple[list[View], list[LeftOut]]:
    """A view of every capture that shows the board, and the captures that do not, or repeat another.

    Raises `InputError`.
    """
    _require_one_size(captures)
    repeated = {again: captures[first].name for first, again in repeated_in(captures, _same)}

    def see(index: int) -> View | LeftOut:
        capture = captures[index]
        if index in repeated:
            return LeftOut(capture.name, f"the same capture as {repeated[index]}, which counts once")
        progress(f"{capture.name}: looking for the board")
        try:
            if isinstance(capture, StereoCapture):
                return _see_stereo(capture, board)
            corners = capture.corners or find_board(capture.white, board)
            return projected_view(capture.name, corners, capture.points, board)
        except InputError as error:
            return LeftOut(capture.name, str(error))

    with ThreadPoolExecutor(2) as threads:
        seen = list(threads.map(see, range(len(captures))))
    return [view for view in seen if isinstance(view, View)], [view for view in seen if isinstance(view, LeftOut)]


def _same(one: Capture, other: Capture) -> bool:
    """Whether two poses of the board are one: its pictures repeat to the last bit, and so do its points."""
    if isinstance(one, StereoCapture) and isinstance(other, StereoCapture):
        return np.array_equal(one.left, other.left) and np.array_equal(one.right, other.right)
    if isinstance(one, BoardCapture) and isinstance(other, BoardCapture):
        return np.array_equal(one.white, other.white) and same_points(one.points, other.points)
    return False


def projected_view(name: str, corners: BoardCorners, points: Correspondences, board: Board) -> View:
    """The view of a board whose corners the camera sees, and which the projector lights. Raises `InputError`."""
    fit = fit_projector_corners(corners, points, board)
    known = int(np.isfinite(fit.corner_sigma).sum())
    if known < FEWEST_CORNERS:
        raise InputError(f"expected projector codes around {FEWEST_CORNERS} corners, found {known}; light the board")
    return View(
        name,
        corners.board_xy,
        (corners.pixels, fit.corner_px),
        (np.ones(len(corners.pixels)), fit.corner_sigma),
        fit.patch_camera_px,
        fit.patch_projector_px,
        fit.patch_sigma,
        fit.scene_camera_px,
        fit.scene_projector_px,
        fit.dense_camera_px,
        fit.dense_projector_px,
        corners.complete,
    )


def _see_stereo(capture: StereoCapture, board: Board) -> View:
    seen: list[BoardCorners] = []
    for side, image in (("left", capture.left), ("right", capture.right)):
        try:
            seen.append(find_board(image, board))
        except InputError as error:
            raise InputError(f"{side}: {error}") from error
    left, right = seen
    if not (left.complete and right.complete) and board.kind != "charuco":
        raise InputError("expected the whole board in both pictures: of a part, it is not known which")
    right_px = np.full((len(board.points), 2), np.nan)
    left_px = right_px.copy()
    for corners, pixels in ((left, left_px), (right, right_px)):
        pixels[_rows(board, corners)] = corners.pixels
    if board.kind != "charuco" and _turned_round(left_px, right_px):
        right_px = right_px[::-1]
    ones = np.ones(len(board.points))
    view = View(capture.name, board.points, (left_px, right_px), (ones, ones))
    if capture.points is None or not len(capture.points):
        return view
    fit = fit_projector_corners(left, capture.points, board)
    return replace(
        view,
        patch_camera_px=fit.patch_camera_px,
        patch_projector_px=fit.patch_projector_px,
        patch_sigma=fit.patch_sigma,
        scene_camera_px=fit.scene_camera_px,
        scene_projector_px=fit.scene_projector_px,
        dense_camera_px=fit.dense_camera_px,
        dense_projector_px=fit.dense_projector_px,
        two_pictures=True,
    )


def _rows(board: Board, corners: BoardCorners) -> IntArray:
    """Which of the board's points these corners are."""
    distance = np.linalg.norm(board.points[None] - corners.board_xy[:, None], axis=2)
    return np.argmin(distance, axis=1)


def _turned_round(left_px: FloatArray, right_px: FloatArray) -> bool:
    """Whether one finder started at the opposite corner: a chessboard looks the same upside down."""
    return float((left_px[-1] - left_px[0]) @ (right_px[-1] - right_px[0])) < 0


def _require_one_size(captures: Sequence[Capture]) -> None:
    stereo = [capture for capture in captures if isinstance(capture, StereoCapture)]
    check_alike([(capture.name, picture_size(capture.left)) for capture in stereo])
    check_alike([(capture.name, picture_size(capture.right)) for capture in stereo])
    single = [capture for capture in captures if isinstance(capture, BoardCapture)]
    check_alike([(capture.name, picture_size(capture.white)) for capture in single])
