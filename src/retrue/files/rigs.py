"""Rig files: read and written."""

from __future__ import annotations

from pathlib import Path

from retrue.errors import FileError
from retrue.files.atomic import replaced_file
from retrue.files.rig_json import FORMAT, parse_json, rig_from_json, rig_to_json
from retrue.files.text import read_text
from retrue.rig import Rig

LARGEST_RIG_FILE = 16 * 2**20  # bytes


def read_rig(path: str | Path) -> Rig:
    """The rig in a file. Raises `FileError`, which names the file and the key."""
    path = Path(path)
    document = parse_json(path, read_text(path, LARGEST_RIG_FILE))
    if document.get("format") != FORMAT:
        raise FileError(path, f'format: expected "{FORMAT}", found {document.get("format")!r}')
    return rig_from_json(path, document)


def write_rig(path: str | Path, rig: Rig) -> None:
    """Write the rig, whole or not at all; every number reads back to the last bit."""
    content = rig_to_json(rig).encode()
    with replaced_file(path) as stream:
        stream.write(content)
