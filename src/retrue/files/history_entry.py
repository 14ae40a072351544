"""One entry of the history of a rig: as a value, as a line of the log, and what remains of one that is damaged."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any, Literal, cast, get_args, overload

from retrue.errors import FileError
from retrue.files.log_lines import LogRecord
from retrue.files.rig_json import rig_from_json, rig_to_json
from retrue.rig import Rig
from retrue.shown import ShortRepr, Shown
from retrue.values import ByValue

Action = Literal["found", "calibrated", "recalibrated", "rolled back"]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class HistoryEntry(ByValue, ShortRepr):
    """One rig that was put in place.

    Attributes
    ----------
    id : 1, 2, ... in the order of time.
    time : when, UTC.
    action : "found" is a rig that stood there before anybody kept a history, or that was edited by hand.
    rig : all of it, with its own evidence.
    evidence : what else was known when it was written: change, sigma, reason.
    captures : name and SHA-256 of each capture that it rests on.
    restored : of a rollback, the entry that it went back to.
    """

    id: int
    time: datetime
    action: Action
    rig: Rig
    evidence: Mapping[str, Any] = field(default_factory=dict[str, Any])
    captures: Sequence[Mapping[str, str]] = ()
    restored: int | None = None

    def _shown(self) -> Shown:
        rows = {"rig": self.rig.projector_from_camera.shown_title}
        if "reason" in self.evidence:
            rows["reason"] = str(self.evidence["reason"])
        return f"{self.id}, {self.action} {self.time:%Y-%m-%d %H:%M} UTC", rows


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class DamagedLine(ByValue, ShortRepr):
    """What a history lost: kept where it lies, and passed over.

    Attributes
    ----------
    path, place : the file, and where in it.
    problem : what was expected there, and found.
    """

    path: Path
    place: str
    problem: str

    def __str__(self) -> str:
        return f"{self.path}: {self.place}: {self.problem}"

    def _shown(self) -> Shown:
        return self.place, {"path": str(self.path), "problem": self.problem}


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class History(ByValue, ShortRepr, Sequence[HistoryEntry]):
    """The entries, oldest first, as a sequence; and what could not be read of them.

    Attributes
    ----------
    entries : those that are whole.
    damaged : lines that are not, in the order of the files.
    """

    entries: tuple[HistoryEntry, ...] = ()
    damaged: tuple[DamagedLine, ...] = ()

    def __len__(self) -> int:
        return len(self.entries)

    @overload
    def __getitem__(self, index: int) -> HistoryEntry: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[HistoryEntry, ...]: ...
    def __getitem__(self, index: int | slice) -> HistoryEntry | tuple[HistoryEntry, ...]:
        return self.entries[index]

    def _shown(self) -> Shown:
        rows = {"last": f"entry {self.entries[-1].shown_title}"} if self.entries else {}
        if self.damaged:
            rows["damaged"] = f"{len(self.damaged)} lines, the last {self.damaged[-1]}"
        return f"{len(self.entries)} entries", rows


def entry_document(entry: HistoryEntry) -> dict[str, Any]:
    """As it stands in the log."""
    return {
        "id": entry.id,
        "time": entry.time.isoformat(timespec="milliseconds"),
        "action": entry.action,
        "restored": entry.restored,
        "captures": [dict(capture) for capture in entry.captures],
        "evidence": dict(entry.evidence),
        "rig": json.loads(rig_to_json(entry.rig)),
    }


def entry_or_damage(record: LogRecord) -> HistoryEntry | DamagedLine:
    """What a record of the log says."""
    if record.document is None:
        return DamagedLine(record.path, record.place, record.problem)
    try:
        return _entry(record.path, record.document)
    except FileError as error:
        problem = error.problem
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        problem = f"expected an entry of a history, found none ({error})"
    return DamagedLine(record.path, record.place, problem)


def _entry(path: Path, document: Mapping[str, Any]) -> HistoryEntry:
    number, restored, action = document["id"], document["restored"], document["action"]
    if type(number) is not int or not (restored is None or type(restored) is int) or action not in get_args(Action):
        raise ValueError("id, restored or action is not what it must be")
    evidence, captures = document["evidence"], document["captures"]
    if not (isinstance(evidence, dict) and isinstance(captures, list)):
        raise ValueError("evidence or captures is not what it must be")
    time = datetime.fromisoformat(document["time"])
    if time.tzinfo is None:
        raise ValueError("a time without its zone")
    return HistoryEntry(
        number,
        time,
        action,
        rig_from_json(path, document["rig"]),
        cast(dict[str, Any], evidence),
        tuple({str(key): str(value) for key, value in capture.items()} for capture in cast(list[Any], captures)),
        restored,
    )
