"""Board captures from folders."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from retrue.calibration.board import parse_board
from retrue.correspondences import Correspondences
from retrue.errors import CaptureError, FileError
from retrue.files.board_captures import read_board_capture
from retrue.files.points import write_points
from retrue.patterns.gray_code import GrayCode

PATTERN = GrayCode((1024, 768))
BOARD = parse_board("chessboard:7x9:75mm")
DATA = Path(__file__).parents[2].parent / "shared" / "data" / "procam-board" / "capture_1"


def test_a_gray_code_folder_gives_the_white_picture_and_the_points() -> None:
    if not DATA.exists():
        pytest.skip(f"no real captures at {DATA}")
    capture = read_board_capture(DATA, PATTERN, BOARD)
    white = cv2.imread(str(sorted(DATA.iterdir())[-2]), cv2.IMREAD_GRAYSCALE)
    np.testing.assert_array_equal(capture.white, white)
    assert len(capture.points) > 100_000
    assert capture.name.endswith("capture_1")


def test_what_is_no_capture_is_named(tmp_path: Path) -> None:
    picture = tmp_path / "one.png"
    cv2.imwrite(str(picture), np.zeros((32, 32), np.uint8))
    with pytest.raises(CaptureError, match=r"one\.png: expected a folder"):
        read_board_capture(picture, PATTERN, BOARD)
    with pytest.raises(CaptureError, match=tmp_path.name):
        read_board_capture(tmp_path, PATTERN, BOARD)


def test_a_picture_of_the_board_with_a_points_csv(tmp_path: Path) -> None:
    folder = tmp_path / "pose"
    folder.mkdir()
    cv2.imwrite(str(folder / "a.png"), np.full((40, 60), 200, np.uint8))
    write_points(folder / "a.csv", Correspondences([[3, 4.5]], [[7, 8]], projector_size=(100, 90)))
    for path in (folder, folder / "a.png", folder / "a.csv"):
        capture = read_board_capture(path, None, BOARD)
        assert (capture.white.shape, capture.points.projector_size) == ((40, 60), (100, 90))
        assert capture.points.projector_px.tolist() == [[7, 8]]
    write_points(folder / "a.csv", Correspondences([[59.8, 4.5]], [[7, 8]]))
    with pytest.raises(FileError, match=r"1 points lie outside a\.png, 60 x 40"):
        read_board_capture(folder, None, BOARD)
    write_points(folder / "a.csv", Correspondences([[38, 55], [20, 30]], [[7, 8], [9, 8]]))
    with pytest.raises(FileError, match=r"1 points lie outside a\.png, 60 x 40: are x and y exchanged\?"):
        read_board_capture(folder, None, BOARD)
    (folder / "b.csv").write_text("")
    with pytest.raises(CaptureError, match="expected one picture of the board and one points CSV, found 1 "):
        read_board_capture(folder, None, BOARD)
    (folder / "a.png").rename(tmp_path / "alone.png")
    with pytest.raises(CaptureError, match="expected the picture of the board beside it"):
        read_board_capture(folder / "a.csv", None, BOARD)
