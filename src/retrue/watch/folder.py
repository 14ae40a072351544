"""A folder that pictures (or points CSVs) drop into, in the order in which they arrive."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

from retrue.correspondences import Correspondences
from retrue.errors import FileError, RetrueError
from retrue.files.history import capture_record
from retrue.files.images import SUFFIXES, read_image
from retrue.files.points import read_points
from retrue.geometry.arrays import Image
from retrue.watch.frame import Frame, Position
from retrue.watch.options import WatchOptions
from retrue.watch.temperature import temperature_beside

READ = SUFFIXES | {".csv"}
RETRY_SECONDS = 1.0  # between two tries to read a file that cannot be read yet

# When the file last changed on this disk, and its name. Unlike its date of modification, that moment cannot be
# set by whoever copies the file, so nothing that arrives later comes before what is done.
_Arrival = tuple[int, str]


@dataclass(slots=True)
class _Waiting:
    """A file that is new: how it looked last, since when (monotonic), and when to try reading it."""

    arrival: _Arrival
    size: int
    since: float
    try_at: float


@dataclass(slots=True)
class FolderSource:
    """Polls a folder. What it remembers is only the last arrival that is done, and files that are not done yet.

    A file counts as whole when it has not changed for `settle_seconds` and reads; one that never does is handed
    over as a frame with a problem after `patience_seconds`. Other files do not wait for it, nor it for them. Files
    of other `suffixes` are none.
    """

    folder: Path
    options: WatchOptions
    position: Position = field(default_factory=dict[str, Any])
    live: bool = False
    suffixes: frozenset[str] = READ
    _done: _Arrival = (0, "")
    _waiting: dict[str, _Waiting] = field(default_factory=dict[str, _Waiting])
    _failed: dict[str, _Waiting] = field(default_factory=dict[str, _Waiting])

    def frames(self, stop: threading.Event) -> Iterator[Frame]:
        """Every file once, oldest arrival first."""
        self._restore()
        idle_since = time.monotonic()
        while not stop.is_set():
            for name, waiting in self._ready():
                for late, again in [item for item in self._failed.items() if item[1].try_at <= time.monotonic()]:
                    yield from self._frames_of(late, again)
                if name in self._waiting:
                    yield from self._frames_of(name, waiting)
                if stop.is_set():
                    return
                idle_since = time.monotonic()
            idle = time.monotonic() - idle_since
            if self.options.idle_seconds is not None and not self._waiting and idle >= self.options.idle_seconds:
                return
            stop.wait(self.options.poll_seconds)

    def _frames_of(self, name: str, waiting: _Waiting) -> Iterator[Frame]:
        """The file, where it can be read, or never will."""
        self._failed.pop(name, None)
        frame = self._frame(name, waiting)
        if frame is not None:
            yield frame
        elif name in self._waiting:
            self._failed[name] = waiting

    def _restore(self) -> None:
        if not self.position:
            return
        try:
            moment, name = self.position["after"]
            self._done = (int(moment), str(name))
            names = [str(item) for item in cast(list[Any], self.position["waiting"])]
        except (KeyError, TypeError, ValueError) as error:
            raise FileError(self.folder, f"the saved position is none of a folder: {error}") from error
        unseen = _Waiting((-1, ""), -1, 0.0, 0.0)
        self._waiting = dict.fromkeys(names, unseen)

    def _ready(self) -> list[tuple[str, _Waiting]]:
        """New files that have settled, oldest arrival first."""
        now = time.monotonic()
        present: dict[str, _Waiting] = {}
        for name, arrival, size in _listing(self.folder, self.suffixes):
            known = self._waiting.get(name)
            if known is None and arrival <= self._done:
                continue
            if known is None or (known.arrival, known.size) != (arrival, size):
                known = _Waiting(arrival, size, now, now + self.options.settle_seconds)
            present[name] = known
        self._waiting = present
        self._failed = {name: item for name, item in self._failed.items() if present.get(name) is item}
        ready = [item for item in present.items() if item[1].try_at <= now]
        return sorted(ready, key=lambda item: item[1].arrival)

    def _frame(self, name: str, waiting: _Waiting) -> Frame | None:
        """The file as a frame; None where it may still become readable, or is gone."""
        path = self.folder / name
        content, capture, problem = None, {"name": name}, ""
        try:
            content, capture = _read(path), capture_record(path)
        except (RetrueError, MemoryError) as error:
            if not path.exists():
                del self._waiting[name]
                return None
            now = time.monotonic()
            if now - waiting.since < self.options.patience_seconds:
                waiting.try_at = now + min(RETRY_SECONDS, self.options.patience_seconds)
                return None
            problem = error.problem if isinstance(error, FileError) else f"cannot be read: {error}"
        del self._waiting[name]
        self._done = max(self._done, waiting.arrival)
        behind = [other for other, item in self._waiting.items() if item.arrival <= self._done]
        position = {"after": list(self._done), "waiting": behind}
        return Frame(name, content, position, capture, problem, temperature_beside(path))


def _listing(folder: Path, suffixes: frozenset[str]) -> Iterator[tuple[str, _Arrival, int]]:
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                if entry.name.startswith(".") or Path(entry.name).suffix.lower() not in suffixes:
                    continue
                try:
                    status = entry.stat()
                    if entry.is_file():
                        yield entry.name, (status.st_ctime_ns, entry.name), status.st_size
                except FileNotFoundError:
                    continue  # gone since it was listed
    except OSError as error:
        raise FileError(folder, f"cannot be read as a folder: {error.strerror or error}") from error


def _read(path: Path) -> Image | Correspondences:
    return read_points(path) if path.suffix.lower() == ".csv" else read_image(path)
