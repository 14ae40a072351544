"""Rig files, ours and other tools': told apart by what they hold, not by how they end."""

from __future__ import annotations

from pathlib import Path

from retrue.errors import FileError, InputError, require_path
from retrue.files.atomic import read_text, replaced_file
from retrue.files.device_formats import camera_from_mrcal, camera_from_ros, is_mrcal, is_ros, mrcal_text, ros_text
from retrue.files.rig_json import LONGEST_UNIT, RIG_FORMAT, parse_json, rig_from_json, rig_to_json
from retrue.files.storage import Storage, Syntax, parse_storage, storage_text
from retrue.files.tool_formats import (
    TOOL_FORMATS,
    Role,
    Size,
    camera_from_storage,
    recognise,
    rig_from_storage,
    settled_size,
    storage_from_rig,
)
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.rig import Rig, require_rig

LARGEST_RIG_FILE = 4 * 2**20  # bytes; as parsed JSON up to thirty times as much
DEVICE_FORMATS = ("ros-camera", "ros-projector", "mrcal-camera", "mrcal-projector")
RIG_FORMATS = ("retrue", *(tool.name for tool in TOOL_FORMATS), *DEVICE_FORMATS)
SYNTAXES: dict[str, Syntax] = {".xml": "xml", ".json": "json", ".yml": "yaml", ".yaml": "yaml"}


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
    if unit is not None and not (unit.strip() and unit.isprintable() and len(unit) <= LONGEST_UNIT):
        raise InputError(f'unit: expected the name of the unit of length, such as "mm", found {unit[:LONGEST_UNIT]!r}')
    content = _content(path)
    if isinstance(content, Camera):
        raise FileError(path, "expected a rig, found one device; use it as known intrinsics of the camera or projector")
    if isinstance(content, Storage):
        return rig_from_storage(content, recognise(content), camera_size, projector_size, unit)
    settled_size(path, "the file", "camera_size", content.camera.size, camera_size)
    settled_size(path, "the file", "projector_size", content.projector.size, projector_size)
    if unit is not None and unit != content.unit:
        raise FileError(path, f"unit: the file says {content.unit!r}, you say {unit!r}")
    return content


def read_device(path: str | Path, role: Role, *, size: Size | None = None) -> Camera:
    """The camera, or the projector, in a rig file of any format, or the one device of a ROS or mrcal file.

    `size` is needed where the format does not store it. Raises `FileError`.
    """
    path = require_path(path, "read_device(path, role)")
    content = _content(path)
    if isinstance(content, Storage):
        return camera_from_storage(content, recognise(content), role, size)
    if isinstance(content, Rig):
        content = content.camera if role == "camera" else content.projector
    settled_size(path, "the file", f"{role}_size", content.size, size)
    return content


def write_rig(path: str | Path, rig: Rig, to: str = "retrue") -> tuple[str, ...]:
    """Write the rig, whole or not at all; every number reads back to the last bit.

    `to` is one of `RIG_FORMATS`. A tool's file is YAML, XML or JSON as its name ends, else as the tool writes it.
    Returns what that format cannot hold and so is lost, for the caller to say. Raises `InputError` for a rig that
    the format cannot express, `FileError` where the file cannot be written.
    """
    path = require_path(path, "write_rig(path, rig)")
    require_rig(rig)
    if to not in RIG_FORMATS:
        raise InputError(f"format: expected one of {', '.join(RIG_FORMATS)}, found {to!r}")
    content, lost = _text(rig, to, SYNTAXES.get(path.suffix.lower()))
    with replaced_file(path) as stream:
        stream.write(content.encode())
    return lost


def _content(path: Path) -> Rig | Camera | Storage:
    text = read_text(path, LARGEST_RIG_FILE)
    if is_mrcal(text):
        return camera_from_mrcal(path, text)
    if text.lstrip().startswith("{") and (document := parse_json(path, text)).get("format") == RIG_FORMAT:
        return rig_from_json(path, document)
    storage = parse_storage(path, text)
    return camera_from_ros(storage) if is_ros(storage) else storage


def _text(rig: Rig, to: str, syntax: Syntax | None) -> tuple[str, tuple[str, ...]]:
    if to == "retrue":
        return rig_to_json(rig), ()
    evidence = ("evidence",) if rig.evidence else ()
    if to in DEVICE_FORMATS:
        tool, role = to.split("-")
        camera = rig.camera if role == "camera" else rig.projector
        other = "projector" if role == "camera" else "camera"
        if tool == "ros":
            return ros_text(camera, role), (other, "projector_from_camera", "unit", *evidence)
        pose = RigidTransform.identity() if role == "camera" else rig.projector_from_camera
        return mrcal_text(camera, pose), (other, "unit", *evidence)
    tool = next(tool for tool in TOOL_FORMATS if tool.name == to)
    sizes = (("camera size", tool.camera_size), ("projector size", tool.projector_size))
    lost = (*(name for name, entries in sizes if entries is None), "unit", *evidence)
    return storage_text(storage_from_rig(rig, tool), syntax or tool.syntax), lost
