"""A file of JSON lines that only grows. A line counts when its end is there; a half-written last one never did."""

from __future__ import annotations

import io
import json
import os
import stat
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from retrue.errors import FileError, InputError
from retrue.files.atomic import sync_folder
from retrue.files.file_lock import held_file
from retrue.files.rig_json import parse_json

LARGEST_LOG = 64 * 2**20  # bytes; tens of thousands of rigs


@dataclass(frozen=True, slots=True)
class AppendLog:
    """The log, held alone: what it says, and the open file to say more."""

    path: Path
    documents: Sequence[Mapping[str, Any]]
    stream: io.FileIO

    @contextmanager
    def appended(self, documents: Sequence[Mapping[str, Any]]) -> Generator[None]:
        """With these lines on the disk for good; they are taken back when the block fails."""
        try:
            lines = "".join(json.dumps(document, allow_nan=False) + "\n" for document in documents).encode()
        except (TypeError, ValueError, RecursionError) as error:
            raise InputError(f"evidence: expected plain, finite JSON values, found: {error}") from error
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


def read_log(path: Path) -> list[dict[str, Any]]:
    """What the log says; nothing where there is none. A line that is being written just now is not there yet."""
    try:
        with path.open("rb", buffering=0) as stream:
            documents, _ = _complete_lines(path, _content(path, stream))
    except FileNotFoundError:
        return []
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from error
    return documents


@contextmanager
def opened_log(path: Path) -> Generator[AppendLog]:
    """The log, held alone, made where it is not there yet and freed of what a crash left at its end.

    Raises `FileError` where it cannot be opened for writing, or stays in use by others.
    """
    with held_file(path) as stream:
        sync_folder(path.parent)
        try:
            content = _content(path, stream)
            documents, end = _complete_lines(path, content)
            if end < len(content):
                stream.truncate(end)
            elif content and not content.endswith(b"\n"):
                _write_all(stream, b"\n")
        except OSError as error:
            raise FileError(path, f"cannot be repaired: {error.strerror or error}") from error
        try:
            yield AppendLog(path, documents, stream)
        finally:
            if not documents and stream.seek(0, os.SEEK_END) == 0:
                with suppress(OSError):  # Windows keeps a file that is open
                    path.unlink()


def _content(path: Path, stream: io.FileIO) -> bytes:
    status = os.fstat(stream.fileno())
    if not stat.S_ISREG(status.st_mode):
        raise FileError(path, "expected a file, found something else")
    if status.st_size > LARGEST_LOG:
        raise FileError(
            path, f"expected at most {LARGEST_LOG} bytes, found {status.st_size}; move it away to begin anew"
        )
    stream.seek(0)
    return stream.readall()


def _complete_lines(path: Path, content: bytes) -> tuple[list[dict[str, Any]], int]:
    """What the lines say, and where the last one that says something ends."""
    *lines, rest = content.split(b"\n")
    documents = [_parsed(path, number, line) for number, line in enumerate(lines, start=1)]
    end = len(content) - len(rest)
    if rest:
        with suppress(FileError):
            documents.append(_parsed(path, len(lines) + 1, rest))
            end = len(content)
    return documents, end


def _parsed(path: Path, number: int, line: bytes) -> dict[str, Any]:
    try:
        return parse_json(path, line.decode())
    except (FileError, UnicodeDecodeError) as error:
        problem = error.problem if isinstance(error, FileError) else "expected text (UTF-8), found other bytes"
        raise FileError(path, f"line {number}: {problem}") from error


def _write_all(stream: io.FileIO, content: bytes) -> None:
    while content:
        content = content[stream.write(content) :]
