"""Board captures from folders."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from retrue.calibration.board import parse_board
from retrue.errors import CaptureError
from retrue.files.board_captures import read_board_capture
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
