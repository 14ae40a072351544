"""What a watch has to say, one JSON object a line, and who hears it."""

from __future__ import annotations

import json
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, cast

from retrue.errors import FileError
from retrue.files.atomic import read_tail
from retrue.plain_json import plain

Event = Mapping[str, Any]
Listener = Callable[[Event], None]
TAIL = 2**20  # bytes of a log that hold its last events


class EventLog:
    """Appends events to a file as they happen, and tells the listeners; it keeps none of them."""

    def __init__(self, path: Path, listeners: Sequence[Listener] = ()) -> None:
        self._path = path
        self._listeners = tuple(listeners)
        try:
            self._stream = path.open("ab+", buffering=0)
            if self._stream.seek(0, 2) > 0:
                self._stream.seek(-1, 2)
                if self._stream.read(1) != b"\n":  # a line that a kill left torn stays alone
                    self._stream.write(b"\n")
        except OSError as error:
            raise FileError(path, f"cannot be written: {error.strerror or error}") from error

    def write(self, event: str, **values: Any) -> dict[str, Any]:
        """One event, with the time; returns it. Raises FileError where the file cannot take it."""
        time = datetime.now(UTC).isoformat(timespec="milliseconds")
        record: dict[str, Any] = {"time": time, "event": event, **plain(values)}
        try:
            self._stream.write(json.dumps(record, allow_nan=False).encode() + b"\n")
        except OSError as error:
            raise FileError(self._path, f"cannot be written: {error.strerror or error}") from error
        for listener in self._listeners:
            listener(record)
        return record

    def close(self) -> None:
        """No more events."""
        self._stream.close()


def last_events(path: Path) -> Generator[Event]:
    """Of a log, the oldest first; lines that do not read are passed over, and a log that does not read has none."""
    try:
        lines = read_tail(path, TAIL)
    except OSError:
        return
    for line in lines:
        with suppress(ValueError, RecursionError):  # the first may be cut
            event = json.loads(line)
            if isinstance(event, dict) and {"time", "event"} <= event.keys():
                yield cast("dict[str, Any]", event)
