"""Every rig that stood in a rig file, beside it: rig.json.history.jsonl, one rig a line, never rewritten.

What is older lies compressed in the folder rig.json.history. A damaged line is told, passed over, and closes nothing.
"""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from retrue.calibration.result import Calibrated
from retrue.errors import FileError, InputError, require_kind, require_kinds, require_path
from retrue.files.append_log import AppendLog, newest_first, opened_log
from retrue.files.atomic import replaced_file
from retrue.files.history_entry import Action, DamagedLine, History, HistoryEntry, entry_document, entry_or_damage
from retrue.files.images import picture_paths
from retrue.files.rig_json import rig_to_json
from retrue.files.rigs import read_rig
from retrue.ranges import require_number
from retrue.recalibration.result import Accepted
from retrue.rig import Rig

MOST_DAMAGED = 1000  # lines that are told one by one


def history_path(rig_path: str | Path) -> Path:
    """Where the history of a rig file is; a link to a rig shares the history of the rig.

    >>> history_path("/rigs/cell.json").name
    'cell.json.history.jsonl'
    """
    path = Path(os.path.realpath(rig_path))
    return path.with_name(f"{path.name}.history.jsonl")


def read_history(rig_path: str | Path, last: int | None = None) -> History:
    """All entries, or the last so many, which takes as long however many there are; none where there is no history.

    Lines that are damaged are in `damaged`, the last thousand of them, and close nothing. Raises `FileError` where the
    history is no file, or cannot be read at all.
    """
    path = history_path(require_path(rig_path, "read_history(rig_path)"))
    if last is not None:
        require_number(last, "last", 0, whole=True)
    entries: list[HistoryEntry] = []
    damaged: list[DamagedLine] = []
    for found in map(entry_or_damage, newest_first(path)):
        if isinstance(found, DamagedLine):
            damaged += [found][: MOST_DAMAGED - len(damaged)]
        elif last is not None and len(entries) >= last:
            break
        else:
            entries.append(found)
    return History(tuple(reversed(entries)), tuple(reversed(damaged)))


def entry_in_place(entries: Sequence[HistoryEntry], rig: Rig) -> HistoryEntry | None:
    """The latest entry that holds this very rig; None where it was edited since."""
    return next((entry for entry in reversed(entries) if _holds(entry, rig)), None)


def _holds(entry: HistoryEntry, rig: Rig) -> bool:
    same = entry.rig.projector_from_camera == rig.projector_from_camera  # tells most, and soon
    return same and rig_to_json(entry.rig) == rig_to_json(rig)


def known_working_distance(rig_path: str | Path, rig: Rig) -> float | None:
    """How far away the scene was, from the rig's evidence or from that in its history; None where neither says."""
    distance = _working_distance(rig.evidence)
    if distance is None:
        path = history_path(rig_path)
        entry = next((item for item in _entries_newest_first(path) if _holds(item, rig)), None)
        distance = None if entry is None else _working_distance(entry.evidence)
    return distance


def _working_distance(evidence: Mapping[str, Any]) -> float | None:
    distance: Any = evidence.get("working_distance")
    return float(distance) if isinstance(distance, int | float) and 0 < distance < math.inf else None


def write_in_place(
    rig_path: str | Path, result: Accepted | Calibrated, captures: Sequence[Mapping[str, str]] = ()
) -> HistoryEntry:
    """Put a recalibrated or calibrated rig in the place of the one in the file, if any, and keep both in its history.

    The entry is on the disk before the rig is replaced, and both happen under a lock. A process killed in between
    leaves the old rig, or the new, and a history that has every entry. Where the entry or the rig cannot be
    written, a `FileError` says so and neither has changed.
    """
    path = _writable(require_path(rig_path, "write_in_place(rig_path, result)"))
    require_kind(result, (Accepted, Calibrated), "result")
    require_kinds(captures, Mapping, "captures")
    action: Action = "recalibrated" if isinstance(result, Accepted) else "calibrated"
    evidence = _evidence(result) if isinstance(result, Accepted) else {"reason": result.reason}
    with opened_log(history_path(path)) as log:
        return _put(path, log, result.rig, action, evidence, captures, None)


def roll_back(rig_path: str | Path, entry_id: int | None = None) -> HistoryEntry:
    """Put an earlier rig back; that too is an entry, so that nothing is lost by it.

    Without an id it is the one before the rig in place, and again the one before that when called again.
    Raises `InputError` where there is no such entry, `FileError` where nothing can be written.
    """
    path = _writable(require_path(rig_path, "roll_back(rig_path)"))
    if entry_id is not None:
        require_number(entry_id, "entry_id", whole=True)
    with opened_log(history_path(path)) as log:
        target = _before(path, log.path) if entry_id is None else _with_id(log.path, entry_id)
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
    new: list[HistoryEntry] = []
    found = _rig_in(path)
    recent = (entry for entry in map(entry_or_damage, log.recent) if isinstance(entry, HistoryEntry))
    if found is not None and not any(_holds(entry, found) for entry in recent):
        new.append(HistoryEntry(log.next_id, datetime.now(UTC), "found", found))
    number = log.next_id + len(new)
    entry = HistoryEntry(number, datetime.now(UTC), action, rig, evidence, tuple(captures), restored)
    documents = [entry_document(item) for item in (*new, entry)]
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


def _before(path: Path, log_path: Path) -> HistoryEntry:
    """The entry one step back in time from the rig in place, past what was rolled back already."""
    found = _rig_in(path)
    newest: HistoryEntry | None = None  # but for rollbacks
    place: int | None = None
    for entry in _entries_newest_first(log_path):
        if place is None and found is not None and _holds(entry, found):
            place = entry.restored or entry.id
        if entry.restored is None:
            newest = newest or entry
            if place is not None and entry.id < place:
                return entry
    if place is not None or newest is None:
        raise InputError(f"{path}: no earlier rig in {log_path.name}")
    return newest


def _with_id(path: Path, entry_id: int) -> HistoryEntry:
    named = (record for record in newest_first(path, entry_id) if (record.document or {}).get("id") == entry_id)
    found = next((entry for entry in map(entry_or_damage, named) if isinstance(entry, HistoryEntry)), None)
    if found is not None:
        return found
    last = next(_entries_newest_first(path), None)
    known = "none, for it is empty" if last is None else f"1 to {last.id}"
    raise InputError(f"{path}: expected the ID of an entry ({known}), found {entry_id}")


def _writable(rig_path: str | Path) -> Path:
    path = Path(os.path.realpath(rig_path))
    if path.exists() and not os.access(path, os.W_OK):
        raise FileError(rig_path, "cannot be written: it is read-only")
    if path.exists() and not path.is_file():
        raise FileError(rig_path, "expected a file, found something else")
    return path


def _digest(path: Path) -> str:
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from error


def _entries_newest_first(path: Path) -> Iterator[HistoryEntry]:
    return (found for found in map(entry_or_damage, newest_first(path)) if isinstance(found, HistoryEntry))
