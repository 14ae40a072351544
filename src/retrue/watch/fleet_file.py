"""fleet.toml: many rigs that one process watches; paths count from where the file lies."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, cast

from retrue.errors import FileError, InputError
from retrue.files.atomic import read_text
from retrue.files.video import is_stream
from retrue.recalibration.options import RecalibrateOptions, VerifyOptions
from retrue.recalibration.streak import CreepOptions
from retrue.watch.options import WatchOptions

LARGEST_FLEET = 2**22  # bytes
NAME = re.compile(r"[\w][\w. -]{0,99}")
FLEET_KEYS = {"workers", "port", "alarm", "lens", "limits", "rig"}
RIG_KEYS = {"name", "rig", "source", "pattern", "clouds", "temperature", "lens", "limits"}


@dataclass(frozen=True, slots=True)
class FleetRig:
    """One rig: its file, where its frames come from, and what else is asked of it."""

    name: str
    rig: Path
    source: str
    pattern: Path | None
    clouds: bool
    temperature: Path | None
    limits: WatchOptions
    judgement: VerifyOptions


@dataclass(frozen=True, slots=True)
class Alarm:
    """Who is told: an address that takes JSON, a command that reads it; and of which events."""

    webhook: str | None = None
    command: tuple[str, ...] = ()
    events: frozenset[str] = frozenset({"recalibrated", "refused", "failed", "rig unreadable", "history damaged"})


@dataclass(frozen=True, slots=True)
class Fleet:
    """All rigs, and what they share.

    Attributes
    ----------
    workers : processes; None for one a core.
    port : of 127.0.0.1, for the status page and the metrics; None for none, 0 for any that is free.
    """

    rigs: tuple[FleetRig, ...]
    workers: int | None
    port: int | None
    alarm: Alarm


def read_fleet(path: Path) -> Fleet:
    """Raises `FileError` that names the key."""
    try:
        document = tomllib.loads(read_text(path, LARGEST_FLEET))
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise FileError(path, f"expected TOML, found {error}") from error
    _known(path, document, FLEET_KEYS, "")
    tables: Any = document.get("rig")
    if not isinstance(tables, list) or not tables:
        raise FileError(path, "rig: expected a table [[rig]] for each rig, found none")
    shared = {key: document[key] for key in ("lens", "limits") if key in document}
    rigs = tuple(_rig(path, table, shared) for table in cast("list[Any]", tables))
    for key in ("name", "rig"):
        values = [str(getattr(rig, key)) for rig in rigs]
        if twice := next((value for value in values if values.count(value) > 1), None):
            raise FileError(path, f"{key}: expected another one for each rig, found {twice} twice")
    return Fleet(
        rigs,
        _whole(path, document, "workers", 1),
        _whole(path, document, "port", 0, 65535),
        _alarm(path, document.get("alarm", {})),
    )


def _rig(path: Path, table: Any, shared: Mapping[str, Any]) -> FleetRig:
    if not isinstance(table, dict):
        raise FileError(path, "rig: expected a table [[rig]] for each rig, found something else")
    found = cast("dict[str, Any]", table)
    _known(path, found, RIG_KEYS, "rig.")
    folder, rig = path.parent, _text(path, found, "rig")
    name = _text(path, found, "name") if "name" in found else Path(rig).stem
    if not NAME.fullmatch(name):
        raise FileError(path, f"name: expected letters, digits, dots, dashes, found {name[:40]!r}")
    source = _text(path, found, "source")
    if not (source.isdecimal() or is_stream(source)):
        source = str(folder / source)
    clouds = found.get("clouds", False)
    if not isinstance(clouds, bool):
        raise FileError(path, f"clouds: expected true or false, found {clouds!r:.40}")
    paths = {key: folder / _text(path, found, key) if key in found else None for key in ("pattern", "temperature")}
    limits = _limits(path, shared.get("limits", {}), found.get("limits", {}))
    judgement = _judgement(path, found.get("lens", shared.get("lens")))
    return FleetRig(name, folder / rig, source, paths["pattern"], clouds, paths["temperature"], limits, judgement)


def _judgement(path: Path, lens: Any) -> VerifyOptions:
    """By somebody's word on the lenses."""
    try:
        return VerifyOptions(estimate=RecalibrateOptions(lens=lens))
    except InputError as error:
        raise FileError(path, str(error)) from error


def _limits(path: Path, *tables: Any) -> WatchOptions:
    """Options by name, those of the rig over those of the fleet."""
    if not all(isinstance(table, dict) for table in tables):
        raise FileError(path, "limits: expected a table of options")
    merged: dict[str, Any] = {name: value for table in tables for name, value in table.items()}
    creep = {item.name: merged.pop(item.name) for item in fields(CreepOptions) if item.name in merged}
    try:
        return WatchOptions(**merged, creep=CreepOptions(**creep))
    except (TypeError, InputError) as error:
        raise FileError(path, f"limits: {error}") from error


def _alarm(path: Path, table: Any) -> Alarm:
    if not isinstance(table, dict):
        raise FileError(path, "alarm: expected a table")
    found = cast("dict[str, Any]", table)
    _known(path, found, {"webhook", "command", "events"}, "alarm.")
    for key in ("command", "events"):
        value = found.get(key, [])
        if not isinstance(value, list) or not all(isinstance(word, str) for word in cast("list[Any]", value)):
            raise FileError(path, f"alarm.{key}: expected a list of texts, found {value!r:.40}")
    webhook = _text(path, found, "webhook") if "webhook" in found else None
    if webhook is not None and not webhook.startswith(("http://", "https://")):
        raise FileError(path, f"alarm.webhook: expected an address, http://..., found {webhook[:40]!r}")
    events = frozenset(found["events"]) if "events" in found else Alarm().events
    return Alarm(webhook, tuple(found.get("command", [])), events)


def _known(path: Path, table: Mapping[str, Any], keys: set[str], where: str) -> None:
    if unknown := sorted(set(table) - keys):
        raise FileError(path, f"{where}{unknown[0]}: no such key; expected {', '.join(sorted(keys))}")


def _text(path: Path, table: Mapping[str, Any], key: str) -> str:
    value = table.get(key)
    if not isinstance(value, str) or not value or "\0" in value:
        raise FileError(path, f"{key}: expected a text in quotes, found {value!r:.40}")
    return value


def _whole(path: Path, table: Mapping[str, Any], key: str, least: int, most: int = 10**6) -> int | None:
    value = table.get(key)
    if value is not None and not (type(value) is int and least <= value <= most):
        raise FileError(path, f"{key}: expected {least} to {most}, found {value!r:.40}")
    return value
