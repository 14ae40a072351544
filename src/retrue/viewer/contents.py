"""What the files that are to be viewed hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

from retrue.errors import FileError, InputError
from retrue.files.atomic import read_text
from retrue.files.history import read_history
from retrue.files.history_entry import HistoryEntry
from retrue.files.json_values import parse_json
from retrue.files.models import MESH_ENDINGS, read_model
from retrue.files.points import TABLES, read_points
from retrue.files.rigs import read_rig
from retrue.geometry.transform import RigidTransform
from retrue.reconstruction.cloud import Cloud, Mesh
from retrue.reconstruction.reconstruct import reconstruct
from retrue.rig import Rig

LARGEST_ANSWER = 2**26  # bytes


MOST_ENTRIES = 200  # of a history that are shown


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A pose that an answer of `retrue recalibrate --json` weighed."""

    projector_from_camera: RigidTransform
    chosen: bool


@dataclass(frozen=True, slots=True, eq=False)
class Contents:
    """By kind, each under the name of its file.

    Attributes
    ----------
    rigs : with the history that lies beside each; no entries where there is none.
    models : clouds and meshes, those of points CSVs included.
    candidates : of each answer.
    """

    rigs: dict[str, tuple[Rig, Sequence[HistoryEntry]]] = field(default_factory=dict[str, Any])
    models: dict[str, Cloud | Mesh] = field(default_factory=dict[str, Any])
    candidates: dict[str, list[Candidate]] = field(default_factory=dict[str, Any])


def read_contents(paths: Sequence[Path]) -> Contents:
    """Rigs of any supported format, clouds and meshes, points CSVs and the answers of `recalibrate --json`.

    Points need a rig among the files: the first one triangulates them. Raises `FileError`, or `InputError` where
    there is nothing to view.
    """
    if not paths:
        raise InputError("expected at least one FILE to view, found none")
    contents = Contents()
    names = _distinct_names(paths)
    for name, path in names.items():
        if not path.is_file():
            raise FileError(path, "no such file")
        if path.suffix.lower() not in (*TABLES, *MESH_ENDINGS):
            _read_rig_or_answer(contents, name, path)
    first = next(iter(contents.rigs.values()), None)
    for name, path in names.items():
        if path.suffix.lower() in TABLES:
            if first is None:
                raise FileError(path, "points need the rig that saw them: give its file too")
            contents.models[name] = reconstruct(first[0], read_points(path))
        elif path.suffix.lower() in MESH_ENDINGS:
            contents.models[name] = read_model(path, "m" if first is None else first[0].unit)
    return contents


def _read_rig_or_answer(contents: Contents, name: str, path: Path) -> None:
    text = read_text(path, LARGEST_ANSWER)
    if text.lstrip().startswith("{") and "candidates" in (answer := parse_json(path, text)):
        contents.candidates[name] = _candidates(path, answer["candidates"])
    else:
        contents.rigs[name] = read_rig(path), read_history(path, MOST_ENTRIES + 1)


def _candidates(path: Path, documents: Any) -> list[Candidate]:
    try:
        found = [
            Candidate(RigidTransform(document["R"], document["t"]), document["chosen"] is True)
            for document in cast("list[dict[str, Any]]", documents)
        ]
    except (InputError, KeyError, TypeError) as error:
        raise FileError(path, f"candidates: expected poses with R, t and chosen, found none ({error})") from error
    if not found:
        raise FileError(path, "candidates: expected at least one, found none: the answer was refused before that")
    return found


def _distinct_names(paths: Sequence[Path]) -> dict[str, Path]:
    """Paths under their names, or whole where two have the same."""
    names = [path.name for path in paths]
    return {str(path) if names.count(path.name) > 1 else path.name: path for path in paths}
