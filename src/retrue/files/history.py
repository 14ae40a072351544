"""Every rig that stood in a rig file, beside it: rig.json.history.jsonl, one rig a line, never rewritten."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal, cast, get_args

from retrue.errors import FileError, InputError, require_kind, require_path
from retrue.files.append_log import AppendLog, opened_log, read_log
from retrue.files.atomic import replaced_file
from retrue.files.images import picture_paths
from retrue.files.rig_json import rig_from_json, rig_to_json
from retrue.files.rigs import read_rig
from retrue.recalibration.result import Accepted
from retrue.rig import Rig
from retrue.shown import ShortRepr, Shown
from retrue.values import ByValue

Action = Literal["found", "recalibrated", "rolled back"]


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


def history_path(rig_path: str | Path) -> Path:
    """Where the history of a rig file is; a link to a rig shares the history of the rig.

    >>> history_path("/rigs/cell.json").name
    'cell.json.history.jsonl'
    """
    path = Path(os.path.realpath(rig_path))
    return path.with_name(f"{path.name}.history.jsonl")


def read_history(rig_path: str | Path) -> list[HistoryEntry]:
    """All entries, oldest first; none where there is no history. Raises `FileError`."""
    path = history_path(require_path(rig_path, "read_history(rig_path)"))
    return _entries(path, read_log(path))


def entry_in_place(entries: Sequence[HistoryEntry], rig: Rig) -> HistoryEntry | None:
    """The latest entry that holds this very rig; None where it was edited since."""
    text = rig_to_json(rig)
    return next((entry for entry in reversed(entries) if rig_to_json(entry.rig) == text), None)


def known_working_distance(rig_path: str | Path, rig: Rig) -> float | None:
    """How far away the scene was, from the rig's evidence or from that in its history; None where neither says."""
    entry = entry_in_place(read_history(rig_path), rig)
    places: list[Mapping[str, Any]] = [rig.evidence] if entry is None else [rig.evidence, entry.evidence]
    for evidence in places:
        distance: Any = evidence.get("working_distance")
        if isinstance(distance, int | float) and 0 < distance < math.inf:
            return float(distance)
    return None


def write_in_place(rig_path: str | Path, result: Accepted, captures: Sequence[Mapping[str, str]] = ()) -> HistoryEntry:
    """Put a recalibrated rig in the place of the one in the file, and keep both in its history.

    The entry is on the disk before the rig is replaced, and both happen under a lock. A process killed in between
    leaves the old rig, or the new, and a history that has every entry. Where the entry or the rig cannot be
    written, a `FileError` says so and neither has changed.
    """
    path = _writable(require_path(rig_path, "write_in_place(rig_path, result)"))
    require_kind(result, Accepted, "result")
    with opened_log(history_path(path)) as log:
        return _put(path, log, result.rig, "recalibrated", _evidence(result), captures, None)


def roll_back(rig_path: str | Path, entry_id: int | None = None) -> HistoryEntry:
    """Put an earlier rig back; that too is an entry, so that nothing is lost by it.

    Without an id it is the one before the rig in place, and again the one before that when called again.
    Raises `InputError` where there is no such entry, `FileError` where nothing can be written.
    """
    path = _writable(require_path(rig_path, "roll_back(rig_path)"))
    with opened_log(history_path(path)) as log:
        entries = _entries(log.path, log.documents)
        target = _before(path, entries) if entry_id is None else _with_id(log.path, entries, entry_id)
        return _put(path, log, target.rig, "rolled back", target.evidence, target.captures, target.id)


def capture_record(path: str | Path) -> dict[str, str]:
    """Name and SHA-256 of a capture, as `sha256sum` gives it; of a folder, of that program's lines for its pictures."""
    path = Path(path)
    if not path.is_dir():
        return {"name": path.name, "sha256": _digest(path)}
    lines = "".join(f"{_digest(picture)}  {picture.name}\n" for picture in picture_paths(path))
    return {"name": path.name, "sha256": hashlib.sha256(lines.encode(errors="surrogateescape")).hexdigest()}


def _put(
    path: Path,
    log: AppendLog,
    rig: Rig,
    action: Action,
    evidence: Mapping[str, Any],
    captures: Sequence[Mapping[str, str]],
    restored: int | None,
) -> HistoryEntry:
    entries = _entries(log.path, log.documents)
    last = entries[-1].id if entries else 0
    new: list[HistoryEntry] = []
    found = _rig_in(path)
    if found is not None and entry_in_place(entries, found) is None:
        new.append(HistoryEntry(last + 1, datetime.now(UTC), "found", found))
    entry = HistoryEntry(last + len(new) + 1, datetime.now(UTC), action, rig, evidence, tuple(captures), restored)
    documents = [_document(item) for item in (*new, entry)]
    with log.appended(documents), replaced_file(path, alone=True) as stream:
        stream.write(rig_to_json(rig).encode())
    return entry


def _evidence(result: Accepted) -> dict[str, Any]:
    """What the answer says beyond the rig."""
    found = result.evidence
    return {
        "reason": result.reason,
        "correspondences": found.correspondences,
        "rms_px": found.rms_px,
        "change": None if found.change is None else asdict(found.change),
        "sigma": None if found.sigma is None else asdict(found.sigma),
        "working_distance": found.working_distance,
    }


def _rig_in(path: Path) -> Rig | None:
    """The rig that stands there; None where the file is damaged or gone, which a rollback mends."""
    try:
        return read_rig(path)
    except FileError:
        return None


def _before(path: Path, entries: Sequence[HistoryEntry]) -> HistoryEntry:
    """The entry one step back in time from the rig in place, past what was rolled back already."""
    found = _rig_in(path)
    current = None if found is None else entry_in_place(entries, found)
    if current is None:
        earlier = [entry for entry in entries if entry.restored is None]
    else:
        place = current.restored or current.id
        earlier = [entry for entry in entries if entry.id < place and entry.restored is None]
    if not earlier:
        raise InputError(f"{path}: no earlier rig in {history_path(path).name}")
    return earlier[-1]


def _with_id(path: Path, entries: Sequence[HistoryEntry], entry_id: int) -> HistoryEntry:
    for entry in entries:
        if entry.id == entry_id:
            return entry
    known = f"1 to {entries[-1].id}" if entries else "none, for it is empty"
    raise InputError(f"{path}: expected the ID of an entry ({known}), found {entry_id}")


def _writable(rig_path: str | Path) -> Path:
    path = Path(os.path.realpath(rig_path))
    if path.exists() and not os.access(path, os.W_OK):
        raise FileError(rig_path, "cannot be written: it is read-only")
    return path


def _digest(path: Path) -> str:
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from error


def _document(entry: HistoryEntry) -> dict[str, Any]:
    return {
        "id": entry.id,
        "time": entry.time.isoformat(timespec="milliseconds"),
        "action": entry.action,
        "restored": entry.restored,
        "captures": [dict(capture) for capture in entry.captures],
        "evidence": dict(entry.evidence),
        "rig": json.loads(rig_to_json(entry.rig)),
    }


def _entries(path: Path, documents: Sequence[Mapping[str, Any]]) -> list[HistoryEntry]:
    entries: list[HistoryEntry] = []
    for line, document in enumerate(documents, start=1):
        try:
            entry = _entry(path, document)
        except FileError as error:
            raise FileError(path, f"line {line}: {error.problem}") from error
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise FileError(path, f"line {line}: expected an entry of a history, found none ({error})") from error
        if entries and entry.id <= entries[-1].id:
            raise FileError(path, f"line {line}: expected an ID above {entries[-1].id}, found {entry.id}")
        entries.append(entry)
    return entries


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
