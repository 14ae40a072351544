"""Rigs and single devices as other tools have them: what a file holds, and how to write one."""

from __future__ import annotations

from pathlib import Path

from retrue.errors import FileError
from retrue.files.atomic import read_text
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
from retrue.files.rig_json import LARGEST_RIG_FILE
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
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.rig import Rig

DEVICE_FORMATS = ("ros-camera", "ros-projector", "mrcal-camera", "mrcal-projector")
RIG_FORMATS = ("retrue", *(tool.name for tool in TOOL_FORMATS), *DEVICE_FORMATS)
SYNTAXES: dict[str, Syntax] = {".xml": "xml", ".json": "json", ".yml": "yaml", ".yaml": "yaml"}


def foreign_rig(path: Path, text: str, camera_size: Size | None, projector_size: Size | None, unit: str | None) -> Rig:
    """The rig in a tool's file; sizes and unit are what the user says of them."""
    content = _content(path, text)
    if isinstance(content, Camera) or _is_one_device(content):
        raise FileError(path, "expected a rig, found one device; use it as known intrinsics of the camera or projector")
    if isinstance(content, Storage):
        return rig_from_storage(content, recognise(content), camera_size, projector_size, unit)
    return _rig_of_devices(path, content, camera_size, projector_size, unit)


def foreign_device(path: Path, text: str, role: Role, size: Size | None) -> Camera:
    """The device of that role in a tool's file, or the one that it holds; `size` is what the user says of it."""
    content = _content(path, text)
    if isinstance(content, Storage):
        if is_opencv_device(content):
            return camera_from_opencv(content, role, size)
        return camera_from_storage(content, recognise(content, role), role, size)
    camera = content.cameras[0 if role == "camera" else -1] if isinstance(content, Devices) else content
    settled_size(path, "the file", f"{role}_size", camera.size, size)
    return camera


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
    settled_size(path, "the file", "camera_size", camera.size, camera_size)
    settled_size(path, "the file", "projector_size", projector.size, projector_size)
    return rig


def _content(path: Path, text: str) -> Camera | Storage | Devices:
    if is_mrcal(text):
        return camera_from_mrcal(path, text)
    if is_kalibr(text):
        return devices_from_kalibr(path, text)
    if is_boofcv(text):
        return devices_from_boofcv(path, text)
    if text.lstrip().startswith("{"):
        parse_json(path, text)  # says what is wrong with it
    storage = _with_other_half(parse_storage(path, text))
    return camera_from_ros(storage) if is_ros(storage) else storage


def _is_one_device(content: Storage | Devices) -> bool:
    if isinstance(content, Devices):
        return content.second_from_first is None
    return is_opencv_device(content)


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


def rig_text(rig: Rig, to: str, suffix: str) -> tuple[str, tuple[str, ...]]:
    """A file of one of `RIG_FORMATS` whose name ends in that suffix, and what it cannot hold."""
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
    return storage_text(storage_from_rig(rig, tool), SYNTAXES.get(suffix.lower(), tool.syntax)), lost
