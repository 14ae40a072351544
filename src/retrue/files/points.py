"""Correspondences as CSV: camera_x,camera_y,projector_x,projector_y, and more columns where known."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np

from retrue.correspondences import Correspondences, require_points
from retrue.errors import FileError, require_path
from retrue.files.atomic import read_text, replaced_file
from retrue.geometry.arrays import FloatArray

REQUIRED = ("camera_x", "camera_y", "projector_x", "projector_y")
LARGEST_FILE = 2**30  # bytes
MOST_ROWS = 20_000_000
LONGEST_LINE = 10_000  # characters
ROWS_AT_A_TIME = 65_536


class _Field(NamedTuple):
    """An optional field of `Correspondences`: its columns in the file, their range and type."""

    columns: tuple[str, ...]
    low: float
    high: float
    dtype: type[Any]


OPTIONAL = {
    "camera_sigma_px": _Field(("camera_sigma",), 0.0, np.inf, np.float64),
    "projector_sigma_px": _Field(("projector_sigma",), 0.0, np.inf, np.float64),
    "confidence": _Field(("confidence",), 0.0, 1.0, np.float64),
    "colors": _Field(("red", "green", "blue"), 0, 255, np.uint8),
    "cells": _Field(("row", "column"), -1_000_000, 1_000_000, np.int64),
}


def write_points(path: str | Path, points: Correspondences) -> None:
    """One row a point, exact to the last bit; the optional fields that the points have follow the four columns."""
    path = require_path(path, "write_points(path, points)")
    require_points(points)
    names: list[str] = [*REQUIRED]
    columns = [*points.camera_px.T, *points.projector_px.T]
    for name, field in OPTIONAL.items():
        values = getattr(points, name)
        if values is not None:
            names += field.columns
            columns += [*np.reshape(values, (len(points), len(field.columns))).T]
    with replaced_file(path) as stream:
        stream.write((",".join(names) + "\n").encode("ascii"))
        for start in range(0, len(points), ROWS_AT_A_TIME):
            block = [map(repr, column[start : start + ROWS_AT_A_TIME].tolist()) for column in columns]
            stream.write("".join(",".join(row) + "\n" for row in zip(*block, strict=True)).encode("ascii"))


def read_points(path: str | Path) -> Correspondences:
    """Matched pixels from CSV; the order of columns is free, unknown ones are passed over.

    Raises
    ------
    FileError : not such a file, or a row that is short, not a number, NaN, infinite or out of range: names the line.
    """
    path = require_path(path, "read_points(path)")
    names, body = _header_and_body(path)
    missing = [name for name in REQUIRED if name not in names]
    if missing:
        raise FileError(path, f"expected a CSV with the header {','.join(REQUIRED)}, found no column {missing[0]}")
    fields = {name: field for name, field in OPTIONAL.items() if set(field.columns) <= set(names)}
    wanted = [*REQUIRED, *(column for field in fields.values() for column in field.columns)]
    table = _parse(path, body, wanted, [names.index(column) for column in wanted])
    optional: dict[str, Any] = {}
    end = len(REQUIRED)
    for name, field in fields.items():
        start, end = end, end + len(field.columns)
        values = table[:, start:end]
        _require_range(path, body, field, values)
        optional[name] = (values if len(field.columns) > 1 else values[:, 0]).astype(field.dtype)
    return Correspondences(table[:, :2], table[:, 2:4], **optional)


def _header_and_body(path: str | Path) -> tuple[list[str], str]:
    # Other ends of lines than these are none to the parser either, but would be to what counts the lines.
    text = read_text(path, LARGEST_FILE).replace("\r\n", "\n").replace("\r", "\n")
    longest = max(map(len, io.StringIO(text)), default=0)  # the parser takes memory for each comma of a line
    if longest > LONGEST_LINE:
        raise FileError(path, f"expected lines of at most {LONGEST_LINE} characters, found one of {longest}")
    header, _, body = text.partition("\n")
    return [name.strip() for name in header.split(",")], body


def _parse(path: str | Path, body: str, names: list[str], columns: list[int]) -> FloatArray:
    if not body.strip():
        return np.empty((0, len(names)))
    if (rows := body.count("\n")) > MOST_ROWS:
        raise FileError(path, f"expected at most {MOST_ROWS} rows, found {rows}")
    try:
        table = np.loadtxt(io.StringIO(body), delimiter=",", comments=None, usecols=columns, ndmin=2)
    except ValueError:
        _name_bad_line(path, body, names, columns)
    if not np.isfinite(table).all():
        _name_bad_line(path, body, names, columns)
    return table


def _name_bad_line(path: str | Path, body: str, names: list[str], columns: list[int]) -> NoReturn:
    """The quick parser knows only that something is wrong; this finds the line."""
    for line, row in enumerate(body.split("\n"), start=2):
        cells = row.split(",")
        if not row.strip():
            continue
        for name, column in zip(names, columns, strict=True):
            if column >= len(cells):
                raise FileError(
                    path, f"line {line}: expected {name} in column {column + 1}, found {len(cells)} columns"
                )
            try:
                finite = bool(np.isfinite(float(cells[column])))
            except ValueError:
                finite = False
            if not finite:
                raise FileError(path, f"line {line}: {name}: expected a finite number, found '{cells[column].strip()}'")
    raise FileError(path, "expected rows of numbers separated by commas")


def _require_range(path: str | Path, body: str, field: _Field, values: FloatArray) -> None:
    outside = ~((values >= field.low) & (values <= field.high))
    if outside.any():
        row, column = (int(where[0]) for where in np.nonzero(outside))
        lines = [number for number, line in enumerate(body.split("\n"), start=2) if line.strip()]
        raise FileError(
            path,
            f"line {lines[row]}: {field.columns[column]}: expected {field.low:g} to {field.high:g}, "
            f"found {values[row, column]:g}",
        )
