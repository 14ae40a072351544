"""Captures from disk: each kind, and each that does not go with its pattern."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from retrue.errors import CaptureError, FileError
from retrue.files import images
from retrue.files.captures import load_capture, read_capture
from retrue.patterns.color_grid import ColorGrid
from retrue.patterns.gray_code import GrayCode
from retrue.patterns.layouts import layout_sequence
from retrue.patterns.line_grid import make_line_grid

PATTERN = GrayCode((40, 30))
GRID = ColorGrid((40, 30), ((255, 0, 0), (0, 255, 0)), 10.0, 6.0, (8.0, 8.0), ((0, 1, 0), (1, 0, 1)))
LINE_GRID = make_line_grid((800, 600))


@pytest.fixture
def folder(tmp_path):
    """What a camera sees that looks at the projector's own picture, three pixels to one."""
    for index, picture in enumerate(PATTERN.render()):
        seen = cv2.resize(picture, (120, 90), interpolation=cv2.INTER_NEAREST) // 2 + 20
        cv2.imwrite(str(tmp_path / f"img{index + 1}.png"), np.stack([seen, seen, seen // 2], axis=-1))
    return tmp_path


def test_folder_of_a_gray_code(folder):
    points = read_capture(folder, PATTERN)
    assert len(points) > 0.8 * 120 * 90
    assert np.abs(points.projector_px - (points.camera_px - 1) / 3).max() < 0.05
    assert points.colors[0].tolist() == [73, 147, 147]


def test_a_capture_keeps_the_scene_in_white_light_where_it_is_asked_to(folder):
    kept, left = load_capture(folder, PATTERN), load_capture(folder, PATTERN, keep_photograph=False)
    white = images.read_image(sorted(folder.iterdir(), key=lambda path: images.natural_key(path.name))[-2])
    np.testing.assert_array_equal(kept.photograph, white)
    assert left.photograph is None
    assert (kept.name, kept.path, kept.size) == (folder.name, folder, (120, 90))
    assert left.size == kept.size
    assert kept.card.seen == kept.card.decoded + sum(kept.card.rejected.values())
    np.testing.assert_array_equal(left.points.camera_px, kept.points.camera_px)


def test_sines_where_a_gray_code_was_expected_are_called_so(tmp_path):
    sequence = layout_sequence("slstudio-2x3", (320, 240))
    for index, picture in enumerate(sequence.render()):
        cv2.imwrite(str(tmp_path / f"img{index:02d}.png"), picture // 2 + 20)
    with pytest.raises(
        CaptureError, match=r"the pattern is another code: it holds 12 pictures, sinusoidal: phase shift\?"
    ):
        read_capture(tmp_path, GrayCode((320, 240)))
    assert len(read_capture(tmp_path, sequence)) > 0.5 * 320 * 240


def test_a_table_has_no_photograph(tmp_path):
    (tmp_path / "points.csv").write_text("camera_x,camera_y,projector_x,projector_y\n1,2,3,4\n")
    capture = load_capture(tmp_path / "points.csv")
    assert (len(capture.points), capture.photograph, capture.size, capture.card) == (1, None, None, None)


def test_faults_name_the_folder_and_the_picture(folder):
    (folder / "img7.png").unlink()
    with pytest.raises(CaptureError, match=r"number 7 is missing, after img6\.png") as caught:
        read_capture(folder, PATTERN)
    assert str(caught.value).startswith(str(folder))


def test_picture_that_is_none(folder):
    (folder / "img7.png").write_bytes(b"nothing")
    with pytest.raises(FileError, match=r"img7\.png: not a picture"):
        read_capture(folder, PATTERN)


def test_kind_of_capture_and_pattern_must_agree(folder):
    for kind, grid in (("colour", GRID), ("line", LINE_GRID)):
        with pytest.raises(CaptureError, match=f"pattern is a {kind} grid, whose folder holds"):
            read_capture(folder, grid)
    with pytest.raises(CaptureError, match="pattern is a sequence"):
        read_capture(folder / "img1.png", PATTERN)
    for path in (folder, folder / "img1.png"):
        with pytest.raises(CaptureError, match="--pattern"):
            read_capture(path)


def test_the_folder_of_a_line_grid_is_decoded_as_its_picture_is(tmp_path):
    picture = LINE_GRID.render()
    shown = {"grid": picture, "white": np.full_like(picture, 255), "black": np.zeros_like(picture)}
    for name, image in shown.items():
        images.write_png(tmp_path / f"{name}.png", image)
    one, three = read_capture(tmp_path / "grid.png", LINE_GRID), read_capture(tmp_path, LINE_GRID)
    for points in (one, three):
        assert len(points) > 4000
        assert np.abs(points.projector_px - points.camera_px).max() < 0.5


def test_nothing_there(tmp_path):
    with pytest.raises(FileError, match="no such file or folder"):
        read_capture(tmp_path / "none", PATTERN)
