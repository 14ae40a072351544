import numpy as np
import pytest

from retrue.correspondences import Correspondences
from retrue.errors import FileError
from retrue.files.points import read_points, write_points

HEADER = "camera_x,camera_y,projector_x,projector_y\n"


def some_points(count=50):
    rng = np.random.default_rng(0)
    return Correspondences(
        rng.uniform(0, 1280, (count, 2)),
        rng.uniform(0, 1024, (count, 2)),
        camera_sigma_px=rng.uniform(0.01, 1, count),
        projector_sigma_px=rng.uniform(0.01, 1, count),
        confidence=rng.uniform(0, 1, count),
        colors=rng.integers(0, 256, (count, 3)).astype(np.uint8),
        cells=rng.integers(-5, 1000, (count, 2)),
    )


def test_round_trip_is_exact(tmp_path):
    points = some_points()
    write_points(tmp_path / "points.csv", points)
    again = read_points(tmp_path / "points.csv")
    for name in ("camera_px", "projector_px", "camera_sigma_px", "projector_sigma_px", "confidence", "colors", "cells"):
        written, read = getattr(points, name), getattr(again, name)
        assert read.dtype == written.dtype, name
        assert np.array_equal(read, written), name


def test_optional_columns_that_are_not_there_are_none(tmp_path):
    write_points(tmp_path / "points.csv", Correspondences([[1, 2]], [[3, 4]]))
    again = read_points(tmp_path / "points.csv")
    assert (tmp_path / "points.csv").read_text() == HEADER + "1.0,2.0,3.0,4.0\n"
    assert (again.colors, again.cells, again.confidence) == (None, None, None)


def test_no_points(tmp_path):
    write_points(tmp_path / "points.csv", Correspondences(np.empty((0, 2)), np.empty((0, 2))))
    assert len(read_points(tmp_path / "points.csv")) == 0


@pytest.mark.parametrize(
    "text",
    [
        "camera_x,camera_y,projector_x,projector_y\r\n1,2,3,4\r\n\r\n",
        "\ufeffcamera_x,camera_y,projector_x,projector_y\n1,2,3,4",
        " camera_x , camera_y , projector_x , projector_y \n 1, 2 , 3,4e0\n",
        "projector_y,name,camera_x,camera_y,projector_x\n4,corner,1,2,3\n",
    ],
    ids=["DOS lines", "byte-order mark", "spaces", "other order and more columns"],
)
def test_what_spreadsheets_write(tmp_path, text):
    (tmp_path / "points.csv").write_text(text, encoding="utf-8", newline="")
    points = read_points(tmp_path / "points.csv")
    assert points.camera_px.tolist() == [[1, 2]]
    assert points.projector_px.tolist() == [[3, 4]]


@pytest.mark.parametrize(
    ("rows", "complaint"),
    [
        ("1,2,3,4\n1,2,3\n", "line 3: expected projector_y in column 4, found 3 columns"),
        ("1,2,3,4\n\n1,2,nan,4\n", "line 4: projector_x: expected a finite number, found 'nan'"),
        ("1,inf,3,4\n", "line 2: camera_y: expected a finite number, found 'inf'"),
        ("1,2,3,4\n1,2,3,four\n", "line 3: projector_y: expected a finite number, found 'four'"),
        ("1,2,3,\n", "line 2: projector_y: expected a finite number, found ''"),
        ("1;2;3;4\n", "line 2: camera_x: expected a finite number, found '1;2;3;4'"),
    ],
)
def test_a_bad_row_is_named(tmp_path, rows, complaint):
    (tmp_path / "points.csv").write_text(HEADER + rows)
    with pytest.raises(FileError, match="line") as error:
        read_points(tmp_path / "points.csv")
    assert str(error.value).endswith(complaint)


def test_a_value_out_of_range_is_named(tmp_path):
    (tmp_path / "points.csv").write_text(HEADER.strip() + ",red,green,blue\n1,2,3,4,0,0,0\n\n1,2,3,4,0,256,0\n")
    with pytest.raises(FileError, match="line 4: green: expected 0 to 255, found 256"):
        read_points(tmp_path / "points.csv")


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"", "found no column camera_x"),
        (b"1,2,3,4\n", "found no column camera_x"),
        (b"camera_x,camera_y,projector_x\n1,2,3\n", "found no column projector_y"),
        (b"\x89PNG\r\n\x1a\n\xff\xfe", "expected text"),
    ],
)
def test_what_is_no_points_file(tmp_path, content, complaint):
    (tmp_path / "points.csv").write_bytes(content)
    with pytest.raises(FileError, match=complaint):
        read_points(tmp_path / "points.csv")


def test_no_such_file(tmp_path):
    with pytest.raises(FileError, match=r"missing\.csv: cannot be read"):
        read_points(tmp_path / "missing.csv")


def test_a_folder_that_cannot_be_written_leaves_nothing(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match="cannot be written"):
        write_points(tmp_path / "file" / "points.csv", some_points())
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["file"]
