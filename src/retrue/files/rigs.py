"""Rig files, ours and other tools': told apart by what they hold, not by how they end."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING
from warnings import warn

import numpy as np

from retrue.errors import FileError, InputError, RetrueWarning, require_choice, require_kind, require_path
from retrue.files.atomic import read_text, replaced_file
from retrue.files.json_values import parse_json
from retrue.files.rig_json import LARGEST_RIG_FILE, LONGEST_UNIT, RIG_FORMAT, rig_from_json, rig_to_json
from retrue.geometry.arrays import whole_size
from retrue.geometry.camera import Camera
from retrue.rig import Rig, require_rig

if TYPE_CHECKING:  # other tools' formats are loaded where a file is of one
    from retrue.files.tool_formats import Role, Size

REACH_GRID = 33  # pixels a side at which a lens is asked for its ray
MOST_BEYOND_REACH = 0.2  # of a picture, before a lens is no calibration


def read_rig(
    path: str | Path, *, camera_size: Size | None = None, projector_size: Size | None = None, unit: str | None = None
) -> Rig:
    """The rig in a file: ours, or one of `TOOL_FORMATS` as OpenCV YAML, XML or JSON.

    Parameters
    ----------
    camera_size, projector_size : (width, height), needed where the format does not store them.
    unit : of T, needed where the format does not store it: none but ours does.

    Raises
    ------
    FileError : names the file, and the key that is missing or wrong; or the argument to give, or the one that
        contradicts the file.
    """
    path = require_path(path, "read_rig(path)")
    camera_size, projector_size = _said(camera_size, "camera_size"), _said(projector_size, "projector_size")
    if unit is not None:
        require_kind(unit, str, "unit")
    if unit is not None and not (unit.strip() and unit.isprintable() and len(unit) <= LONGEST_UNIT):
        raise InputError(f'unit: expected the name of the unit of length, such as "mm", found {unit[:LONGEST_UNIT]!r}')
    text = read_text(path, LARGEST_RIG_FILE)
    rig = _ours(path, text)
    if rig is None:
        from retrue.files.foreign_rigs import foreign_rig

        rig = foreign_rig(path, text, camera_size, projector_size, unit)
    else:
        _require_size(path, "camera_size", rig.camera, camera_size)
        _require_size(path, "projector_size", rig.projector, projector_size)
        if unit is not None and unit != rig.unit:
            raise FileError(path, f"unit: the file says {rig.unit!r}, you say {unit!r}")
    for role, camera in (("camera", rig.camera), ("projector", rig.projector)):
        check_reach(path, role, camera)
    return rig


def read_device(path: str | Path, role: Role, *, size: Size | None = None) -> Camera:
    """The camera, or the projector, in a rig file of any format, or the one device of a file that holds one.

    `size` is needed where the format does not store it. Raises `FileError`.
    """
    path, size = require_path(path, "read_device(path, role)"), _said(size, "size")
    require_choice(role, ("camera", "projector"), "role")
    text = read_text(path, LARGEST_RIG_FILE)
    rig = _ours(path, text)
    if rig is None:
        from retrue.files.foreign_rigs import foreign_device

        camera = foreign_device(path, text, role, size)
    else:
        camera = rig.camera if role == "camera" else rig.projector
        _require_size(path, f"{role}_size", camera, size)
    check_reach(path, role, camera)
    return camera


def check_reach(path: Path, role: str, camera: Camera) -> None:
    """Warns of a lens that folds, or has a pole, inside its own picture: what lies beyond has no ray.

    Raises `FileError` where that is more than `MOST_BEYOND_REACH` of it: such a lens is no calibration.
    """
    pixels = np.stack(np.meshgrid(*(np.linspace(0, side - 1, REACH_GRID) for side in camera.size)), axis=-1)
    lost = ~np.isfinite(camera.unproject(pixels)).all(axis=-1)
    if not lost.any():
        return
    middle = camera.K[:2, 2]
    radius = float(np.linalg.norm(pixels[lost] - middle, axis=-1).min())
    message = (
        f"{role}: the lens model reaches only {100 * (1 - lost.mean()):.0f} % of the picture: it folds, or has a "
        f"pole, {radius:.0f} px from its centre; calibrate again, with fewer coefficients, or the board in the corners"
    )
    if lost.mean() > MOST_BEYOND_REACH:
        raise FileError(path, message)
    warn(f"{path}: {message}", RetrueWarning, stacklevel=3)


def _said(size: Size | None, name: str) -> Size | None:
    return None if size is None else whole_size(size, name)


def write_rig(path: str | Path, rig: Rig, to: str = "retrue") -> tuple[str, ...]:
    """Write the rig, whole or not at all; every number reads back to the last bit.

    `to` is one of `foreign_rigs.RIG_FORMATS`. A tool's file is YAML, XML or JSON as its name ends, else as the tool
    writes it. Returns what that format cannot hold and so is lost, for the caller to say. Raises `InputError` for a
    rig that the format cannot express, `FileError` where the file cannot be written.
    """
    path = require_path(path, "write_rig(path, rig)")
    require_rig(rig)
    content, lost = rig_to_json(rig), tuple[str, ...]()
    require_kind(to, str, "format")
    if to != "retrue":
        from retrue.files.foreign_rigs import RIG_FORMATS, rig_text

        require_choice(to, RIG_FORMATS, "format")
        content, lost = rig_text(rig, to, path.suffix)
    with replaced_file(path) as stream:
        stream.write(content.encode())
    return lost


def _ours(path: Path, text: str) -> Rig | None:
    """The rig, where the file is of our own format."""
    if not text.lstrip().startswith("{"):
        return None
    try:
        document = parse_json(path, text)
    except FileError:  # other tools' files may begin so, too
        return None
    return rig_from_json(path, document) if document.get("format") == RIG_FORMAT else None


def _require_size(path: Path, name: str, device: Camera, size: Size | None) -> None:
    if size is not None:
        from retrue.files.tool_formats import settled_size

        settled_size(path, "the file", name, device.size, size)
