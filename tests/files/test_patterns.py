"""Pattern specs: what is written reads back; what is wrong is named in one line."""

from __future__ import annotations

import json

import pytest

from retrue.errors import FileError
from retrue.files.images import write_png
from retrue.files.patterns import read_pattern, write_pattern
from retrue.patterns.color_grid import ColorGrid
from retrue.patterns.gray_code import ORDER, GrayCode
from retrue.patterns.line_grid import LineGrid, make_line_grid

GRAY = {
    "format": "retrue-pattern",
    "version": 1,
    "kind": "gray-code",
    "projector_size": [1024, 768],
    "order": ORDER,
}
GRID = {
    "format": "retrue-pattern",
    "version": 1,
    "kind": "color-grid",
    "projector_size": [100, 80],
    "colors": [[255, 0, 0], [0, 255, 0], [0, 0, 255]],
    "pitch": 19,
    "block": 12,
    "origin": [10.5, 12],
    "code": [[0, 1, 2, 0], [2, 0, 1, 1], [1, 2, 0, 2]],
}


def read(tmp_path, spec):
    path = tmp_path / "pattern.json"
    path.write_text(spec if isinstance(spec, str) else json.dumps(spec))
    return read_pattern(path)


@pytest.mark.parametrize(
    "pattern",
    [
        GrayCode((1024, 768)),
        GrayCode((1280, 800), step=4, offset=(3, 5)),
        ColorGrid((100, 80), ((255, 0, 0), (0, 255, 0)), 19.0, 12.5, (10.5, 12.0), ((0, 1), (1, 0))),
    ],
)
def test_round_trip(tmp_path, pattern):
    write_pattern(tmp_path / "p.json", pattern)
    assert read_pattern(tmp_path / "p.json") == pattern


def test_contract_examples_with_keys_of_others(tmp_path):
    assert read(tmp_path, GRAY | {"made_by": "another tool"}) == GrayCode((1024, 768))
    grid = read(tmp_path, GRID | {"guaranteed_distance": 3})
    assert isinstance(grid, ColorGrid)
    assert (grid.pitch, grid.origin, grid.code[1]) == (19.0, (10.5, 12.0), (2, 0, 1, 1))


@pytest.mark.parametrize("key", ["format", "version", "kind", "projector_size", "order"])
def test_missing_key_of_a_gray_code(tmp_path, key):
    with pytest.raises(FileError, match=key):
        read(tmp_path, {name: value for name, value in GRAY.items() if name != key})


@pytest.mark.parametrize("key", ["projector_size", "colors", "pitch", "block", "origin", "code"])
def test_missing_key_of_a_color_grid(tmp_path, key):
    with pytest.raises(FileError, match=f'"{key}" is missing'):
        read(tmp_path, {name: value for name, value in GRID.items() if name != key})


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"projector_size": [1024]}, "projector_size: expected 2 values"),
        ({"projector_size": [1024.5, 768]}, "whole number"),
        ({"projector_size": [1e9, 1e9]}, "expected 1 to 16384"),
        ({"projector_size": "1024x768"}, "expected a list"),
        ({"order": "rows-first"}, "order: expected"),
        ({"version": 2}, "version"),
        ({"kind": "stripes"}, "gray-code"),
        ({"step": 0}, "step: expected 1 to 768"),
        ({"step": True}, "whole number"),
        ({"offset": [0, -1]}, "offset"),
    ],
)
def test_wrong_gray_code(tmp_path, change, complaint):
    with pytest.raises(FileError, match=complaint) as caught:
        read(tmp_path, GRAY | change)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"code": [[0, 1, 2, 0], [2, 0, 3, 1]]}, r"code\[1\]: expected 0 to 2, found 3"),
        ({"code": [[0, 1, 2, 0], [2, 0]]}, r"code\[1\]: expected 4 values, found 2"),
        ({"code": []}, "code: expected rows"),
        ({"code": [[]]}, "expected colours"),
        ({"code": [[0] * 200]}, "at most 100"),
        ({"code": [[0, -1]]}, "expected 0 to 2"),
        ({"colors": [[255, 0]]}, "colors"),
        ({"colors": [[255, 0, 0], [0, 300, 0], [0, 0, 1]]}, "expected 0 to 255"),
        ({"block": 20}, "at most the pitch"),
        ({"pitch": -1}, "positive"),
        ({"pitch": "19"}, "finite number"),
        ({"origin": [3, 12]}, "blocks outside the projector: its columns"),
        ({"origin": [10.5, 40]}, "blocks outside the projector: its rows"),
        ({"origin": [float("nan"), 12]}, "NaN"),
    ],
)
def test_wrong_color_grid(tmp_path, change, complaint):
    with pytest.raises(FileError, match=complaint) as caught:
        read(tmp_path, GRID | change)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "{", "[1, 2]", "null", "\x00\x01", "[" * 100_000])
def test_no_json_object(tmp_path, text):
    with pytest.raises(FileError, match="not a pattern"):
        read(tmp_path, text)


def test_no_file(tmp_path):
    with pytest.raises(FileError, match="No such file"):
        read_pattern(tmp_path / "none.json")


LINES = {
    "format": "retrue-pattern",
    "version": 1,
    "kind": "line-grid",
    "projector_size": [100, 80],
    "columns": {"colors": [[255, 0, 191], [0, 64, 255]], "sequence": [0, 1, 1], "origin": 11, "pitch": 11, "width": 3},
    "rows": {"colors": [[255, 0, 0], [0, 255, 255]], "sequence": [1, 0], "origin": 5.5, "pitch": 8, "width": 2},
}


@pytest.mark.parametrize("absent", ["columns", "rows", None])
def test_line_grid_round_trip(tmp_path, absent):
    grid = read(tmp_path, {name: value for name, value in LINES.items() if name != absent})
    assert isinstance(grid, LineGrid)
    assert (grid.columns is None, grid.rows is None) == (absent == "columns", absent == "rows")
    write_pattern(tmp_path / "p.json", grid)
    assert read_pattern(tmp_path / "p.json") == grid


@pytest.mark.parametrize("key", ["colors", "sequence", "origin", "pitch", "width"])
def test_missing_key_of_lines(tmp_path, key):
    lines = {name: value for name, value in LINES["rows"].items() if name != key}
    with pytest.raises(FileError, match=f'rows: key "{key}" is missing'):
        read(tmp_path, LINES | {"rows": lines})


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"sequence": [0, 2]}, "sequence: expected 0 to 1, found 2"),
        ({"sequence": []}, "one line or more"),
        ({"sequence": [0] * 200}, "at most 80"),
        ({"colors": [[255, 0, 0]]}, "at least two"),
        ({"width": 9}, "width < pitch"),
        ({"pitch": float("nan")}, "NaN"),
        ({"origin": 78}, "rows between"),
    ],
)
def test_wrong_lines(tmp_path, change, complaint):
    with pytest.raises(FileError, match=complaint) as caught:
        read(tmp_path, LINES | {"rows": LINES["rows"] | change})
    assert "\n" not in str(caught.value)
    with pytest.raises(FileError, match="rows: expected an object"):
        read(tmp_path, LINES | {"rows": [1, 2]})


def test_picture_of_a_line_grid_is_a_pattern(tmp_path):
    grid = make_line_grid((640, 480))
    write_png(tmp_path / "shown.png", grid.render())
    assert (read_pattern(tmp_path / "shown.png").render() == grid.render()).all()
    write_png(tmp_path / "black.png", grid.render() // 255 * 0)
    with pytest.raises(FileError, match=r"black\.png: not a pattern: expected a picture of a line grid") as caught:
        read_pattern(tmp_path / "black.png")
    assert "\n" not in str(caught.value)
