"""The rig as JSON: the format that `retrue` itself reads and writes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np

from retrue.errors import FileError, InputError
from retrue.files.json_values import kind_of, shown
from retrue.geometry.arrays import FloatArray
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.rig import Rig

RIG_FORMAT = "retrue-rig"
LARGEST_RIG_FILE = 4 * 2**20  # bytes; as parsed JSON up to thirty times as much
VERSION = 1
LONGEST_UNIT = 40  # characters


def rig_from_json(path: Path, document: Mapping[str, Any]) -> Rig:
    """The rig in a parsed document of `RIG_FORMAT`; a `FileError` names file and key."""
    version = document.get("version")
    if type(version) is not int or version != VERSION:
        raise FileError(path, f"version: expected {VERSION}, found {shown(version)}; a newer retrue may read it")
    unit = _member(path, document, "unit")
    if not (isinstance(unit, str) and unit.strip() and unit.isprintable() and len(unit) <= LONGEST_UNIT):
        raise FileError(path, f'unit: expected the name of the unit of length, such as "mm", found {shown(unit)}')
    evidence = document.get("evidence", {})
    if not isinstance(evidence, dict):
        raise FileError(path, f"evidence: expected an object, found {kind_of(evidence)}")
    camera = _camera(path, document, "camera")
    projector = _camera(path, document, "projector")
    pose = _object(path, document, "projector_from_camera")
    R = _numbers(path, pose, "R", "projector_from_camera.R")
    t = _numbers(path, pose, "t", "projector_from_camera.t")
    try:
        projector_from_camera = RigidTransform(R, t)
    except InputError as error:
        raise FileError(path, f"projector_from_camera: {error}") from error
    return Rig(camera, projector, projector_from_camera, unit, cast(dict[str, Any], evidence))


def rig_to_json(rig: Rig) -> str:
    """The document, one member a line; every number reads back to the last bit."""
    pose = rig.projector_from_camera
    members = {
        "format": RIG_FORMAT,
        "version": VERSION,
        "unit": rig.unit,
        "camera": _camera_members(rig.camera),
        "projector": _camera_members(rig.projector),
        "projector_from_camera": {"R": pose.R.tolist(), "t": pose.t.tolist()},
        "evidence": dict(rig.evidence),
    }
    try:
        lines = [f"{json.dumps(key)}: {json.dumps(value, allow_nan=False)}" for key, value in members.items()]
    except (TypeError, ValueError, RecursionError) as error:
        raise InputError(f"evidence: expected plain, finite JSON values, found: {error}") from error
    return "{\n  " + ",\n  ".join(lines) + "\n}\n"


def _camera_members(camera: Camera) -> dict[str, Any]:
    return {"size": list(camera.size), "K": camera.K.tolist(), "distortion": camera.distortion.tolist()}


def _camera(path: Path, document: Mapping[str, Any], key: str) -> Camera:
    members = _object(path, document, key)
    size = _numbers(path, members, "size", f"{key}.size")
    K = _numbers(path, members, "K", f"{key}.K")
    distortion = _numbers(path, members, "distortion", f"{key}.distortion")
    try:
        return Camera(cast(tuple[int, int], size), K, distortion)
    except InputError as error:
        raise FileError(path, f"{key}.{error}") from error


def _object(path: Path, document: Mapping[str, Any], key: str) -> dict[str, Any]:
    value = _member(path, document, key)
    if not isinstance(value, dict):
        raise FileError(path, f"{key}: expected an object, found {kind_of(value)}")
    return cast(dict[str, Any], value)


def _member(path: Path, document: Mapping[str, Any], key: str, name: str = "") -> Any:
    if key not in document:
        raise FileError(path, f"{name or key}: expected this key, found none")
    return document[key]


def _numbers(path: Path, members: Mapping[str, Any], key: str, name: str) -> FloatArray:
    value = _member(path, members, key, name)
    if not _is_numbers(value):
        raise FileError(path, f"{name}: expected a list of numbers, found {kind_of(value)}")
    try:
        return np.array(value, dtype=np.float64)
    except (ValueError, OverflowError) as error:
        raise FileError(path, f"{name}: expected rows of equal length of finite numbers, found {error}") from error


def _is_numbers(value: Any, depth: int = 0) -> bool:
    if isinstance(value, list) and depth < 2:
        return all(_is_numbers(item, depth + 1) for item in cast(list[Any], value))
    return depth > 0 and isinstance(value, int | float) and not isinstance(value, bool)
