"""The temperature beside a rig, from a table that somebody else writes."""

from __future__ import annotations

import math
from contextlib import suppress
from pathlib import Path

TAIL = 4096  # bytes that hold the last lines


def last_reading(path: Path | None) -> float | None:
    """The last number of the last whole line of a table: `2026-11-27T08:00:00,21.4`; None where there is none."""
    if path is None:
        return None
    try:
        if not path.is_file():
            return None
        with path.open("rb") as stream:
            stream.seek(max(0, stream.seek(0, 2) - TAIL))
            lines = stream.read(TAIL).split(b"\n")[:-1]
    except OSError:
        return None
    for line in reversed(lines):
        with suppress(ValueError):
            value = float(line.replace(b";", b",").rpartition(b",")[2])
            if math.isfinite(value):
                return value
    return None
