"""From the history of a rig and its captures to the clouds that must be made again, and how far each was off."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

from retrue.batch.batch import Batch, Progress, check_inputs
from retrue.batch.job import Job, modified_at
from retrue.batch.ledger import opened_ledger
from retrue.batch.runners import Runner
from retrue.batch.tasks import Look
from retrue.errors import InputError
from retrue.files.atomic import replaced_file
from retrue.files.history import read_history
from retrue.files.history_entry import HistoryEntry
from retrue.files.rig_json import rig_to_json
from retrue.rig_difference import rig_difference

NONE_FITS = "had drifted from the rig that stood there, and no later one fits it either"
COLUMNS = ("capture", "time", "made_with", "fits", "off", "unit", "cloud", "failed")


@dataclass(frozen=True, slots=True)
class Stale:
    """A capture whose cloud, made with the rig that stood in the file then, is wrong.

    Attributes
    ----------
    made_with, fits : entries of the history: that stood there, and that holds for it; None where none does.
    off : how far its points landed elsewhere, RMS, in the rig's unit; None where that is not known.
    inferred : it cannot tell by itself; those around it do.
    cloud : as it was made again.
    failed : why it was not.
    """

    name: str
    time: datetime
    made_with: int
    fits: int | None
    off: float | None = None
    inferred: bool = False
    cloud: Path | None = None
    failed: str = ""


def rescan(
    job: Job, since: datetime | None, runner: Runner, progress: Progress, *, clouds: bool = True
) -> tuple[list[Stale], int]:
    """What must be made again of captures since then, and how many were looked at.

    A capture is verified with the rig that stood in the file when it was taken; where it had drifted, with those that
    came later, until one fits. Raises `FileError`, and `InputError` where the rig has no history.
    """
    standing = read_history(job.rig)
    entries = [entry for entry in standing if entry.restored is None]
    if not standing:
        raise InputError(f"{job.rig}: no history beside it: nobody knows which rig stood there when")
    check_inputs(job)
    with opened_ledger(job.out) as ledger:
        batch = Batch(job, runner, ledger, progress)
        times = {
            name: datetime.fromtimestamp(modified_at(path), UTC)
            for name, path in zip(job.names, job.captures, strict=True)
        }
        names = sorted((n for n in job.names if since is None or times[n] >= since), key=times.__getitem__)
        looks = {task.name: task for task in map(batch.look, range(len(job.names)))}
        then = {name: _standing(standing, times[name]) for name in names}
        found = _looked(batch, "captures", [(looks[name], then[name]) for name in names])
        fits = _fitting(batch, looks, then, found, entries)
        stale = [_stale(name, times[name], then[name], *fit) for name, fit in fits.items()]
        stale = sorted([*stale, *_inferred(names, found, fits, then, times)], key=lambda item: (item.time, item.name))
        by_id = {entry.id: entry for entry in entries}
        again = [item for item in stale if item.fits is not None]
        if clouds and again:
            made = _looked(batch, "clouds", [(looks[item.name], by_id[item.fits or 0]) for item in again], clouds=True)
            stale = [_made(item, job, made[item.name]) if item.name in made else item for item in stale]
    _write(job, stale, standing[0].rig.unit)
    return stale, len(names)


def _looked(
    batch: Batch, what: str, asked: Sequence[tuple[Look, HistoryEntry]], *, clouds: bool = False
) -> dict[str, Mapping[str, Any]]:
    """What each capture says of an entry's rig; or its cloud with it."""
    tasks: list[Look] = []
    for task, entry in asked:
        rig = batch.job.out / "rigs" / f"entry {entry.id}.json"
        text = rig_to_json(entry.rig).encode()
        if not rig.exists() or rig.read_bytes() != text:
            rig.parent.mkdir(parents=True, exist_ok=True)
            with replaced_file(rig) as stream:
                stream.write(text)
        cloud = batch.job.out / "clouds" / f"{task.name}.ply" if clouds else None
        tasks.append(replace(task, rig=rig, verify=not clouds, cloud=cloud, points=batch.points_path(task)))
    return batch.results(what, tasks)


def _fitting(
    batch: Batch,
    looks: Mapping[str, Look],
    then: Mapping[str, HistoryEntry],
    found: Mapping[str, Mapping[str, Any]],
    entries: Sequence[HistoryEntry],
) -> dict[str, tuple[HistoryEntry | None, Mapping[str, Any]]]:
    """Of each capture that had drifted: the first later entry that fits, and what the capture says of it."""
    fits: dict[str, tuple[HistoryEntry | None, Mapping[str, Any]]] = {
        name: (None, result) for name, result in found.items() if result.get("verdict") == "drifted"
    }
    for entry in entries:
        open_names = [name for name, (fit, _) in fits.items() if fit is None and entry.id > then[name].id]
        for name, result in _looked(batch, "", [(looks[name], entry) for name in open_names]).items():
            if result.get("verdict") == "good":
                fits[name] = (entry, result)
    return fits


def _inferred(
    names: Sequence[str],
    found: Mapping[str, Mapping[str, Any]],
    fits: Mapping[str, tuple[HistoryEntry | None, Mapping[str, Any]]],
    then: Mapping[str, HistoryEntry],
    times: Mapping[str, datetime],
) -> list[Stale]:
    """Captures that cannot tell, between two of one stale rig for which another one fits."""
    inferred: list[Stale] = []
    tell = [number for number, name in enumerate(names) if found[name].get("verdict") in ("good", "drifted")]
    for before, after in pairwise(tell):
        sides = fits.get(names[before]), fits.get(names[after])
        if sides[0] is None or sides[1] is None or sides[0][0] is None or sides[0][0] is not sides[1][0]:
            continue
        fit = sides[0][0]
        for name in names[before + 1 : after]:
            if "failed" not in found[name] and then[name] is then[names[before]]:
                off = _off(then[name], fit, sides[0][1])
                inferred.append(Stale(name, times[name], then[name].id, fit.id, off, inferred=True))
    return inferred


def _stale(name: str, time: datetime, then: HistoryEntry, fit: HistoryEntry | None, result: Mapping[str, Any]) -> Stale:
    if fit is None:
        return Stale(name, time, then.id, None, failed=NONE_FITS)
    return Stale(name, time, then.id, fit.id, _off(then, fit, result))


def _made(item: Stale, job: Job, result: Mapping[str, Any]) -> Stale:
    failed = str(result.get("failed") or result.get("lost") or "")
    return replace(item, cloud=None if failed else job.out / "clouds" / f"{item.name}.ply", failed=failed)


def _off(then: HistoryEntry, fit: HistoryEntry, result: Mapping[str, Any]) -> float | None:
    distance = result.get("working_distance")
    if not isinstance(distance, float) or not distance > 0:
        return None
    off = rig_difference(fit.rig, then.rig, distance).displacement  # what the one saw, measured with the other
    return off if off is not None and off >= 0 else None


def _standing(entries: Sequence[HistoryEntry], time: datetime) -> HistoryEntry:
    """The last that was put in place by then; the first, where that was later."""
    return next((entry for entry in reversed(entries) if entry.time <= time), entries[0])


def _write(job: Job, stale: Sequence[Stale], unit: str) -> None:
    table = io.StringIO(newline="")
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(COLUMNS)
    for item in stale:
        time = item.time.isoformat(timespec="seconds")
        writer.writerow([item.name, time, item.made_with, item.fits, item.off, unit, item.cloud, item.failed])
    with replaced_file(job.out / "rescan.csv") as stream:
        stream.write(table.getvalue().encode(errors="surrogateescape"))
