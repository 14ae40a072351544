"""Correspondences as CSV: camera_x,camera_y,projector_x,projector_y, and more columns where known.

Of a code of one coordinate, columns or rows, the other projector column is absent.

The rasters of both devices stand before the header, `# camera_size=1280x960 projector_size=1024x768`; any other line
that starts with # is a comment, but for one that names the columns, as `numpy.savetxt` writes it.
"""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from retrue.correspondences import SIZES, Correspondences, require_points
from retrue.errors import FileError, require_path
from retrue.files.atomic import read_text, replaced_file
from retrue.geometry.arrays import LARGEST_SIDE, FloatArray

REQUIRED = ("camera_x", "camera_y", "projector_x", "projector_y")
TABLES = frozenset({".csv", ".tsv", ".txt"})
"""How names of points files end."""
LARGEST_FILE = 2**30  # bytes
MOST_ROWS = 20_000_000
LONGEST_LINE = 10_000  # characters
ROWS_AT_A_TIME = 65_536
COMMENT = re.compile(r"^[ \t]*#.*$", re.MULTILINE)
MARGINS = re.compile(r"^[ \t]+|[ \t]+$", re.MULTILINE)
SPACES = re.compile(r"[ \t]+")
SIZE = re.compile(r"([0-9]{1,7})x([0-9]{1,7})")


class _Field(NamedTuple):
    """An optional field of `Correspondences`: its columns in the file, their range and type; whether nan is allowed."""

    columns: tuple[str, ...]
    low: float
    high: float
    dtype: type[Any]
    nan: bool = False


class _Column(NamedTuple):
    """A column to read, and where it stands in the file."""

    name: str
    place: int
    nan: bool

    def holds(self, values: ArrayLike) -> bool:
        """Whether all of these are numbers that it may hold."""
        return not np.isinf(values).any() if self.nan else bool(np.isfinite(values).all())


OPTIONAL = {
    "camera_sigma_px": _Field(("camera_sigma",), 0.0, np.inf, np.float64),
    "projector_sigma_px": _Field(("projector_sigma",), 0.0, np.inf, np.float64),
    "projector_sigma_ratio": _Field(("projector_sigma_ratio",), 0.0, np.inf, np.float64),
    "confidence": _Field(("confidence",), 0.0, 1.0, np.float64),
    "colors": _Field(("red", "green", "blue"), 0, 255, np.uint8),
    "cells": _Field(("row", "column"), -1_000_000, 1_000_000, np.int64),
    "light": _Field(("light",), -np.inf, np.inf, np.float64, nan=True),
    "light_class": _Field(("light_class",), -1_000_000, 1_000_000, np.int64),
}


def write_points(path: str | Path, points: Correspondences) -> None:
    """One row a point, exact to the last bit; the optional fields that the points have follow the first columns.

    Their rasters stand in a first line of its own, where the points tell them.
    """
    path = require_path(path, "write_points(path, points)")
    require_points(points)
    names = [*REQUIRED[:2], *(REQUIRED[2 + axis] for axis in points.axes)]
    columns = [*points.camera_px.T, *(points.projector_px[:, axis] for axis in points.axes)]
    for name, field in OPTIONAL.items():
        values = getattr(points, name)
        if values is not None:
            names += field.columns
            columns += [*np.reshape(values, (len(points), len(field.columns))).T]
    sizes = [f"{name}={size[0]}x{size[1]}" for name in SIZES if (size := getattr(points, name)) is not None]
    with replaced_file(path) as stream:
        if sizes:
            stream.write(f"# {' '.join(sizes)}\n".encode("ascii"))
        stream.write((",".join(names) + "\n").encode("ascii"))
        for start in range(0, len(points), ROWS_AT_A_TIME):
            block = [map(repr, column[start : start + ROWS_AT_A_TIME].tolist()) for column in columns]
            stream.write("".join(",".join(row) + "\n" for row in zip(*block, strict=True)).encode("ascii"))


def read_points(path: str | Path) -> Correspondences:
    """Matched pixels from CSV; the order of columns is free, unknown ones are passed over.

    Columns may be separated by semicolons, tabs or spaces too, and numbers then have decimal commas. Any cell may stand
    in quotes, and names in capitals.

    Raises
    ------
    FileError : not such a file, or a row that is short, not a number, NaN, infinite or out of range: names the line.
    """
    path = require_path(path, "read_points(path)")
    sizes, names, body = _sizes_header_and_body(path)
    required = [name for name in REQUIRED if name in names]
    missing = [name for name in REQUIRED if name not in required]
    if len(required) < 3 or missing[:1] in (["camera_x"], ["camera_y"]):
        found = ", ".join(names)[:80] or "nothing"
        found += "; write it above the numbers" if any(names) and not re.search("[a-z_]{3}", found) else ""
        raise FileError(
            path, f"expected a CSV with the header {','.join(REQUIRED)}, found no column {missing[0]}, but {found}"
        )
    fields = {name: field for name, field in OPTIONAL.items() if set(field.columns) <= set(names)}
    wanted = [_Column(name, names.index(name), nan=False) for name in required]
    wanted += [_Column(name, names.index(name), field.nan) for field in fields.values() for name in field.columns]
    table = _parse(path, body, wanted)
    optional: dict[str, Any] = {**sizes}
    end = len(required)
    for name, field in fields.items():
        start, end = end, end + len(field.columns)
        values = table[:, start:end]
        _require_range(path, body, field, values)
        optional[name] = (values if len(field.columns) > 1 else values[:, 0]).astype(field.dtype)
    projector_px = np.full((len(table), 2), np.nan)
    projector_px[:, [axis for axis in range(2) if REQUIRED[2 + axis] in required]] = table[:, 2 : len(required)]
    return Correspondences(table[:, :2], projector_px, **optional)


def _sizes_header_and_body(path: Path) -> tuple[dict[str, tuple[int, int]], list[str], str]:
    """The body has its lines where the file has them; those that are comments, or stand before it, are empty."""
    # Other ends of lines than these are none to the parser either, but would be to what counts the lines.
    text = read_text(path, LARGEST_FILE).replace("\r\n", "\n").replace("\r", "\n")
    longest = max(map(len, io.StringIO(text)), default=0)  # the parser takes memory for each comma of a line
    if longest > LONGEST_LINE:
        raise FileError(path, f"expected lines of at most {LONGEST_LINE} characters, found one of {longest}")
    sizes: dict[str, tuple[int, int]] = {}
    lines = start = 0
    for line in io.StringIO(text):
        if line.strip() and (not COMMENT.match(line) or _required(re.split(r"[\s,;#]+", line)) >= 3):
            break
        lines, start = lines + 1, start + len(line)
        if any(name in line for name in SIZES):
            sizes |= _sizes(path, lines, line)
    header, _, body = text[start:].partition("\n")
    header = header.strip(" ").removeprefix("#")
    if "#" in body:
        body = COMMENT.sub("", body)
    by_spaces = _required(header.split()) > _required(header.split("\t")) or "\t" not in header
    if by_spaces and not {",", ";"} & {*header}:
        header, body = (SPACES.sub(",", MARGINS.sub("", text.replace(",", "."))) for text in (header, body))
    for separator in (";", "\t"):  # as where a comma is the decimal point
        if separator in header:
            header, body = (text.replace(",", ".").replace(separator, ",") for text in (header, body))
    names = [name.strip().lower() for name in _cells(header)]
    _require_no_decimal_commas(path, lines + 2, names, body)
    return sizes, names, "\n" * lines + body


def _required(words: list[str]) -> int:
    """How many of them name a column that a header has."""
    return len(set(REQUIRED) & {word.strip().lower() for word in words})


def _require_no_decimal_commas(path: Path, number: int, names: list[str], body: str) -> None:
    """The first row has no more columns than there are names."""
    for line, row in enumerate(body.split("\n", 20)[:20], start=number):
        if row.strip():
            if len(_cells(row.rstrip(", \r"))) > len(names):
                raise FileError(
                    path,
                    f"line {line}: expected {len(names)} columns as in the header, found {len(_cells(row))}; where "
                    "numbers have decimal commas, separate columns by semicolons",
                )
            return


def _cells(row: str) -> list[str]:
    """Of one line; those in quotes, as spreadsheets write them, may hold commas."""
    return next(csv.reader([row], skipinitialspace=True), list[str]())


def _sizes(path: Path, number: int, line: str) -> dict[str, tuple[int, int]]:
    sizes: dict[str, tuple[int, int]] = {}
    for word in line.strip().removeprefix("#").split():
        name, _, value = word.partition("=")
        size = SIZE.fullmatch(value)
        width, height = (int(size[1]), int(size[2])) if size else (0, 0)
        if name not in SIZES or name in sizes or not (0 < width <= LARGEST_SIDE and 0 < height <= LARGEST_SIDE):
            found = line.strip()[:80]
            raise FileError(
                path, f"line {number}: expected '# camera_size=1280x960 projector_size=1024x768', found '{found}'"
            )
        sizes[name] = width, height
    return sizes


def _parse(path: Path, body: str, wanted: list[_Column]) -> FloatArray:
    if not body.strip():
        return np.empty((0, len(wanted)))
    if (rows := body.count("\n")) > MOST_ROWS:
        raise FileError(path, f"expected at most {MOST_ROWS} rows, found {rows}")
    try:
        places = [column.place for column in wanted]
        table = np.loadtxt(io.StringIO(body), delimiter=",", comments=None, quotechar='"', usecols=places, ndmin=2)
    except ValueError:
        _name_bad_line(path, body, wanted)
    if not all(column.holds(values) for column, values in zip(wanted, table.T, strict=True)):
        _name_bad_line(path, body, wanted)
    return table


def _name_bad_line(path: Path, body: str, wanted: list[_Column]) -> NoReturn:
    """The quick parser knows only that something is wrong; this finds the line."""
    for line, row in enumerate(body.split("\n"), start=2):
        cells = _cells(row)
        if not row.strip():
            continue
        for column in wanted:
            name, place = column.name, column.place
            if place >= len(cells):
                raise FileError(path, f"line {line}: expected {name} in column {place + 1}, found {len(cells)} columns")
            try:
                held = column.holds(float(cells[place]))
            except ValueError:
                held = False
            if not held:
                raise FileError(path, f"line {line}: {name}: expected a finite number, found '{cells[place].strip()}'")
    raise FileError(path, "expected rows of numbers separated by commas")


def _require_range(path: Path, body: str, field: _Field, values: FloatArray) -> None:
    outside = ~((values >= field.low) & (values <= field.high))
    if field.nan:
        outside &= ~np.isnan(values)
    if outside.any():
        row, column = (int(where[0]) for where in np.nonzero(outside))
        lines = [number for number, line in enumerate(body.split("\n"), start=2) if line.strip()]
        raise FileError(
            path,
            f"line {lines[row]}: {field.columns[column]}: expected {field.low:g} to {field.high:g}, "
            f"found {values[row, column]:g}",
        )
