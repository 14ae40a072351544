"""The temperature beside a rig: from a table that somebody else writes, or a file beside each frame."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, cast

from retrue.files.atomic import read_tail

TAIL = 4096  # bytes that hold the last lines
SIDE_FILES = (".json", ".txt", ".csv")
LONGEST_SIDE_FILE = 65_536  # bytes


def last_reading(path: Path | None) -> float | None:
    """The last number of the last whole line of a table: `2026-11-27T08:00:00,21.4`; None where there is none."""
    if path is None:
        return None
    try:
        if not path.is_file():
            return None
        lines = read_tail(path, TAIL)[:-1]
    except OSError:
        return None
    for line in reversed(lines):
        with suppress(ValueError):
            value = float(line.replace(b";", b",").rpartition(b",")[2])
            if math.isfinite(value):
                return value
    return None


def temperature_beside(frame: Path) -> float | None:
    """What a side file says: 0001.json or 0001.txt beside 0001.png."""
    for suffix in SIDE_FILES:
        path = frame.with_suffix(suffix)
        found = None if path == frame else side_temperature(path)
        if found is not None:
            return found
    return None


def side_temperature(path: Path) -> float | None:
    """`{"temperature": 21.4}`, or the last number of a text; None where there is none."""
    try:
        if not path.is_file() or path.stat().st_size > LONGEST_SIDE_FILE:
            return None
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    number: Any = None
    if path.suffix.lower() == ".json":
        with suppress(ValueError):
            values: Any = json.loads(text)
            number = cast("Mapping[str, Any]", values).get("temperature") if isinstance(values, dict) else values
    else:
        number = next(iter(text.replace(",", " ").replace(";", " ").split()[::-1]), None)
    try:
        value = float(number)
    except (TypeError, ValueError):
        return None
    return value if math.isfinite(value) else None
