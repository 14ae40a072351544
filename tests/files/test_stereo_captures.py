"""Which pictures of two cameras belong together."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from retrue.calibration.board import parse_board
from retrue.errors import CaptureError, InputError, RetrueWarning
from retrue.files.pairs import stereo_pairs
from retrue.files.stereo_captures import read_stereo_captures


def touched(folder: Path, *names: str) -> list[Path]:
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        (folder / name).touch()
    return [folder / name for name in names]


def names(pairs: list[tuple[Path, Path]]) -> list[tuple[str, str]]:
    return [(left.name, right.name) for left, right in pairs]


def test_every_way_to_hand_in_pairs(tmp_path: Path) -> None:
    left = touched(tmp_path / "left", "a2.png", "a10.png")
    right = touched(tmp_path / "right", "b2.png", "b10.png")
    expected = [("a2.png", "b2.png"), ("a10.png", "b10.png")]
    assert names(stereo_pairs([tmp_path / "left", tmp_path / "right"])) == expected
    assert names(stereo_pairs([tmp_path])) == expected
    assert names(stereo_pairs([*left, *right])) == expected
    assert names(stereo_pairs([left[0], right[0], left[1], right[1]])) == expected
    touched(tmp_path / "both", "left01.jpg", "left02.jpg", "right01.jpg", "right02.jpg")
    assert names(stereo_pairs([tmp_path / "both"])) == [("left01.jpg", "right01.jpg"), ("left02.jpg", "right02.jpg")]
    assert names(stereo_pairs(touched(tmp_path, "l.png", "r.png"))) == [("l.png", "r.png")]


@pytest.mark.parametrize(
    "sides",
    [
        (("left00.jpg", "left02.jpg"), ("right00.jpg", "right02.jpg")),
        (("01_l.png", "02_l.png"), ("01_r.png", "02_r.png")),
        (("cam0_0.png", "cam0_1.png"), ("cam1_0.png", "cam1_1.png")),
        (("0_cam0.png", "1_cam0.png"), ("0_cam1.png", "1_cam1.png")),
        (("scene7-Left-3.TIF", "scene7-Left-12.TIF"), ("scene7-Right-3.TIF", "scene7-Right-12.TIF")),
        (("3_A.png", "17_A.png"), ("3_B.png", "17_B.png")),
    ],
)
def test_names_tell_the_side_and_the_number(tmp_path: Path, sides: tuple[tuple[str, ...], tuple[str, ...]]) -> None:
    left, right = (touched(tmp_path, *side) for side in sides)
    expected = list(zip(*sides, strict=True))
    assert names(stereo_pairs([tmp_path])) == expected
    assert names(stereo_pairs([*left, *right])) == expected
    assert names(stereo_pairs([left[0], right[0], left[1], right[1]])) == expected
    assert names(stereo_pairs([*right, *left])) == [(b, a) for a, b in expected]  # the first one's camera is the first


def test_time_stamps_pair_folders_and_the_missing_frame_is_named(tmp_path: Path) -> None:
    touched(tmp_path / "cam0", "1403636579763555584.png", "1403636579813555456.png", "1403636579863555584.png")
    touched(tmp_path / "cam1", "1403636579763555584.png", "1403636579863555584.png")
    with pytest.warns(RetrueWarning, match=r"without a partner: 1403636579813555456\.png"):
        pairs = stereo_pairs([tmp_path])
    assert [left.name for left, _ in pairs] == ["1403636579763555584.png", "1403636579863555584.png"]
    assert all(left.name == right.name for left, right in pairs)


def test_names_that_pair_in_two_ways_are_not_guessed(tmp_path: Path) -> None:
    touched(tmp_path, "0_0.png", "0_1.png", "1_0.png", "1_1.png")
    with pytest.raises(CaptureError, match="can be paired in 2 ways"):
        stereo_pairs([tmp_path])


def test_what_has_no_partner_is_left_out_and_named(tmp_path: Path) -> None:
    touched(tmp_path / "l", "left01.jpg", "left02.jpg", "left03.jpg")
    touched(tmp_path / "r", "right01.jpg", "right03.jpg")
    with pytest.warns(RetrueWarning, match=r"without a partner: left02\.jpg"):
        pairs = stereo_pairs([tmp_path / "l", tmp_path / "r"])
    assert names(pairs) == [("left01.jpg", "right01.jpg"), ("left03.jpg", "right03.jpg")]


def test_what_makes_no_pairs_is_refused(tmp_path: Path) -> None:
    alone = touched(tmp_path / "one", "left01.jpg")
    with pytest.raises(InputError, match="expected two folders, of the left and of the right camera"):
        stereo_pairs(alone)
    with pytest.raises(CaptureError, match="no word or number in the names that tells them"):
        stereo_pairs([tmp_path / "one"])
    touched(tmp_path / "x", "first.png", "second.png", "third.png")
    touched(tmp_path / "y", "one.png", "two.png")
    with pytest.raises(InputError, match=r"expected as many of each, found 3 in .* and 2 in"):
        stereo_pairs([tmp_path / "x", tmp_path / "y"])
    (tmp_path / "empty").mkdir()
    with pytest.raises(CaptureError, match=r"expected pictures.* of one camera, found none"):
        stereo_pairs([tmp_path / "empty", tmp_path / "y"])


def test_pictures_are_read_in_pairs(tmp_path: Path) -> None:
    for side, grey in (("left", 50), ("right", 90)):
        (tmp_path / side).mkdir()
        cv2.imwrite(str(tmp_path / side / "1.png"), np.full((20, 30), grey, np.uint8))
    (capture,) = read_stereo_captures([tmp_path / "left", tmp_path / "right"], parse_board("chessboard:7x9:75mm"))
    assert (int(capture.left[0, 0]), int(capture.right[0, 0]), capture.points) == (50, 90, None)
