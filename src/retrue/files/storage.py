"""OpenCV's FileStorage, read and written as text: YAML, XML and JSON, matrices and numbers only.

An own small reader, because files come from strangers: nothing is executed, no tag is resolved, no
entity expanded, and an entry that nobody asks for is not even interpreted. It takes what OpenCV 2 to 5
write (`%YAML:1.0` and `%YAML 1.2`, `opencv-matrix` and OpenCV 5's `opencv-nd-matrix`), and the plain
YAML of ROS, which has the same shape.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, cast
from xml.etree import ElementTree

import numpy as np

from retrue.errors import FileError
from retrue.files.json_values import parse_json
from retrue.geometry.arrays import FloatArray

Syntax = Literal["yaml", "xml", "json"]
Value = FloatArray | float | int | str

NUMBER = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?")
MOST_SIDES = 8  # of a matrix
LARGEST_MATRIX = 10_000  # numbers; a rig has no matrix of more than 12


@dataclass(frozen=True, slots=True)
class Entry:
    """One top-level entry, as text: words, and the shape that the file claims for them (None: not a matrix)."""

    words: tuple[str, ...]
    shape: tuple[int, ...] | None = None


@dataclass(frozen=True, slots=True)
class Storage:
    """The entries of a file by name; a `FileError` from here names the file and the entry."""

    path: Path
    entries: Mapping[str, Entry]

    def __contains__(self, name: str) -> bool:
        return name in self.entries

    def numbers(self, name: str) -> FloatArray:
        """All numbers of an entry, flat, row by row."""
        if name not in self.entries:
            raise FileError(self.path, f"{name}: expected this entry, found none")
        entry = self.entries[name]
        if len(entry.words) > LARGEST_MATRIX:
            raise FileError(self.path, f"{name}: expected a small matrix, found {len(entry.words)} numbers")
        for word in entry.words:
            if not NUMBER.fullmatch(word):
                raise FileError(self.path, f"{name}: expected finite numbers, found {word[:40]!r}")
        numbers = np.array([float(word) for word in entry.words], dtype=np.float64)
        if not np.isfinite(numbers).all():
            raise FileError(self.path, f"{name}: expected finite numbers, found infinity")
        if entry.shape is not None and int(np.prod(np.array(entry.shape, dtype=object))) != numbers.size:
            shape = " x ".join(map(str, entry.shape))
            raise FileError(self.path, f"{name}: expected {shape} numbers, found {numbers.size}")
        return numbers

    def matrix(self, name: str, rows: int, columns: int) -> FloatArray:
        """An entry that must have that shape."""
        numbers = self.numbers(name)
        shape = self.entries[name].shape
        if numbers.size != rows * columns or (shape is not None and shape != (rows, columns)):
            found = " x ".join(map(str, shape if shape is not None else numbers.shape))
            raise FileError(self.path, f"{name}: expected a matrix of {rows} x {columns}, found {found}")
        return numbers.reshape(rows, columns)

    def vector(self, name: str, length: int) -> FloatArray:
        """An entry of that many numbers, lying or standing."""
        numbers = self.numbers(name)
        if numbers.size != length:
            raise FileError(self.path, f"{name}: expected {length} numbers, found {numbers.size}")
        return numbers

    def text(self, name: str) -> str:
        """An entry that is a word."""
        if name not in self.entries:
            raise FileError(self.path, f"{name}: expected this entry, found none")
        return " ".join(self.entries[name].words).strip("\"'")


def parse_storage(path: Path, text: str) -> Storage:
    """The entries of a FileStorage file, whichever syntax `text` is in."""
    start = text.lstrip()[:1]
    if start == "<":
        nodes = _xml_nodes(path, text)
    elif start == "{":
        nodes = _json_nodes(parse_json(path, text))
    else:
        nodes = _yaml_nodes(text)
    entries: dict[str, Entry] = {}
    for name, fields in nodes:
        entry = Entry(fields["data"], _shape(fields))
        entries[name] = entry if entries.get(name, entry) == entry else CONTRADICTION
    return Storage(path, entries)


# Reading: every syntax gives entries of the same shape, by the fields of OpenCV's matrices; a plain value is `data`.

Fields = Mapping[str, tuple[str, ...]]
Node = tuple[str, Fields]
CONTRADICTION = Entry(("two different entries of this name",))
YAML_KEY = re.compile(r"""^["']?([A-Za-z_][\w.-]*)["']?[ \t]*:(?=[ \t\r]|$)""")
YAML_FIELD = re.compile(r"^[ \t]*(rows|cols|sizes|dt|data)[ \t]*:", re.MULTILINE)


def _yaml_nodes(text: str) -> Iterator[Node]:
    name, block = "", list[str]()
    for line in [*text.splitlines(), "end:"]:
        if line.startswith(("%", "#", "---", "...")):
            continue
        if key := YAML_KEY.match(line):
            if name:
                yield name, _yaml_fields("\n".join(block))
            name, block, line = key[1], [], line[key.end() :]
        block.append(line)


def _yaml_fields(block: str) -> Fields:
    pieces = YAML_FIELD.split(block)
    fields = {name: _words(value) for name, value in zip(pieces[1::2], pieces[2::2], strict=True)}
    return fields if "data" in fields else {"data": _words(block)}


def _xml_nodes(path: Path, text: str) -> Iterator[Node]:
    if re.search(r"<!(?!--)", text):
        raise FileError(path, "expected OpenCV's XML, found a declaration (<!...); such files are not read")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError, RecursionError) as error:
        raise FileError(path, f"expected XML, found {error}") from error
    for element in root:
        fields = {child.tag: _words(child.text or "") for child in element}
        yield element.tag, fields if "data" in fields else {"data": _words(element.text or "")}


def _json_nodes(document: Mapping[str, Any]) -> Iterator[Node]:
    for name, value in document.items():
        fields: dict[str, Any] = {"data": value}
        if isinstance(value, dict) and "data" in value:
            fields = cast(dict[str, Any], value)
        yield name, {key: _json_words(item) for key, item in fields.items()}


def _json_words(value: Any, depth: int = 0) -> tuple[str, ...]:
    if isinstance(value, list) and depth < 2:
        return tuple(word for item in cast(list[Any], value) for word in _json_words(item, depth + 1))
    return (str(value),) if isinstance(value, int | float | str) else ("null",)


def _words(text: str) -> tuple[str, ...]:
    """The words of a flow list, a block list, a scalar or an XML text."""
    text = re.sub(r"(^|\s)#.*|!![\w-]+", " ", text)
    text = re.sub(r"^[ \t]*-[ \t]+", " ", text, flags=re.MULTILINE)
    return tuple(re.sub(r"[\[\],]", " ", text).split())


def _shape(fields: Fields) -> tuple[int, ...] | None:
    sides = [word for name in ("rows", "cols", "sizes") for word in fields.get(name, ())]
    if len(sides) > MOST_SIDES or not all(re.fullmatch(r"[0-9]{1,9}", side) for side in sides):
        return (-1,)  # fits no matrix
    return tuple(int(side) for side in sides) or None


# Writing: every syntax is a layout, of the file, of a plain value and of a matrix.


@dataclass(frozen=True, slots=True)
class Layout:
    """Templates, and what stands between two entries, between two numbers, and around a word."""

    file: str
    value: str
    matrix: str
    between: str
    comma: str
    quote: str


LAYOUTS: dict[Syntax, Layout] = {
    "yaml": Layout(
        "%YAML:1.0\n---\n{entries}",
        "{name}: {value}\n",
        "{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n   data: [ {data} ]\n",
        between="",
        comma=", ",
        quote="",
    ),
    "xml": Layout(
        '<?xml version="1.0"?>\n<opencv_storage>\n{entries}</opencv_storage>\n',
        "<{name}>{value}</{name}>\n",
        '<{name} type_id="opencv-matrix">\n  <rows>{rows}</rows>\n  <cols>{cols}</cols>\n  <dt>d</dt>\n'
        "  <data>\n    {data}</data></{name}>\n",
        between="",
        comma=" ",
        quote="",
    ),
    "json": Layout(
        "{{\n{entries}\n}}\n",
        '    "{name}": {value}',
        '    "{name}": {{\n        "type_id": "opencv-matrix", "rows": {rows}, "cols": {cols}, "dt": "d",\n'
        '        "data": [ {data} ]\n    }}',
        between=",\n",
        comma=", ",
        quote='"',
    ),
}


def storage_text(entries: Mapping[str, Value], syntax: Syntax) -> str:
    """The file that OpenCV's FileStorage reads back: seventeen digits, so that no bit is lost."""
    layout = LAYOUTS[syntax]
    return layout.file.format(entries=layout.between.join(_entry(layout, *item) for item in entries.items()))


def _entry(layout: Layout, name: str, value: Value) -> str:
    if isinstance(value, np.ndarray):
        rows, cols = (len(value), 1) if value.ndim == 1 else value.shape
        data = layout.comma.join(map(_digits, value.ravel().tolist()))
        return layout.matrix.format(name=name, rows=rows, cols=cols, data=data)
    if isinstance(value, str):
        value = f"{layout.quote}{value}{layout.quote}"
    return layout.value.format(name=name, value=_digits(value) if isinstance(value, float) else value)


def _digits(number: float) -> str:
    digits = f"{number:.17g}"
    return digits if any(mark in digits for mark in ".e") else f"{digits}.0"
