"""Old parts of a log, compressed: FIRST-LAST.jsonl.gz in a folder beside it, named by the IDs of what is in them.

Every line is a gzip member of its own: `zcat` shows the part, and a damaged byte costs one line and no more.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from retrue.errors import FileError
from retrue.files.atomic import read_bytes, replaced_file, sync_folder
from retrue.files.log_lines import LogRecord, records_of_line

LARGEST_PART = 64 * 2**20  # bytes, compressed
LONGEST_LINE = 8 * 2**20  # bytes
NAME = re.compile(r"([0-9]{9,18})-([0-9]{9,18})(?:\.[0-9]+)?\.jsonl\.gz")
GZIP = 31  # zlib's word for a gzip member with the largest window
CHUNK = 2**11  # bytes that are expanded at a time
MAGIC = b"\x1f\x8b\x08"


@dataclass(frozen=True, slots=True, order=True)
class LogPart:
    """A part by the IDs of its first and last entry."""

    first: int
    last: int
    path: Path


def parts_of(folder: Path) -> list[LogPart]:
    """All parts, oldest first; none where there is no folder. Raises `FileError` where it cannot be read."""
    try:
        names = [(path, NAME.fullmatch(path.name)) for path in folder.iterdir()] if folder.is_dir() else []
    except OSError as error:
        raise FileError(folder, f"cannot be read: {error.strerror or error}") from error
    return sorted(LogPart(int(name[1]), int(name[2]), path) for path, name in names if name is not None)


def write_part(folder: Path, first: int, last: int, lines: Sequence[bytes]) -> None:
    """A new part, whole or not at all; no part is ever written over. Raises `FileError`."""
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise FileError(folder, f"cannot be made a folder: {error.strerror or error}") from error
    sync_folder(folder.parent)
    name, number = f"{first:09}-{last:09}", 1
    path = folder / f"{name}.jsonl.gz"
    while path.exists():
        number += 1
        path = folder / f"{name}.{number}.jsonl.gz"
    with replaced_file(path, alone=True) as stream:
        for line in lines:
            member = zlib.compressobj(wbits=GZIP)
            stream.write(member.compress(line + b"\n") + member.flush())


def records_of_part(path: Path) -> Iterator[LogRecord]:
    """What a part says, newest first, damaged members in their places; a part that does not open is one damage."""
    try:
        content = read_bytes(path, LARGEST_PART)
    except FileError as error:
        yield LogRecord(path, "all of it", None, error.problem)
        return
    for begin, end, line in reversed(list(_members(content))):
        place = f"bytes {begin} to {end}"
        if line is None:
            yield LogRecord(path, place, None, "expected compressed lines, found other bytes")
        else:
            yield from records_of_line(path, place, line)


def lines_of_part(path: Path) -> list[bytes]:
    """The lines as they were written, but for those that are damaged."""
    return [line for _, _, line in _members(read_bytes(path, LARGEST_PART)) if line is not None]


def _members(content: bytes) -> Iterator[tuple[int, int, bytes | None]]:
    """Where each member begins and ends, and its line; None for what lies between two that are whole."""
    damaged = begin = 0
    while 0 <= begin < len(content):
        line, end = _member(content, begin)
        if line is None:
            begin = content.find(MAGIC, begin + 1)
            continue
        if damaged < begin:
            yield damaged, begin, None
        yield begin, end, line
        damaged = begin = end
    if damaged < len(content):
        yield damaged, len(content), None


def _member(content: bytes, begin: int) -> tuple[bytes | None, int]:
    """The line in the member that begins there, and where that ends; None where it is damaged."""
    member, line, end = zlib.decompressobj(wbits=GZIP), b"", begin
    try:
        while not member.eof and end < len(content) and len(line) <= LONGEST_LINE:
            line += member.decompress(content[end : end + CHUNK])
            end += CHUNK
    except zlib.error:
        return None, begin
    if not member.eof:
        return None, begin
    return line.removesuffix(b"\n"), min(end, len(content)) - len(member.unused_data)
