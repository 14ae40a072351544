"""Line grids: their specs as JSON, and the spec of a picture of one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

from retrue.errors import InputError
from retrue.files.json_values import items, number, positive, required, shown, whole_numbers
from retrue.patterns.line_grid import LineGrid, Lines

MAX_COLORS = 256


def read_line_grid(spec: Mapping[str, Any], projector_size: tuple[int, int]) -> LineGrid:
    """The line grid of parsed JSON; an `InputError` that names what is missing or wrong."""
    families = [
        None if spec.get(name) is None else _lines(spec[name], name, side)
        for name, side in zip(("columns", "rows"), projector_size, strict=True)
    ]
    return LineGrid(projector_size, *families)


def line_grid_spec(pattern: LineGrid) -> dict[str, Any]:
    """What goes into the file beside format and version."""
    spec: dict[str, Any] = {"kind": "line-grid", "projector_size": pattern.projector_size}
    for name, lines in (("columns", pattern.columns), ("rows", pattern.rows)):
        if lines is not None:
            spec[name] = {"colors": lines.colors, "sequence": lines.sequence, "origin": lines.origin}
            spec[name] |= {"pitch": lines.pitch, "width": lines.width}
    return spec


def _lines(value: Any, name: str, side: int) -> Lines:
    if not isinstance(value, dict):
        raise InputError(
            f"{name}: expected an object with colors, sequence, origin, pitch and width, found {shown(value)}"
        )
    spec = cast(dict[str, Any], value)
    try:
        colors = items(required(spec, "colors"), "colors", at_most=MAX_COLORS)
        palette = [cast(tuple[int, int, int], tuple(whole_numbers(color, "colors", 3, 0, 255))) for color in colors]
        if len(palette) < 2:
            raise InputError(f"colors: expected at least two, found {len(palette)}")
        sequence = items(required(spec, "sequence"), "sequence", at_most=side)
        return Lines(
            tuple(palette),
            tuple(whole_numbers(sequence, "sequence", len(sequence), 0, len(palette) - 1)),
            origin=number(required(spec, "origin"), "origin"),
            pitch=positive(required(spec, "pitch"), "pitch"),
            width=positive(required(spec, "width"), "width"),
        )
    except InputError as error:
        raise InputError(f"{name}: {error}") from error
