"""What is known of one rig that is watched, from what its events said."""

from __future__ import annotations

import contextlib
from collections import deque
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from retrue.errors import FileError
from retrue.units import METRES
from retrue.watch.events import Event, last_events
from retrue.watch.state import read_counts

REMEMBERED = 500  # frames of each rig that are drawn


class LastFrames:
    """Time, drift in mm and temperature of the last frames; NaN where unknown. Its memory is taken at once."""

    def __init__(self) -> None:
        self._rows = np.full((REMEMBERED, 3), np.nan)
        self._seen = 0

    def append(self, time: str, drift: float | None, temperature: float | None) -> None:
        """One frame; the oldest gives way."""
        values = (np.nan if value is None else value for value in (drift, temperature))
        self._rows[self._seen % REMEMBERED] = (datetime.fromisoformat(time).timestamp(), *values)
        self._seen += 1

    def curves(self) -> tuple[list[list[Any]], list[list[Any]]]:
        """[time, mm] and [time, temperature], the oldest first; None where unknown."""
        rows = np.roll(self._rows, -self._seen, axis=0)[max(0, REMEMBERED - self._seen) :]
        times = [datetime.fromtimestamp(time, UTC).isoformat(timespec="milliseconds") for time in rows[:, 0]]
        drift, warmth = (
            [[time, float(value) if np.isfinite(value) else None] for time, value in zip(times, column, strict=True)]
            for column in rows[:, 1:].T
        )
        return drift, warmth


@dataclass(slots=True)
class RigStatus:
    """What events said of one rig."""

    state: str = "starting"
    verdict: str = ""
    reason: str = ""
    frames: int = 0
    bad: int = 0
    recalibrated: int = 0
    refused: int = 0
    temperature: float | None = None
    last: str = ""
    drawn: LastFrames = field(default_factory=LastFrames)
    changes: deque[tuple[str, str]] = field(default_factory=lambda: deque(maxlen=20))

    def observe(self, event: Event) -> None:
        """One event. One that is none raises AttributeError, KeyError, TypeError or ValueError, and changes nothing."""
        datetime.fromisoformat(event["time"])
        match event["event"]:
            case "frame":
                warm = event.get("temperature")
                warm = None if warm is None or not np.isfinite(warm) else float(warm)
                self.drawn.append(event["time"], self._millimetres(event), warm)
                self.state, self.verdict, self.reason = "watching", str(event["verdict"]), str(event["reason"])
                self.frames, self.temperature = self.frames + 1, warm
            case "bad frame":
                self.frames, self.bad, self.reason = self.frames + 1, self.bad + 1, str(event["reason"])
            case "recalibrated":
                self.recalibrated += 1
                self.changes.append((event["time"], str(event["kind"])))
            case "refused":
                self.refused, self.reason = self.refused + 1, str(event["reason"])
            case "failed":
                self.state, self.reason = "failed", str(event["reason"])
            case "stopped":
                self.state = "stopped" if self.state != "failed" else "failed"
            case _:
                pass
        self.last = event["time"]

    def document(self) -> dict[str, Any]:
        """As plain JSON values."""
        drift, temperatures = self.drawn.curves()
        return {
            "state": self.state,
            "verdict": self.verdict,
            "reason": self.reason,
            "frames": self.frames,
            "bad": self.bad,
            "recalibrated": self.recalibrated,
            "refused": self.refused,
            "temperature": self.temperature,
            "last": self.last,
            "drift_mm": drift,
            "temperatures": temperatures,
            "changes": [list(change) for change in self.changes],
        }

    @staticmethod
    def _millimetres(event: Event) -> float | None:
        off = None if event["drift"] is None else event["drift"].get("displacement")
        unit = str(event.get("unit", "")).strip().lower()
        return off * (METRES[unit] / METRES["mm"]) if off is not None and unit in METRES else None


def read_status(folder: Path) -> RigStatus:
    """What a watch has left in its folder; a file that does not read says nothing."""
    status = RigStatus()
    for event in last_events(folder / "events.jsonl"):
        with contextlib.suppress(AttributeError, KeyError, TypeError, ValueError):  # written by hand, or by another
            status.observe(event)
    with contextlib.suppress(FileError):
        counts = read_counts(folder / "state.json")
        status.frames, status.bad = counts.frames, counts.bad
        status.recalibrated, status.refused = counts.recalibrated, counts.refused
    return status


def read_fleet_status(out: Path) -> dict[str, dict[str, Any]]:
    """Of each rig that has a folder in what a fleet writes, by name, as plain JSON values."""
    folders = sorted(log.parent for log in out.glob("*/events.jsonl"))
    return {folder.name: read_status(folder).document() for folder in folders}
