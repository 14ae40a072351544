"""Pattern specs as JSON: a colour grid, a line grid, a Gray code or any sequence, the format of the contract."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

from retrue.errors import FileError, InputError, require_kind, require_path
from retrue.files.atomic import read_text, replaced_file
from retrue.files.images import SUFFIXES, read_image
from retrue.files.json_values import items, number, parse_json, positive, required, shown, whole, whole_numbers
from retrue.patterns.color_grid import ColorGrid
from retrue.patterns.gray_code import MAX_PROJECTOR_SIDE, ORDER, GrayCode
from retrue.patterns.line_grid import LineGrid
from retrue.patterns.pattern import PATTERNS, Pattern
from retrue.patterns.sequence import FrameSequence

MAX_BYTES = 4 * 2**20  # a million blocks; as parsed JSON up to thirty times as much
MAX_COLORS = 256


def read_pattern(path: str | Path) -> Pattern:
    """The spec in a JSON file, or that of the line grid in a picture; keys that it does not know are left alone.

    Raises
    ------
    FileError
        no such file, no JSON, a key missing, a value of the wrong type or out of range; a picture of something else.
    """
    path = require_path(path, "read_pattern(path)")
    if path.suffix.lower() in SUFFIXES:
        return _pictured(path)
    spec = _read_object(path)
    try:
        if spec.get("format") != "retrue-pattern":
            raise InputError(f'expected "format": "retrue-pattern", found {shown(spec.get("format"))}')
        if spec.get("version") != 1:
            raise InputError(f'expected "version": 1, found {shown(spec.get("version"))}')
        kind = spec.get("kind")
        if kind == "gray-code":
            return _gray_code(spec)
        if kind == "color-grid":
            return _color_grid(spec)
        if kind == "line-grid":
            from retrue.files.line_patterns import read_line_grid

            return read_line_grid(spec, _projector_size(spec))
        if kind == "sequence":
            from retrue.files.sequence_patterns import read_sequence

            return read_sequence(spec, _projector_size(spec))
        raise InputError(f'expected "kind": "sequence", "gray-code", "color-grid" or "line-grid", found {shown(kind)}')
    except InputError as error:
        raise FileError(path, f"not a pattern: {error}") from error


def write_pattern(path: str | Path, pattern: Pattern) -> None:
    """Write the spec as JSON, whole or not at all."""
    path = require_path(path, "write_pattern(path, pattern)")
    require_kind(pattern, PATTERNS, "pattern")
    spec: dict[str, Any] = {"format": "retrue-pattern", "version": 1}
    if isinstance(pattern, FrameSequence):
        from retrue.files.sequence_patterns import sequence_spec

        spec |= sequence_spec(pattern)
    elif isinstance(pattern, LineGrid):
        from retrue.files.line_patterns import line_grid_spec

        spec |= line_grid_spec(pattern)
    elif isinstance(pattern, GrayCode):
        spec |= {"kind": "gray-code", "projector_size": pattern.projector_size, "order": ORDER}
        if pattern.step != 1:
            spec["step"] = pattern.step
        if any(pattern.offset):
            spec["offset"] = pattern.offset
    else:
        spec |= {"kind": "color-grid", "projector_size": pattern.projector_size, "colors": pattern.colors}
        spec |= {"pitch": pattern.pitch, "block": pattern.block, "origin": pattern.origin, "code": pattern.code}
    with replaced_file(path) as stream:
        stream.write((json.dumps(spec) + "\n").encode())


def _pictured(path: Path) -> LineGrid:
    from retrue.patterns.line_picture import read_line_picture

    try:
        return read_line_picture(read_image(path))
    except InputError as error:
        raise FileError(path, f"not a pattern: {error}; of other patterns give the .json") from error


def _read_object(path: Path) -> Mapping[str, Any]:
    text = read_text(path, MAX_BYTES)
    try:
        return parse_json(path, text)
    except FileError as error:
        raise FileError(path, f"not a pattern: {error.problem}") from error


def _gray_code(spec: Mapping[str, Any]) -> GrayCode:
    order = required(spec, "order")
    if order != ORDER:
        raise InputError(f'order: expected "{ORDER}", found {shown(order)}')
    width, height = _projector_size(spec)
    first_column, first_row = whole_numbers(spec.get("offset", [0, 0]), "offset", 2, 0, MAX_PROJECTOR_SIDE - 1)
    step = whole(spec.get("step", 1), "step", 1, min(width, height))
    return GrayCode((width, height), step, (first_column, first_row))


def _color_grid(spec: Mapping[str, Any]) -> ColorGrid:
    width, height = _projector_size(spec)
    colors = items(required(spec, "colors"), "colors", at_most=MAX_COLORS)
    if len(colors) < 2:
        raise InputError(f"colors: expected at least two, found {len(colors)}")
    pitch = positive(required(spec, "pitch"), "pitch")
    block = positive(required(spec, "block"), "block")
    if not block <= pitch:
        raise InputError(f"block: expected at most the pitch {pitch:g}, found {block:g}")
    origin = [number(value, "origin") for value in items(required(spec, "origin"), "origin", exactly=2)]
    code = items(required(spec, "code"), "code", at_most=height)
    if not code:
        raise InputError("code: expected rows, found none")
    columns = len(items(code[0], "code[0]", at_most=width))
    rows = tuple(tuple(whole_numbers(row, f"code[{r}]", columns, 0, len(colors) - 1)) for r, row in enumerate(code))
    if columns == 0:
        raise InputError("code[0]: expected colours, found none")
    for name, first, count, side in (("columns", origin[0], columns, width), ("rows", origin[1], len(rows), height)):
        low, high = first - block / 2, first + (count - 1) * pitch + block / 2
        if not (low >= -0.5 and high <= side - 0.5):
            raise InputError(
                f"blocks outside the projector: its {name} end at {side - 0.5:g}, the blocks span {low:g} to {high:g}"
            )
    return ColorGrid(
        projector_size=(width, height),
        colors=tuple(cast(tuple[int, int, int], tuple(whole_numbers(c, "colors", 3, 0, 255))) for c in colors),
        pitch=pitch,
        block=block,
        origin=(origin[0], origin[1]),
        code=rows,
    )


def _projector_size(spec: Mapping[str, Any]) -> tuple[int, int]:
    width, height = whole_numbers(required(spec, "projector_size"), "projector_size", 2, 1, MAX_PROJECTOR_SIDE)
    return width, height
