"""The setup of a live rig: which camera, which projector, and what they are told; TOML."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from retrue.errors import FileError, require_kind, require_path
from retrue.values import ByValue

LONGEST_SAID = 120  # characters
LARGEST_SETUP = 2**20  # bytes
CAMERA_DRIVERS = ("opencv", "genicam", "gphoto2", "picamera2", "simulated")
PROJECTOR_DRIVERS = ("window", "simulated")
TABLES = {"camera": CAMERA_DRIVERS, "projector": PROJECTOR_DRIVERS}


@dataclass(frozen=True, eq=False)
class Setup(ByValue):
    """What a setup file says.

    Attributes
    ----------
    camera, projector : the settings of each, its `driver` among them.
    rig : path of the rig's file, relative to the setup's; None until it is calibrated.
    path : of the setup, for messages.
    """

    camera: Mapping[str, Any]
    projector: Mapping[str, Any]
    rig: Path | None = None
    path: Path = Path("setup.toml")


SIMULATED = Setup({"driver": "simulated"}, {"driver": "simulated"}, path=Path("simulated"))


def parse_setup(text: str, path: str | Path = "setup.toml") -> Setup:
    """A setup from the text of its file; drivers check their own settings when they are made.

    Raises
    ------
    FileError
        no TOML, or it names no camera and no projector that there are.

    >>> text = '[camera]\\ndriver = "opencv"\\ndevice = 0\\n[projector]\\ndriver = "window"\\nscreen = 1\\n'
    >>> setup = parse_setup(text)
    >>> dict(setup.camera), setup.rig
    ({'driver': 'opencv', 'device': 0}, None)
    """
    path = require_path(path, "parse_setup(text, path)")
    require_kind(text, str, "text")
    try:
        tables = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise FileError(path, f"not a setup, which is TOML: {in_short(str(error))}") from error
    if unknown := sorted(tables.keys() - {"rig", *TABLES}):
        raise FileError(path, f"{in_short(unknown[0])}: expected rig, [camera] and [projector], and nothing else")
    rig = tables.get("rig")
    if rig is not None and not (isinstance(rig, str) and rig and "\0" not in rig):
        raise FileError(path, f"rig: expected the name of the rig's file, found {in_short(repr(rig))}")
    return Setup(
        camera=_table(tables, "camera", path),
        projector=_table(tables, "projector", path),
        rig=None if rig is None else path.parent / rig,
        path=path,
    )


def in_short(text: str) -> str:
    """Of what stands in a setup, as much as fits into a message of one line.

    >>> in_short("a\\nb" + 200 * "c")[-10:]
    'ccccccc...'
    """
    line = " ".join(text.split())
    return line if len(line) <= LONGEST_SAID else f"{line[: LONGEST_SAID - 3]}..."


def _table(tables: Mapping[str, Any], name: str, path: Path) -> Mapping[str, Any]:
    table = tables.get(name)
    if not isinstance(table, dict):
        raise FileError(path, f"[{name}] is missing: it says which driver to use, one of {', '.join(TABLES[name])}")
    driver = cast("dict[str, Any]", table).get("driver")
    if not isinstance(driver, str) or driver not in TABLES[name]:
        raise FileError(
            path, f"[{name}] driver: expected one of {', '.join(TABLES[name])}, found {in_short(repr(driver))}"
        )
    return cast("dict[str, Any]", table)
