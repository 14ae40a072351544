"""What a batch is to do: job.toml, one table or several `[[job]]`; paths count from where the file lies."""

from __future__ import annotations

import glob
import os
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, cast, get_args

from retrue.errors import FileError, InputError
from retrue.files.atomic import read_text
from retrue.files.images import SUFFIXES, natural_key
from retrue.files.remote import Remote, is_address, listed
from retrue.recalibration.options import RecalibrateOptions, VerifyOptions
from retrue.recalibration.streak import StreakOptions
from retrue.reconstruction.options import ReconstructOptions

LARGEST_JOB = 2**22  # bytes
READ = (*sorted(SUFFIXES), ".csv")
Do = Literal["verify", "recalibrate", "reconstruct"]
Order = Literal["name", "time"]
KEYS = {"rig", "pattern", "captures", "do", "out", "order", "lens", "limits"}
Capture = Path | Remote
Limits = Mapping[str, Mapping[str, Any]]
LIMITS: dict[str, type[Any]] = {
    "streak": StreakOptions,
    "recalibrate": RecalibrateOptions,
    "verify": VerifyOptions,
    "reconstruct": ReconstructOptions,
}


@dataclass(frozen=True, slots=True)
class Job:
    """One rig and its captures.

    Attributes
    ----------
    captures : in the order in which they were taken; on a disk, or in an object store.
    names : of each capture, below the folder that they have in common; results are named so.
    do : what to do with them. "recalibrate" goes through all in their order, finds when the rig had moved, and uses
        from there on the rig that they give.
    limits : options of the methods that differ from what is usual, by method; a word on the lenses among them.
    """

    rig: Path
    pattern: Path | None
    captures: tuple[Capture, ...]
    names: tuple[str, ...]
    do: frozenset[Do]
    out: Path
    limits: Limits = field(default_factory=dict[str, Any])


def options_of(limits: Limits, name: str) -> Any:
    """Options of a method; `verify` takes for granted what `recalibrate` does."""
    beside = {"estimate": options_of(limits, "recalibrate")} if name == "verify" else {}
    return LIMITS[name](**limits.get(name, {}), **beside)


def read_jobs(path: Path) -> list[Job]:
    """All jobs of a file. Raises `FileError` that names the key."""
    try:
        document = tomllib.loads(read_text(path, LARGEST_JOB))
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise FileError(path, f"expected TOML, found {error}") from error
    tables: Any = document.get("job", [document])
    if not isinstance(tables, list) or not tables or ("job" in document and set(document) != {"job"}):
        raise FileError(path, "expected one table, or several [[job]] and nothing else")
    jobs = [_job(path, table) for table in cast("list[Any]", tables)]
    outs = [job.out for job in jobs]
    if len(set(outs)) < len(outs):
        raise FileError(path, "out: expected a folder of its own for each job, found one twice")
    return jobs


def _job(path: Path, table: Any) -> Job:
    if not isinstance(table, dict):
        raise FileError(path, "job: expected a table, found something else")
    found = cast("dict[str, Any]", table)
    if unknown := sorted(set(found) - KEYS):
        raise FileError(path, f"{unknown[0]}: no such key; expected {', '.join(sorted(KEYS))}")
    folder = path.parent
    captures, names = _captures(path, _text(path, found, "captures"), _order(path, found))
    do = found.get("do", ["verify"])
    do = [do] if isinstance(do, str) else do
    if not isinstance(do, list) or not do or not set(cast("list[Any]", do)) <= set(get_args(Do)):
        raise FileError(path, f"do: expected a list of {', '.join(get_args(Do))}, found {do!r:.60}")
    return Job(
        folder / _text(path, found, "rig"),
        folder / _text(path, found, "pattern") if "pattern" in found else None,
        captures,
        names,
        frozenset(cast("list[Do]", do)),
        folder / _text(path, found, "out"),
        _limits(path, found.get("limits", {}), found.get("lens")),
    )


def _text(path: Path, table: Mapping[str, Any], key: str) -> str:
    text = table.get(key)
    if not isinstance(text, str) or not text or "\0" in text:
        raise FileError(path, f"{key}: expected a path in quotes, found {text!r:.60}")
    if is_address(text) and key != "captures":
        raise FileError(path, f"{key}: expected a path on this disk, found {text}; only captures may lie in a store")
    return text


def _order(path: Path, table: Mapping[str, Any]) -> Order:
    order = table.get("order", "name")
    if order not in get_args(Order):
        raise FileError(path, f'order: expected "name" or "time" (when the files last changed), found {order!r:.60}')
    return order


def _captures(path: Path, pattern: str, order: Order) -> tuple[tuple[Capture, ...], tuple[str, ...]]:
    """What the glob names that may be a capture: pictures, tables of points, folders."""
    try:
        found = _stored(pattern) if is_address(pattern) else _on_disk(path.parent, pattern)
    except (OSError, ValueError) as error:
        raise FileError(path, f"captures: cannot be looked for: {error}") from error
    if not found:
        raise FileError(path, f"captures: expected pictures, folders or points CSVs, found none of the name {pattern}")
    common = os.path.commonpath({os.path.dirname(place) for place in found}).rstrip("/")  # noqa: PTH120
    names = {place: place[len(common) :].removeprefix("/") for place in found}
    ordered = sorted(found, key=lambda place: (natural_key(names[place]), place))
    if order == "time":
        times = {place: modified_at(found[place]) for place in found}
        ordered.sort(key=times.__getitem__)
    return tuple(found[place] for place in ordered), tuple(names[place] for place in ordered)


def modified_at(capture: Capture) -> float:
    """Seconds since 1970: when its file, or the last in its folder, was written. Raises `FileError`."""
    if isinstance(capture, Remote):
        if capture.modified is None:
            raise FileError(capture.address, "expected the time of its last change, found none: the store has none")
        return capture.modified
    try:
        files = [capture, *capture.iterdir()] if capture.is_dir() else [capture]
        return max(file.stat().st_mtime for file in files)
    except OSError as error:
        raise FileError(capture, f"cannot be read: {error.strerror or error}") from error


def _on_disk(folder: Path, pattern: str) -> dict[str, Capture]:
    """By path; strings, for there may be a hundred thousand."""
    found = [folder / name for name in glob.glob(pattern, root_dir=folder, recursive=True)]  # noqa: PTH207
    return {place.as_posix(): place for place in found if _is_read(place.name) or place.is_dir()}


def _stored(pattern: str) -> dict[str, Capture]:
    """By the path within the store."""
    found = {str(remote.path): remote for remote in listed(pattern)}
    return {place: remote for place, remote in found.items() if remote.folder or _is_read(place)}


def _is_read(name: str) -> bool:
    return name.lower().endswith(READ)


def _limits(path: Path, table: Any, lens: Any) -> dict[str, dict[str, Any]]:
    if not isinstance(table, dict) or not set(cast("dict[str, Any]", table)) <= set(LIMITS):
        raise FileError(path, f"limits: expected tables {', '.join(f'limits.{name}' for name in LIMITS)}")
    limits = cast("dict[str, dict[str, Any]]", table)
    for name in (name for name in LIMITS if name in limits):
        try:
            options_of(limits, name)
        except (TypeError, InputError) as error:
            raise FileError(path, f"limits.{name}: {error}") from error
    if lens is None:
        return limits
    limits = {**limits, "recalibrate": {**limits.get("recalibrate", {}), "lens": lens}}
    try:
        options_of(limits, "recalibrate")
    except InputError as error:
        raise FileError(path, str(error)) from error
    return limits
