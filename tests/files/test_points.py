from pathlib import Path

import numpy as np
import pytest

from retrue.correspondences import Correspondences
from retrue.errors import FileError
from retrue.files.captures import read_capture
from retrue.files.points import OPTIONAL, read_points, write_points

HEADER = "camera_x,camera_y,projector_x,projector_y\n"


def some_points(count=50):
    rng = np.random.default_rng(0)
    return Correspondences(
        rng.uniform(0, 1280, (count, 2)),
        rng.uniform(0, 1024, (count, 2)),
        camera_sigma_px=rng.uniform(0.01, 1, count),
        projector_sigma_px=rng.uniform(0.01, 1, count),
        projector_sigma_ratio=rng.uniform(0.2, 5, count),
        confidence=rng.uniform(0, 1, count),
        colors=rng.integers(0, 256, (count, 3)).astype(np.uint8),
        cells=rng.integers(-5, 1000, (count, 2)),
        light=np.where(rng.uniform(size=count) < 0.1, np.nan, rng.normal(size=count)),
        light_class=rng.integers(0, 7, count),
        camera_size=(1280, 960),
        projector_size=(1024, 768),
    )


def test_round_trip_is_exact(tmp_path):
    points = some_points()
    write_points(tmp_path / "points.csv", points)
    again = read_points(tmp_path / "points.csv")
    assert again == points
    for name in ("camera_px", *OPTIONAL):
        assert getattr(again, name).dtype == getattr(points, name).dtype, name
    first, header = (tmp_path / "points.csv").read_text().splitlines()[:2]
    assert first == "# camera_size=1280x960 projector_size=1024x768"
    assert header.endswith(",light,light_class")


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
        "Camera_X,Camera_Y,PROJECTOR_X,PROJECTOR_Y\n1,2,3,4\n",
        '"camera_x","camera_y","projector_x","projector_y"\n"1","2","3","4"\n',
        '"name, and where",camera_x,camera_y,projector_x,projector_y\n"corner, left",1,2,3,4\n',
        'camera_x;camera_y;projector_x;projector_y\n"1,0";"2,0";"3,0";"4,0"\n',
    ],
    ids=[
        "DOS lines",
        "byte-order mark",
        "spaces",
        "other order and more columns",
        "capitals",
        "quotes",
        "commas in quotes",
        "decimal commas in quotes",
    ],
)
def test_what_spreadsheets_write(tmp_path, text):
    (tmp_path / "points.csv").write_text(text, encoding="utf-8", newline="")
    points = read_points(tmp_path / "points.csv")
    assert points.camera_px.tolist() == [[1, 2]]
    assert points.projector_px.tolist() == [[3, 4]]


@pytest.mark.parametrize("end", [".txt", ".tsv", ".csv", ".TXT"])
@pytest.mark.parametrize(
    "text",
    [
        "camera_x camera_y projector_x projector_y\n1 2 3 4\n5 6 7 8\n",
        "  camera_x  camera_y\tprojector_x projector_y \n  1.0   2e0  3 4\n\n 5\t6 7 8  \n",
        "camera_x camera_y projector_x projector_y\n1,0 2,0 3,0 4,0\n5 6 7 8\n",
        "# camera_x camera_y projector_x projector_y\n1 2 3 4\n5 6 7 8\n",
        "#camera_x,camera_y,projector_x,projector_y\n1,2,3,4\n5,6,7,8\n",
        "# matched pixels\n# name camera_x camera_y projector_x projector_y\na 1 2 3 4\nb 5 6 7 8\n",
    ],
    ids=["spaces", "aligned", "decimal commas", "numpy.savetxt", "savetxt, commas", "comments, more columns"],
)
def test_columns_by_spaces_and_what_numpy_writes(tmp_path, text, end):
    path = tmp_path / f"points{end}"
    path.write_text(text)
    points = read_capture(path)
    assert points.camera_px.tolist() == [[1, 2], [5, 6]]
    assert points.projector_px.tolist() == [[3, 4], [7, 8]]


def test_numpys_own_table(tmp_path):
    pixels = np.random.default_rng(2).uniform(0, 900, (20, 4))
    np.savetxt(tmp_path / "points.txt", pixels, header="camera_x camera_y projector_x projector_y")
    points = read_capture(tmp_path / "points.txt")
    assert np.array_equal(np.hstack([points.camera_px, points.projector_px]), pixels)


@pytest.mark.parametrize("text", ["1 2 3 4\n5 6 7 8\n", "1.5e+00\t2\t3\t4\n", "# by hand\n1,2,3,4\n"])
def test_numbers_without_names_are_told_so(tmp_path, text):
    (tmp_path / "points.txt").write_text(text)
    with pytest.raises(FileError, match=r"found no column camera_x, but 1.*, 2, 3, 4; write it above the numbers"):
        read_capture(tmp_path / "points.txt")


@pytest.mark.parametrize(
    ("rows", "complaint"),
    [
        ("1,2,3,4\n1,2,3\n", "line 3: expected projector_y in column 4, found 3 columns"),
        ("1,2,3,4\n\n1,2,nan,4\n", "line 4: projector_x: expected a finite number, found 'nan'"),
        ("1,inf,3,4\n", "line 2: camera_y: expected a finite number, found 'inf'"),
        ("1,2,3,4\n1,2,3,four\n", "line 3: projector_y: expected a finite number, found 'four'"),
        ("1,2,3,\n", "line 2: projector_y: expected a finite number, found ''"),
        ('"1","2","3","four"\n', "line 2: projector_y: expected a finite number, found 'four'"),
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
        (b"", "found no column camera_x, but nothing"),
        (b"1,2,3,4\n", "found no column camera_x, but 1, 2, 3, 4"),
        (b"camera_x,projector_x,projector_y\n1,2,3\n", "found no column camera_y, but camera_x, projector_x, "),
        (b"\x89PNG\r\n\x1a\n\xff\xfe", "expected text"),
    ],
)
def test_what_is_no_points_file(tmp_path, content, complaint):
    (tmp_path / "points.csv").write_bytes(content)
    with pytest.raises(FileError, match=complaint):
        read_points(tmp_path / "points.csv")


@pytest.mark.parametrize(
    ("start", "sizes"),
    [
        ("# camera_size=640x480\n", ((640, 480), None)),
        ("# matched by hand\n#projector_size=4x3 camera_size=640x480\n\n", ((640, 480), (4, 3))),
        ("  # projector_size=4x3\n# camera_size=640x480\n", ((640, 480), (4, 3))),
        ("# nothing known, 1,2,3,4\n", (None, None)),
    ],
)
def test_rasters_and_comments_stand_before_the_header(tmp_path, start, sizes):
    (tmp_path / "points.csv").write_text(f"{start}{HEADER}1,2,3,4\n# a break\n5,6,7,8\n")
    points = read_points(tmp_path / "points.csv")
    assert points.camera_px.tolist() == [[1, 2], [5, 6]]
    assert (points.camera_size, points.projector_size) == sizes


@pytest.mark.parametrize(
    "line",
    [
        "# camera_size=640",
        "# camera_size: 640x480",
        "# camera_size=640x480 by hand",
        "# camera_size=640x0",
        "# camera_size=640x480,projector_size=4x3",
        "# camera_size=640x480 camera_size=640x480",
        "# camera_size=9999999x480",
        "# camera_size=٦٤x480",
    ],
)
def test_a_bad_size_is_named(tmp_path, line):
    (tmp_path / "points.csv").write_text(f"# by hand\n{line}\n{HEADER}1,2,3,4\n", encoding="utf-8")
    expected = "line 2: expected '# camera_size=1280x960 projector_size=1024x768', found"
    with pytest.raises(FileError, match=expected) as error:
        read_points(tmp_path / "points.csv")
    assert str(error.value).endswith(f"found '{line}'")


@pytest.mark.parametrize(
    ("row", "complaint"),
    [
        ("1,2,3,nan,5,0", "line 6: projector_y: expected a finite number, found 'nan'"),
        ("1,2,3,4,inf,0", "line 6: light: expected a finite number, found 'inf'"),
        ("1,2,3,4,5,nan", "line 6: light_class: expected a finite number, found 'nan'"),
        ("1,2,3,4,5,1e7", "line 6: light_class: expected -1e"),
    ],
)
def test_lines_are_counted_with_comments(tmp_path, row, complaint):
    text = f"# camera_size=640x480\n# x\n{HEADER.strip()},light,light_class\n1,2,3,4,nan,0\n# y\n{row}\n"
    (tmp_path / "points.csv").write_text(text)
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


def test_semicolons_and_decimal_commas_are_read(tmp_path: Path) -> None:
    rows = '# camera_size=1280x960\n"camera_x";"camera_y";"projector_x";"projector_y"\n1,5;2;3,25;4\n-0,5;2,5;3;1e1\n'
    for name, text in (("semicolons.csv", rows), ("tabs.csv", rows.replace(";", "\t"))):
        (tmp_path / name).write_text(text)
        points = read_points(tmp_path / name)
        assert points.camera_px.tolist() == [[1.5, 2.0], [-0.5, 2.5]]
        assert points.projector_px.tolist() == [[3.25, 4.0], [3.0, 10.0]]
        assert points.camera_size == (1280, 960)
    (tmp_path / "bad.csv").write_text(rows.replace("1,5;", "1,,5;"))
    with pytest.raises(FileError, match=r"line 3: camera_x: expected a finite number, found '1\.\.5'"):
        read_points(tmp_path / "bad.csv")
    (tmp_path / "commas.csv").write_text("camera_x,camera_y,projector_x,projector_y\n1,5,2,0,3,25,4,0\n")
    with pytest.raises(
        FileError, match="line 2: expected 4 columns as in the header, found 8; where numbers have decimal"
    ):
        read_points(tmp_path / "commas.csv")


@pytest.mark.parametrize(("axis", "absent"), [(0, "projector_y"), (1, "projector_x")])
def test_one_coordinate_is_one_column(axis: int, absent: str, tmp_path: Path) -> None:
    projector_px = np.full((3, 2), np.nan)
    projector_px[:, axis] = [0.5, 7.25, 3.0]
    write_points(
        tmp_path / "points.csv", Correspondences(np.arange(6.0).reshape(3, 2), projector_px, cells=[[1, 2]] * 3)
    )
    assert absent not in (tmp_path / "points.csv").read_text()
    points = read_points(tmp_path / "points.csv")
    assert points.axes == (axis,)
    np.testing.assert_array_equal(points.projector_px, projector_px)
    assert points.cells is not None
    (tmp_path / "neither.csv").write_text("camera_x,camera_y\n1,2\n")
    with pytest.raises(FileError, match="found no column projector_x"):
        read_points(tmp_path / "neither.csv")
