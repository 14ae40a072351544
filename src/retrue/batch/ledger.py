"""What a batch has done: a line for each result in results.jsonl, so that it goes on where it was stopped."""

from __future__ import annotations

import os
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from io import FileIO
from pathlib import Path
from stat import S_ISDIR
from typing import Any, cast

from retrue.batch.tasks import lies
from retrue.errors import FileError
from retrue.files.atomic import read_bytes
from retrue.files.file_lock import held_file
from retrue.files.log_lines import documents_of_lines, line_of
from retrue.files.remote import Remote

LARGEST_LEDGER = 2**32  # bytes

KEYS = {"name", "context", "stamp", "files", "result"}

Stamp = list[Any]
"""What tells that a capture is still the same: size, date and place on the disk of each of its files."""


@dataclass(slots=True)
class Ledger:
    """Results by what was asked for and what went in.

    Attributes
    ----------
    known : by name and context; the context is a digest of all that is not the capture itself.
    written : which context wrote each file last, by its place in the folder.
    """

    path: Path
    stream: FileIO
    root: str
    count: int = 0
    known: dict[tuple[str, str], Mapping[str, Any]] = field(default_factory=dict[tuple[str, str], Mapping[str, Any]])
    written: dict[str, str] = field(default_factory=dict[str, str])

    def result(self, name: str, context: str, stamp: Stamp, files: Sequence[Path]) -> Mapping[str, Any] | None:
        """The result, where nothing that went in has changed since, and what it left still lies there."""
        found = self.known.get((name, context))
        if found is None or found["stamp"] != stamp:
            return None
        same = "failed" in found["result"] or all(
            self.written.get(self._place(path)) == context and lies(path) for path in files
        )
        return cast("Mapping[str, Any]", found["result"]) if same else None

    def write(self, name: str, context: str, stamp: Stamp, files: Sequence[Path], result: Mapping[str, Any]) -> None:
        """One more. A power cut may lose the last ones, and then they are done again."""
        self.count += 1
        places = [self._place(path) for path in files]
        entry = {"id": self.count, "name": name, "context": context, "stamp": stamp, "files": places}
        line = line_of(entry | {"result": dict(result)})
        try:
            while line:
                line = line[self.stream.write(line) :]
        except OSError as error:
            raise FileError(self.path, f"cannot be written: {error.strerror or error}") from error
        self.remember(entry | {"result": result})

    def remember(self, entry: Mapping[str, Any]) -> None:
        """A line, as it stands in the file."""
        self.known[entry["name"], entry["context"]] = entry
        for place in entry["files"]:
            self.written[place] = entry["context"]

    def _place(self, path: Path) -> str:
        return path.as_posix().removeprefix(self.root)


@contextmanager
def opened_ledger(folder: Path) -> Generator[Ledger]:
    """The ledger of a folder, held alone. Raises `FileError` where another batch is at work there."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(folder, f"cannot be made a folder: {error.strerror or error}") from error
    path = folder / "results.jsonl"
    with held_file(path, patience=0.0) as stream:
        content = read_bytes(path, LARGEST_LEDGER)
        if content and not content.endswith(b"\n"):  # torn by a kill
            stream.write(b"\n")
        ledger = Ledger(path, stream, f"{folder.as_posix()}/", content.count(b"\n"))
        for document in documents_of_lines(path, content):
            if document.keys() >= KEYS:
                ledger.remember(document)
        yield ledger


def stamp_of(capture: Path | Remote) -> Stamp:
    """Of a folder, of all that lies in it. Raises `FileError` where it is gone."""
    if isinstance(capture, Remote):
        return [capture.stamp]
    try:
        status = os.stat(capture)  # noqa: PTH116 - of thousands, and quicker
        if not S_ISDIR(status.st_mode):
            return _of(status)
        with os.scandir(capture) as entries:
            return sorted([entry.name, *_of(entry.stat())] for entry in entries)
    except OSError as error:
        raise FileError(capture, f"cannot be read: {error.strerror or error}") from error


def _of(status: os.stat_result) -> list[int]:
    return [status.st_size, status.st_mtime_ns, status.st_ino]
