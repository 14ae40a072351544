"""ChArUco boards: both layouts tried, corners refined where no marker reaches, and what was seen where none is found.

OpenCV 4.6 turned the layout of boards with an even number of rows: their first square was white, and is black now.
Which of the two was printed, the markers tell: a wrong layout puts them where no homography does.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from retrue.calibration.board import Board
from retrue.errors import DegenerateError, InputError
from retrue.geometry.arrays import FloatArray, Image, IntArray
from retrue.geometry.homography import apply_homography, fit_homography

aruco: Any = cv2.aruco
FEWEST_CORNERS = 6
FAR_PX = 3.0
"""How far markers may lie from a flat board: a wrong layout moves them by whole squares, a lens by less."""
FEWEST_SEEN = 4
"""Markers that clutter is not: a large dictionary finds one or two anywhere."""
MANY_SEEN = 8
"""Markers in line among the first 50 that clutter never is."""
FARTHEST_ID = 8
"""From a marker of a board to the next that is seen: those of a row may be hidden."""
WIDEST = 11
NARROWEST = 2
"""Half a window's side, pixels."""
CLEAR_PX = 1.5
"""Between a window and a marker: blur, and the window's own interpolation."""
DICTIONARIES = ("4X4_1000", "5X5_1000", "6X6_1000", "7X7_1000", "ARUCO_ORIGINAL", "APRILTAG_36h11", "ARUCO_MIP_36h12")
"""Where markers are looked for of which nobody told the dictionary: a family's smaller ones are its first markers."""
SIZES = (50, 100, 250)


@dataclass(frozen=True, slots=True, eq=False)
class Markers:
    """Markers of a picture: corners (N, 4, 2) in pixels, clockwise from their top left, and ids (N,)."""

    pixels: FloatArray
    ids: IntArray


def charuco_corners(grey: Image, board: Board) -> tuple[IntArray, FloatArray] | None:
    """Rows of `board.points` and their pixels; None where too few are seen."""
    markers = find_markers(grey, board.dictionary)
    if len(markers.ids) == 0:
        return None
    best: tuple[IntArray, FloatArray] | None = None
    for layout in _layouts(board):
        if not _fits(layout, markers):
            continue
        found = _interpolated(grey, layout, markers)
        if found is not None and (best is None or len(found[0]) > len(best[0])):
            best = found[0], _refined(grey, layout, markers, *found)
    return best if best is not None and len(best[0]) >= FEWEST_CORNERS else None


def find_markers(grey: Image, dictionary: str, first: int | None = None) -> Markers:
    """Of that dictionary, or its `first` markers; their corners as they are found, to a pixel or so."""
    known = _dictionary(dictionary)
    if first is not None:
        known = aruco.Dictionary(known.bytesList[:first], known.markerSize, known.maxCorrectionBits)
    corners, ids, _ = aruco.ArucoDetector(known).detectMarkers(grey)
    if ids is None or len(ids) == 0:
        return Markers(np.empty((0, 4, 2)), np.empty(0, dtype=np.int64))
    return Markers(np.array(corners, dtype=np.float64).reshape(-1, 4, 2), np.asarray(ids, dtype=np.int64).ravel())


def markers_seen(grey: Image, board: Board) -> str:
    """What markers are in the picture, in words; "" where there are none.

    Looked for in the board's own dictionary and in the common ones, in the picture and in its mirror image.
    """
    own = board.dictionary if board.kind == "charuco" else ""
    known = [f"DICT_{name}" for name in DICTIONARIES if isinstance(getattr(aruco, f"DICT_{name}", None), int)]
    names = [own, *known] if own else known
    pictures = {"": grey, "; the picture is mirrored": np.ascontiguousarray(grey[:, ::-1])}
    asked = [(name, way) for way in pictures for name in names]

    @cache
    def ids_of(name: str, way: str, first: int | None = None) -> list[int]:
        return _in_line(find_markers(pictures[way], name, first).ids)

    # A family's first 50 markers, which most boards have, tell it in a twentieth of the time that all 1000 take.
    likely = [(name, way) for name, way in asked if len(ids_of(name.replace("_1000", "_50"), way, 50)) >= MANY_SEEN]
    found = {key: ids_of(*key) for key in likely or asked}
    name, way = max(found, key=lambda key: (len(found[key]), key == (own, "")))  # the board's own where others tie
    ids = found[name, way]
    if len(ids) < FEWEST_SEEN:
        return ""
    name = name if name == own else _smallest(name, ids)
    seen = f"{len(ids)} markers of {name} are seen, ids {ids[0]} to {ids[-1]}{way}"
    if not own:
        return seen
    return seen + (f"; --board says {own}" if name != own else _of_board(ids, board))


def _in_line(ids: IntArray) -> list[int]:
    """The most that follow one another, as a board's do: what clutter is taken for lies anywhere in a dictionary."""
    own = np.unique(ids)
    return max((run.tolist() for run in np.split(own, np.flatnonzero(np.diff(own) > FARTHEST_ID) + 1)), key=len)


def _of_board(ids: list[int], board: Board) -> str:
    """What a board of that size has."""
    held = board.columns * board.rows // 2
    if ids[-1] >= held:
        return f"; a board of {board.columns}x{board.rows} squares has only 0 to {held - 1}: is it a larger one?"
    return f" of the board's 0 to {held - 1}"


def _smallest(name: str, ids: list[int]) -> str:
    """The smallest dictionary of the family that has those markers."""
    size = next((size for size in SIZES if ids[-1] < size), None)
    return name.replace("_1000", f"_{size}") if size is not None else name


def _dictionary(name: str) -> Any:
    identifier = getattr(aruco, name, None)
    if not name.startswith("DICT_") or not isinstance(identifier, int):
        raise InputError(f"board: expected a dictionary of OpenCV such as DICT_4X4_50, found {name!r}")
    return aruco.getPredefinedDictionary(identifier)


def _layouts(board: Board) -> Iterator[Any]:
    """The board as OpenCV makes it now, and as it did before 4.6, where that differs."""
    for old in (False, True) if board.rows % 2 == 0 else (False,):
        try:
            layout = aruco.CharucoBoard(
                (board.columns, board.rows), board.spacing, board.marker, _dictionary(board.dictionary)
            )
        except cv2.error as error:
            raise InputError(
                f"board: {board.columns}x{board.rows} squares need more markers than {board.dictionary} has"
            ) from error
        layout.setLegacyPattern(old)
        yield layout


def _fits(layout: Any, markers: Markers) -> bool:
    """Whether the markers lie where that layout has them."""
    on_board, pixels = _matched(layout, markers)
    if len(on_board) < 8:
        return len(on_board) >= 4
    try:
        homography = fit_homography(on_board, pixels, source_sigma=0.0)
    except DegenerateError:
        return False
    miss = np.linalg.norm(apply_homography(homography, on_board) - pixels, axis=1)
    side = np.linalg.norm(np.diff(pixels.reshape(-1, 4, 2), axis=1), axis=2).mean()
    return bool(np.median(miss) < max(FAR_PX, 0.2 * side))


def _matched(layout: Any, markers: Markers) -> tuple[FloatArray, FloatArray]:
    """Corners (4 N, 2) of markers that the board has, on it and in the picture."""
    places = dict(zip(np.asarray(layout.getIds()).ravel().tolist(), layout.getObjPoints(), strict=True))
    known = [index for index, name in enumerate(markers.ids.tolist()) if name in places]
    if not known:
        return np.empty((0, 2)), np.empty((0, 2))
    on_board = np.concatenate([np.asarray(places[int(markers.ids[index])], dtype=np.float64)[:, :2] for index in known])
    return on_board, markers.pixels[known].reshape(-1, 2)


def _interpolated(grey: Image, layout: Any, markers: Markers) -> tuple[IntArray, FloatArray] | None:
    """The corners between markers, as OpenCV finds them."""
    corners = [quad.astype(np.float32).reshape(1, 4, 2) for quad in markers.pixels]
    detector = aruco.CharucoDetector(layout)
    found, ids, _, _ = detector.detectBoard(grey, None, None, corners, markers.ids.astype(np.int32).reshape(-1, 1))
    if found is None or ids is None or len(ids) < 4:
        return None
    return np.asarray(ids, dtype=np.int64).ravel(), np.asarray(found, dtype=np.float64).reshape(-1, 2)


def _refined(grey: Image, layout: Any, markers: Markers, rows: IntArray, pixels: FloatArray) -> FloatArray:
    """Saddle points to sub-pixel, each in the largest window that no marker reaches into."""
    half = _windows(layout, markers, rows, pixels)
    refined = pixels.copy()
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)
    for size in np.unique(half).tolist():
        own = half == size
        corners = pixels[own].astype(np.float32).reshape(-1, 1, 2)
        refined[own] = cv2.cornerSubPix(grey, corners, (size, size), (-1, -1), criteria).reshape(-1, 2)
    return refined


def _windows(layout: Any, markers: Markers, rows: IntArray, pixels: FloatArray) -> NDArray[np.intp]:
    """Half a side (N,) of the window around each corner: short of its nearest marker, along x or y."""
    on_board, there = _matched(layout, markers)
    homography = fit_homography(on_board, there, source_sigma=0.0)
    corners = np.asarray(layout.getChessboardCorners(), dtype=np.float64)[rows, :2]
    every = np.concatenate([np.asarray(quad, dtype=np.float64)[:, :2] for quad in layout.getObjPoints()])
    gap = 0.5 * (float(layout.getSquareLength()) - float(layout.getMarkerLength()))
    half = np.empty(len(rows), dtype=np.intp)
    for index, corner in enumerate(corners):
        near = every[np.abs(every - corner).max(axis=1) < 1.5 * gap + 1e-9]
        away = apply_homography(homography, np.vstack([corner, near]))
        reach = np.abs(away[1:] - away[0]).max(axis=1).min(initial=WIDEST + CLEAR_PX)
        half[index] = int(np.clip(reach - CLEAR_PX, NARROWEST, WIDEST))
    return half
