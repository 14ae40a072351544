"""Rig files, ours and other tools': told apart by what they hold, not by how they end."""

from __future__ import annotations

from pathlib import Path
from warnings import warn

import numpy as np

from retrue.errors import FileError, InputError, RetrueWarning, require_choice, require_kind, require_path
from retrue.files.atomic import read_text, replaced_file
from retrue.files.device_formats import (
    camera_from_mrcal,
    camera_from_opencv,
    camera_from_ros,
    is_mrcal,
    is_opencv_device,
    is_ros,
    mrcal_text,
    ros_text,
)
from retrue.files.json_values import parse_json
from retrue.files.nested_formats import Devices, devices_from_boofcv, devices_from_kalibr, is_boofcv, is_kalibr
from retrue.files.rig_json import LONGEST_UNIT, RIG_FORMAT, rig_from_json, rig_to_json
from retrue.files.storage import Storage, Syntax, parse_storage, storage_text
from retrue.files.tool_formats import (
    TOOL_FORMATS,
    Role,
    Size,
    asking,
    camera_from_storage,
    recognise,
    rig_from_storage,
    settled_size,
    storage_from_rig,
)
from retrue.geometry.arrays import whole_size
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.rig import Rig, require_rig

REACH_GRID = 33  # pixels a side at which a lens is asked for its ray
MOST_BEYOND_REACH = 0.2  # of a picture, before a lens is no calibration
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
    camera_size, projector_size = _said(camera_size, "camera_size"), _said(projector_size, "projector_size")
    if unit is not None:
        require_kind(unit, str, "unit")
    if unit is not None and not (unit.strip() and unit.isprintable() and len(unit) <= LONGEST_UNIT):
        raise InputError(f'unit: expected the name of the unit of length, such as "mm", found {unit[:LONGEST_UNIT]!r}')
    content = _content(path)
    if isinstance(content, Camera) or _is_one_device(content):
        raise FileError(path, "expected a rig, found one device; use it as known intrinsics of the camera or projector")
    if isinstance(content, Storage):
        rig = rig_from_storage(content, recognise(content), camera_size, projector_size, unit)
    elif isinstance(content, Devices):
        rig = _rig_of_devices(path, content, camera_size, projector_size, unit)
    else:
        rig = _settled(path, content, camera_size, projector_size)
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
    content = _content(path)
    if isinstance(content, Storage):
        if is_opencv_device(content):
            camera = camera_from_opencv(content, role, size)
        else:
            camera = camera_from_storage(content, recognise(content, role), role, size)
    else:
        if isinstance(content, Devices):
            camera = content.cameras[0 if role == "camera" else -1]
        elif isinstance(content, Rig):
            camera = content.camera if role == "camera" else content.projector
        else:
            camera = content
        settled_size(path, "the file", f"{role}_size", camera.size, size)
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


def _settled(path: Path, rig: Rig, camera_size: Size | None, projector_size: Size | None) -> Rig:
    settled_size(path, "the file", "camera_size", rig.camera.size, camera_size)
    settled_size(path, "the file", "projector_size", rig.projector.size, projector_size)
    return rig


def _rig_of_devices(
    path: Path, devices: Devices, camera_size: Size | None, projector_size: Size | None, unit: str | None
) -> Rig:
    """Of two devices and their pose; what the user says of the unit goes before what the tool does."""
    assert devices.second_from_first is not None
    unit = unit or devices.unit
    if not unit:
        raise asking(path, devices.tool, {"unit": None})
    camera, projector = devices.cameras
    rig = Rig(camera, projector, devices.second_from_first, unit)
    return _settled(path, rig, camera_size, projector_size)


def write_rig(path: str | Path, rig: Rig, to: str = "retrue") -> tuple[str, ...]:
    """Write the rig, whole or not at all; every number reads back to the last bit.

    `to` is one of `RIG_FORMATS`. A tool's file is YAML, XML or JSON as its name ends, else as the tool writes it.
    Returns what that format cannot hold and so is lost, for the caller to say. Raises `InputError` for a rig that
    the format cannot express, `FileError` where the file cannot be written.
    """
    path = require_path(path, "write_rig(path, rig)")
    require_rig(rig)
    require_choice(to, RIG_FORMATS, "format")
    content, lost = _text(rig, to, SYNTAXES.get(path.suffix.lower()))
    with replaced_file(path) as stream:
        stream.write(content.encode())
    return lost


def _content(path: Path) -> Rig | Camera | Storage | Devices:
    text = read_text(path, LARGEST_RIG_FILE)
    if is_mrcal(text):
        return camera_from_mrcal(path, text)
    if is_kalibr(text):
        return devices_from_kalibr(path, text)
    if is_boofcv(text):
        return devices_from_boofcv(path, text)
    if text.lstrip().startswith("{") and (document := parse_json(path, text)).get("format") == RIG_FORMAT:
        return rig_from_json(path, document)
    storage = _with_other_half(parse_storage(path, text))
    return camera_from_ros(storage) if is_ros(storage) else storage


def _is_one_device(content: Rig | Storage | Devices) -> bool:
    if isinstance(content, Devices):
        return content.second_from_first is None
    return isinstance(content, Storage) and is_opencv_device(content)


def _with_other_half(storage: Storage) -> Storage:
    """With the pose of `extrinsics.yml`, or the devices of `intrinsics.yml`: OpenCV's stereo sample writes both."""
    halves = ("intrinsics", {"M1", "D1", "M2", "D2"}), ("extrinsics", {"R", "T"})
    for (here, names), (there, wanted) in (halves, halves[::-1]):
        if here in storage.path.name and names <= set(storage.entries) and not wanted <= set(storage.entries):
            other = storage.path.with_name(storage.path.name.replace(here, there))
            if other.is_file():
                found = parse_storage(other, read_text(other, LARGEST_RIG_FILE)).entries
                return Storage(storage.path, {**found, **storage.entries})
    return storage


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
