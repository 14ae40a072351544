"""One line of a log: a JSON object that ends in a checksum of itself; and what is whole in lines that are damaged."""

from __future__ import annotations

import json
import re
import zlib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from retrue.errors import FileError, InputError
from retrue.files.json_values import parse_json

START = b'{"id": '  # of every line, so that one is found again where the end of the line before it is damaged
CHECKSUM = re.compile(rb', "crc32": "([0-9a-f]{8})"\}')
SUMMED = len(', "crc32": "01234567"}')
MOST_STARTS = 64  # tried for one checksum; a START may stand within an entry too, but not often


@dataclass(frozen=True, slots=True)
class LogRecord:
    """A line of a log; one that is damaged has no document, and stays where it is.

    Attributes
    ----------
    path, place : the file, and where in it: "line 3", "bytes 1200 to 1460".
    problem : what was expected and found, where it is damaged.
    """

    path: Path
    place: str
    document: Mapping[str, Any] | None
    problem: str = ""


def line_of(document: Mapping[str, Any]) -> bytes:
    """The document (first key: id) as a line. Raises `InputError` for what JSON cannot hold."""
    try:
        text = json.dumps(document, allow_nan=False).encode()[:-1]
    except (TypeError, ValueError, RecursionError) as error:
        raise InputError(f"evidence: expected plain, finite JSON values, found: {error}") from error
    return text + b', "crc32": "%08x"}\n' % zlib.crc32(text)


def records_of_lines(path: Path, content: bytes) -> Iterator[LogRecord]:
    """What the lines of a file say, newest first, damaged ones in their places."""
    lines = content.split(b"\n")
    for number in range(len(lines), 0, -1):
        yield from records_of_line(path, f"line {number}", lines[number - 1])


def documents_of_lines(path: Path, content: bytes) -> list[dict[str, Any]]:
    """The same without what is damaged, oldest first; where all is as it was written, read at once, and sooner."""
    lines = [line for line in content.split(b"\n") if line]
    if all(line.endswith(b', "crc32": "%08x"}' % zlib.crc32(line[:-SUMMED])) for line in lines):
        with suppress(ValueError, RecursionError):
            return json.loads(b"[%s]" % b",".join(lines))
    records = list(records_of_lines(path, content))
    return [dict(record.document) for record in reversed(records) if record.document is not None]


def records_of_line(path: Path, place: str, line: bytes) -> Iterator[LogRecord]:
    """One record; of a damaged line as many as are whole in it, newest first, and one that tells of the damage."""
    if not line.strip():
        return
    try:
        yield LogRecord(path, place, _document(path, line))
    except FileError as error:
        for document in reversed(list(_whole_within(path, line))):
            yield LogRecord(path, place, document)
        yield LogRecord(path, place, None, error.problem)


def _document(path: Path, text: bytes) -> dict[str, Any]:
    """A whole object, its checksum compared and left out; lines of old have none."""
    try:
        document = parse_json(path, text.decode())
    except UnicodeDecodeError as error:
        raise FileError(path, "expected text (UTF-8), found other bytes") from error
    if "crc32" in document:
        found = CHECKSUM.search(text, max(0, len(text) - 40))
        if found is None or int(found[1], 16) != zlib.crc32(text[: found.start()]):
            raise FileError(path, "expected what its checksum says, found something else: damaged, or edited by hand")
        del document["crc32"]
    return document


def _whole_within(path: Path, line: bytes) -> Iterator[dict[str, Any]]:
    """Objects that a damaged line still holds: of two lines whose end of line is lost, both."""
    begin = 0
    for checksum in CHECKSUM.finditer(line):
        start = line.find(START, begin, checksum.start())
        for _ in range(MOST_STARTS):
            if start < 0:
                break
            if int(checksum[1], 16) == zlib.crc32(line[start : checksum.start()]):
                try:
                    yield _document(path, line[start : checksum.end()])
                except FileError:
                    break
                break
            start = line.find(START, start + 1, checksum.start())
        begin = checksum.end()
