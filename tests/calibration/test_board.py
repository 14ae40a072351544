"""Board specs, and boards found in drawn pictures."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from retrue.calibration.board import Board, parse_board
from retrue.calibration.detection import BoardNotFound, find_board
from retrue.errors import InputError
from retrue.geometry.arrays import FloatArray, Image

PIXELS_PER_UNIT = 1.5
TILT = np.array([[1.0, 0.15, 120.3], [-0.1, 0.95, 150.7], [1e-4, 2e-4, 1.0]])


@pytest.mark.parametrize(
    ("spec", "kind", "grid", "spacing", "unit"),
    [
        ("chessboard:7x9:75mm", "chessboard", (7, 9), 75.0, "mm"),
        ("circles:4x11:.5in", "circles", (4, 11), 0.5, "in"),
        ("asymmetric-circles:4x11:2cm", "asymmetric-circles", (4, 11), 2.0, "cm"),
        ("charuco:8x6:30mm:22mm:DICT_4X4_50", "charuco", (7, 5), 30.0, "mm"),
    ],
)
def test_specs(spec: str, kind: str, grid: tuple[int, int], spacing: float, unit: str) -> None:
    board = parse_board(spec)
    assert (board.kind, board.grid, board.spacing, board.unit) == (kind, grid, spacing, unit)
    assert len(board.points) == grid[0] * grid[1]


@pytest.mark.parametrize(
    "spec",
    [
        "",
        "chessboard",
        "chessboard:7x9",
        "chessboard:7x9:75",
        "chessboard:7x9:75 parsecs",
        "chessboard:2x9:75mm",
        "chessboard:7x9:0mm",
        "chess:7x9:75mm",
        "chessboard:7x9:75mm:10mm",
        "charuco:8x6:30mm:35mm:DICT_4X4_50",
        "charuco:8x6:30mm:2cm:DICT_4X4_50",
        "chessboard:7x99999:75mm",
    ],
)
def test_bad_specs_say_what_is_expected(spec: str) -> None:
    with pytest.raises(InputError, match=r"^board: (columns: |spacing: )?expected"):
        parse_board(spec)


def drawn(board: Board) -> tuple[Image, FloatArray]:
    """A tilted picture of the board, and where its points lie in it."""
    flat = np.full((900, 900), 255, dtype=np.uint8)
    origin = 200.0
    side = board.spacing * PIXELS_PER_UNIT
    if board.kind == "chessboard":
        for row in range(-1, board.rows):
            for column in range(-1, board.columns):
                if (row + column) % 2 == 0:
                    x, y = (round(origin + index * side) for index in (column, row))
                    flat[y : y + round(side), x : x + round(side)] = 0
        shift = origin - 0.5  # the edge lies between two pixels
    elif board.kind == "charuco":
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
        charuco = cv2.aruco.CharucoBoard((board.columns, board.rows), board.spacing, board.marker, dictionary)
        size = (round(board.columns * side), round(board.rows * side))
        flat[200 : 200 + size[1], 200 : 200 + size[0]] = charuco.generateImage(size)
        shift = origin - 0.5
    else:
        for x, y in board.points * PIXELS_PER_UNIT + origin:
            cv2.circle(flat, (round(x * 16), round(y * 16)), round(0.35 * side * 16), 0, -1, cv2.LINE_AA, 4)
        shift = origin
    picture = cv2.warpPerspective(flat, TILT, (1100, 1100), flags=cv2.INTER_AREA, borderValue=255)
    truth = cv2.perspectiveTransform((board.points * PIXELS_PER_UNIT + shift).reshape(-1, 1, 2), TILT).reshape(-1, 2)
    return cv2.GaussianBlur(picture, (3, 3), 0.8), truth


@pytest.mark.parametrize(
    ("spec", "tolerance"),
    [
        ("chessboard:7x6:40mm", 0.1),
        ("charuco:8x7:40mm:28mm:DICT_4X4_50", 0.3),
        ("circles:7x6:40mm", 0.3),  # the middle of an ellipse is not the circle's
        ("asymmetric-circles:4x9:28mm", 0.3),
    ],
)
def test_boards_are_found_where_they_are(spec: str, tolerance: float) -> None:
    board = parse_board(spec)
    picture, truth = drawn(board)
    found = find_board(picture, board)
    assert found.complete
    order = np.argmin(np.linalg.norm(truth[None] - found.pixels[:, None], axis=2), axis=1)
    assert len(set(order.tolist())) == len(truth)
    assert np.sqrt(np.mean((found.pixels - truth[order]) ** 2)) < tolerance
    # The order may be turned round, as a board may; the map from board to picture is a homography all the same.
    homography, _ = cv2.findHomography(found.board_xy, found.pixels)
    mapped = cv2.perspectiveTransform(found.board_xy.reshape(-1, 1, 2), homography).reshape(-1, 2)
    assert np.abs(mapped - found.pixels).max() < 2 * tolerance


def test_a_chessboard_in_part_counts() -> None:
    board = parse_board("chessboard:7x6:40mm")
    picture, _ = drawn(board)
    found = find_board(picture[:, :560].copy(), board)
    assert not found.complete
    assert 12 <= len(found.pixels) < 42


def test_sixteen_bits_and_colour() -> None:
    board = parse_board("chessboard:7x6:40mm")
    picture, _ = drawn(board)
    grey = find_board(picture, board).pixels
    deep = find_board(picture.astype(np.uint16) * 257, board).pixels
    colour = find_board(np.dstack([picture] * 3), board).pixels
    np.testing.assert_array_equal(deep, grey)
    np.testing.assert_allclose(colour, grey, atol=0.02)


def test_no_board_says_why() -> None:
    board = parse_board("chessboard:7x6:40mm")
    picture, _ = drawn(board)
    for image, spec, why in (
        (np.zeros((400, 400), np.uint8), board, "too dark"),
        (np.full((400, 400), 255, np.uint8), board, "overexposed"),
        (np.tile(np.arange(256, dtype=np.uint8), (300, 2)), board, "expected chessboard:7x6"),
        (picture, parse_board("chessboard:12x3:40mm"), "expected 12x3 inner corners, a grid of"),
    ):
        with pytest.raises(BoardNotFound, match=why):
            find_board(image, spec)


def charuco_picture(board: Board, *, old: bool, scale: float = 1.0) -> tuple[Image, FloatArray]:
    """A tilted, blurred picture of a ChArUco board in either layout, and where its corners lie in it."""
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    charuco = cv2.aruco.CharucoBoard((board.columns, board.rows), board.spacing, board.marker, dictionary)
    charuco.setLegacyPattern(old)
    side, margin = 240, 240
    flat = np.full((board.rows * side + 2 * margin, board.columns * side + 2 * margin), 255, dtype=np.uint8)
    flat[margin:-margin, margin:-margin] = charuco.generateImage((board.columns * side, board.rows * side))
    flat = cv2.GaussianBlur(flat, (0, 0), 2.5)
    tilt = np.array([[0.16 * scale, 0.02, 60], [-0.015, 0.155 * scale, 90], [4e-6, 9e-6, 1]])
    picture = cv2.warpPerspective(flat, tilt, (560, 470), flags=cv2.INTER_LINEAR, borderValue=255)
    corners = board.points / board.spacing * side + margin - 0.5
    return cv2.GaussianBlur(picture, (0, 0), 0.8), cv2.perspectiveTransform(corners[:, None], tilt)[:, 0]


@pytest.mark.parametrize("old", [False, True])
@pytest.mark.parametrize("spec", ["charuco:10x8:40mm:30mm:DICT_4X4_50", "charuco:9x7:40mm:28mm:DICT_5X5_100"])
def test_charuco_in_either_layout(spec: str, old: bool) -> None:
    board = parse_board(spec)
    picture, truth = charuco_picture(board, old=old)
    found = find_board(picture, board)
    assert found.complete
    row = [int(np.argmin(np.linalg.norm(board.points - xy, axis=1))) for xy in found.board_xy]
    # In a window that reaches into the markers, as the distance of corners alone allows, this is .2 px and more.
    assert np.sqrt(np.mean(np.sum((found.pixels - truth[row]) ** 2, axis=1))) < 0.08


@pytest.mark.parametrize(
    ("spec", "flip", "why"),
    [
        ("charuco:10x8:40mm:30mm:DICT_5X5_100", False, "40 markers of DICT_4X4_50 are seen, ids 0 to 39; --board says"),
        ("charuco:6x4:40mm:30mm:DICT_4X4_50", False, "a board of 6x4 squares has only 0 to 11: is it a larger one"),
        ("charuco:10x8:40mm:30mm:DICT_4X4_50", True, "ids 0 to 39; the picture is mirrored"),
        ("chessboard:9x7:40mm", False, r"but \d\d markers of DICT_4X4_50 .*: a ChArUco board"),
    ],
)
def test_where_a_board_is_not_found_its_markers_are_told(spec: str, flip: bool, why: str) -> None:
    picture, _ = charuco_picture(parse_board("charuco:10x8:40mm:30mm:DICT_4X4_50"), old=False)
    if spec.startswith("charuco:6x4"):
        picture[:200] = 255  # the rows that a smaller board has, too
    if spec.startswith("chess"):
        picture[250:260] = 128
    with pytest.raises(BoardNotFound, match=why):
        find_board(np.ascontiguousarray(picture[:, ::-1]) if flip else picture, parse_board(spec))


def test_markers_of_clutter_do_not_hide_a_boards_own() -> None:
    """A part of a large board, of markers beyond its family's first 50, and four of another family beside it."""
    family, other = (
        cv2.aruco.getPredefinedDictionary(name) for name in (cv2.aruco.DICT_6X6_250, cv2.aruco.DICT_4X4_50)
    )
    part = cv2.aruco.CharucoBoard((6, 4), 40, 30, family, np.arange(60, 72)).generateImage((480, 320))
    picture = np.full((480, 560), 255, np.uint8)
    picture[20:340, 40:520] = part
    for place, name in enumerate((3, 17, 29, 44)):
        picture[380:420, 60 + 110 * place : 100 + 110 * place] = cv2.aruco.generateImageMarker(other, name, 40)
    with pytest.raises(BoardNotFound, match="12 markers of DICT_6X6_100 are seen, ids 60 to 71"):
        find_board(picture, parse_board("chessboard:9x7:40mm"))
