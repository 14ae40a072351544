"""A file of JSON lines that only grows, and its older parts; nothing that happens to a byte of it closes it.

Beside NAME.jsonl lies the folder NAME with what was in it before: parts that are compressed and never touched again.
A line that is damaged stays where it is: it is told, passed over, and written on behind.
"""

from __future__ import annotations

import io
import os
import stat
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import islice, takewhile
from pathlib import Path
from typing import Any

from retrue.errors import FileError
from retrue.files.atomic import sync_folder
from retrue.files.file_lock import held_file, not_waiting
from retrue.files.log_lines import LogRecord, line_of, records_of_lines
from retrue.files.log_parts import LogPart, lines_of_part, parts_of, records_of_part, write_part

LARGEST_LOG = 64 * 2**20  # bytes of the file that grows
FULL_LOG = 4 * 2**20  # bytes after which it becomes a part; some thousand rigs
TAIL = 2**13  # bytes at the end, or more, that tell how to go on
RECENT = 3  # whole records in it
LARGEST_ID = 10**15


@dataclass(frozen=True, slots=True)
class AppendLog:
    """The log, held alone: its last lines, and the open file to write more.

    Attributes
    ----------
    recent : records of the last lines, newest first.
    next_id : above all that were given out.
    """

    path: Path
    recent: Sequence[LogRecord]
    next_id: int
    stream: io.FileIO

    @contextmanager
    def appended(self, documents: Sequence[Mapping[str, Any]]) -> Generator[None]:
        """With these lines on the disk for good; they are taken back when the block fails."""
        lines = b"".join(map(line_of, documents))
        end = self.stream.seek(0, os.SEEK_END)
        try:
            _write_all(self.stream, lines)
            os.fsync(self.stream.fileno())
            yield
        except OSError as error:
            self.stream.truncate(end)
            raise FileError(self.path, f"cannot be written: {error.strerror or error}") from error
        except Exception:
            self.stream.truncate(end)
            raise


def parts_folder(path: Path) -> Path:
    """Where the older parts of a log lie."""
    return path.with_suffix("")


def newest_first(path: Path, holding: int | None = None) -> Iterator[LogRecord]:
    """All records of the log and its parts, or but of those that may hold an ID; a part is opened when its turn comes.

    Nothing where there is no log. Raises `FileError` where it is no file, or cannot be read at all.
    """
    parts, content = _unchanging(path)
    yield from records_of_lines(path, content)
    for part in reversed(parts):
        if holding is None or part.first <= holding <= part.last:
            yield from records_of_part(part.path)


@contextmanager
def opened_log(path: Path) -> Generator[AppendLog]:
    """The log, held alone, made where it is not there yet; a full one becomes a part first.

    Raises `FileError` where it cannot be opened for writing, or stays in use by others.
    """
    with held_file(path) as stream:
        try:
            size = _size(path, stream)
            if size == 0:
                sync_folder(path.parent)
            recent = _recent(path, stream)
            if size >= FULL_LOG:
                _make_part(path, stream)
            newest = parts_of(parts_folder(path))[-1:] if not _ids(recent) else []
            recent += [record for part in newest for record in islice(records_of_part(part.path), RECENT)]
            last = max([*_ids(recent), *(part.last for part in newest)], default=0)
            next_id = last + 1 + _damaged_at_end(recent)
        except OSError as error:
            raise FileError(path, f"cannot be read: {error.strerror or error}") from error
        try:
            yield AppendLog(path, recent, next_id, stream)
        finally:
            if not recent and stream.seek(0, os.SEEK_END) == 0:
                with suppress(OSError):  # Windows keeps a file that is open
                    path.unlink()


def _recent(path: Path, stream: io.FileIO) -> list[LogRecord]:
    """Records at the end, `RECENT` whole ones where there are so many; a line that was left open is ended."""
    size, length = stream.seek(0, os.SEEK_END), TAIL
    while True:
        stream.seek(max(0, size - length))
        content = stream.read(length) or b""
        if size > length:  # the first line is cut: no record of ours
            content = content.partition(b"\n")[2]
        records = list(records_of_lines(path, content))
        if length >= size or sum(record.document is not None for record in records) >= RECENT:
            break
        length *= 4
    if content and not content.endswith(b"\n"):
        _write_all(stream, b"\n")
    return records


def _ids(records: Iterable[LogRecord]) -> list[int]:
    numbers = (record.document.get("id") for record in records if record.document is not None)
    return [number for number in numbers if type(number) is int and 0 < number <= LARGEST_ID]


def _damaged_at_end(records: Sequence[LogRecord]) -> int:
    """So many may have been given an ID after the last that can be read."""
    return sum(1 for _ in takewhile(lambda record: record.document is None, records))


def _make_part(path: Path, stream: io.FileIO) -> None:
    """Move what the file holds into a part; killed in between, it stands in both, and is read once."""
    content = _content(path, stream)
    known = _ids(records_of_lines(path, content))
    if not known:
        return
    folder = parts_folder(path)
    if not _holds(parts_of(folder)[-1:], content):
        write_part(folder, min(known), max(known), [line for line in content.split(b"\n") if line])
    stream.truncate(0)
    os.fsync(stream.fileno())


def _unchanging(path: Path) -> tuple[list[LogPart], bytes]:
    """Parts and content of one moment, though somebody may be moving the one into the other."""
    folder = parts_folder(path)
    parts = parts_of(folder)
    while True:
        content = _read(path)
        now = parts_of(folder)
        if now == parts:
            return parts, b"" if _holds(parts[-1:], content) else content
        parts = now


def _holds(newest: Sequence[LogPart], content: bytes) -> bool:
    """Whether the newest part is what the file holds too: whoever moved it was killed, or is about to end."""
    if not newest or len(content) < FULL_LOG:
        return False
    try:
        return lines_of_part(newest[0].path) == [line for line in content.split(b"\n") if line]
    except FileError:
        return False


def _read(path: Path) -> bytes:
    try:
        if not path.exists():
            return b""
        with io.FileIO(path, "rb", opener=not_waiting) as stream:
            return _content(path, stream)
    except FileNotFoundError:
        return b""
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from error


def _content(path: Path, stream: io.FileIO) -> bytes:
    _size(path, stream)
    stream.seek(0)
    return stream.readall()


def _size(path: Path, stream: io.FileIO) -> int:
    status = os.fstat(stream.fileno())
    if not stat.S_ISREG(status.st_mode):
        raise FileError(path, "expected a file, found something else")
    if status.st_size > LARGEST_LOG:
        raise FileError(
            path, f"expected at most {LARGEST_LOG} bytes, found {status.st_size}; move it away to begin anew"
        )
    return status.st_size


def _write_all(stream: io.FileIO, content: bytes) -> None:
    while content:
        content = content[stream.write(content) :]
