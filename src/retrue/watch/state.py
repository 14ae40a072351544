"""What a watch remembers from one run to the next: where its source goes on, and what it counted."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, cast

from retrue.errors import FileError
from retrue.files.atomic import read_text, replaced_file
from retrue.files.json_values import parse_json

FORMAT = "retrue-watch"
LARGEST_STATE = 16 * 2**20  # bytes
NO_STATE = "expected the saved state of a watch, found none; remove it to begin anew"


@dataclass(slots=True)
class Counts:
    """How many frames there were, and what became of them."""

    frames: int = 0
    good: int = 0
    drifted: int = 0
    unknown: int = 0
    bad: int = 0
    dropped: int = 0
    recalibrated: int = 0
    refused: int = 0


@dataclass(slots=True)
class WatchState:
    """Belongs to one source; another source begins anew.

    Attributes
    ----------
    memory : what the last frames said, and of which rig: as `Memory` writes it.
    """

    source: str
    position: Mapping[str, Any] = field(default_factory=dict[str, Any])
    counts: Counts = field(default_factory=Counts)
    memory: Mapping[str, Any] = field(default_factory=dict[str, Any])


def read_state(path: Path, source: str) -> WatchState:
    """What was saved of this source; a new state where there is none. Raises FileError where it does not read."""
    if not path.exists():
        return WatchState(source)
    document = parse_json(path, read_text(path, LARGEST_STATE))
    position, counts = document.get("position"), _counts(path, document)
    if not isinstance(position, dict):
        raise FileError(path, NO_STATE)
    if document.get("source") != source:
        return WatchState(source)
    memory = document.get("memory")
    known = cast("dict[str, Any]", memory) if isinstance(memory, dict) else {}
    return WatchState(source, cast("dict[str, Any]", position), counts, known)


def read_counts(path: Path) -> Counts:
    """What was counted, of whatever source. Raises FileError where it does not read."""
    return _counts(path, parse_json(path, read_text(path, LARGEST_STATE)))


def _counts(path: Path, document: Mapping[str, Any]) -> Counts:
    counts = document.get("counts")
    if document.get("format") != FORMAT or not isinstance(counts, dict):
        raise FileError(path, NO_STATE)
    saved = cast("dict[str, Any]", counts)
    names = [item.name for item in fields(Counts)]
    if not all(type(saved.get(name)) is int and saved[name] >= 0 for name in names):
        raise FileError(path, "expected counts in the saved state of a watch; remove it to begin anew")
    return Counts(*(saved[name] for name in names))


def write_state(path: Path, state: WatchState) -> None:
    """Whole or not at all."""
    known = {"position": dict(state.position), "counts": asdict(state.counts), "memory": dict(state.memory)}
    with replaced_file(path, alone=True) as stream:
        stream.write(json.dumps({"format": FORMAT, "source": state.source, **known}).encode() + b"\n")
