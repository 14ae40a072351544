"""The rig files of other tools: which entry of an OpenCV FileStorage holds what, and in whose convention.

All of them store X_projector = R X_camera + T, and OpenCV's distortion order. None stores a unit of length.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from retrue.errors import FileError, InputError
from retrue.files.foreign_lenses import equidistant, fitted_camera, tilted
from retrue.files.storage import Storage, Syntax, Value
from retrue.geometry.arrays import FloatArray
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform, skew
from retrue.rig import Rig

Role = Literal["camera", "projector"]
Size = tuple[int, int]


@dataclass(frozen=True, slots=True)
class SizeEntries:
    """Where a picture size stands: one entry of two numbers, or two entries of one, (width, height)."""

    names: tuple[str, ...]
    height_first: bool = False


@dataclass(frozen=True, slots=True)
class ToolFormat:
    """One tool's entries.

    Attributes
    ----------
    camera, projector : names of K and of the distortion.
    R, T : names of the pose; the first is written, any is read.
    camera_size, projector_size : None where the tool does not store it.
    first_pixel : coordinate of the centre of the top-left pixel: 0, or 1 where the tool counts as MATLAB does.
    most_distortion : coefficients that the tool can read back.
    essential : whether the tool refuses a file that lacks E and F.
    syntax : the one that the tool itself writes.
    """

    name: str
    camera: tuple[str, str]
    projector: tuple[str, str]
    R: tuple[str, ...] = ("R",)
    T: tuple[str, ...] = ("T",)
    camera_size: SizeEntries | None = None
    projector_size: SizeEntries | None = None
    first_pixel: int = 0
    most_distortion: int = 12
    essential: bool = False
    syntax: Syntax = "yaml"


TOOL_FORMATS = (
    ToolFormat("scan3d-capture", ("cam_K", "cam_kc"), ("proj_K", "proj_kc"), essential=True),
    ToolFormat(
        "procam-calibration",
        ("cam_int", "cam_dist"),
        ("proj_int", "proj_dist"),
        R=("roration", "rotation"),  # the tool's own spelling, by which its readers find it
        T=("translation",),
        camera_size=SizeEntries(("img_shape",), height_first=True),
        syntax="xml",
    ),
    ToolFormat("single-shot-pro-cam-calib", ("camK", "camKc"), ("prjK", "prjKc"), first_pixel=1),
    ToolFormat(
        "slstudio",
        ("Kc", "kc"),
        ("Kp", "kp"),
        R=("Rp",),
        T=("Tp",),
        camera_size=SizeEntries(("frameWidth", "frameHeight")),
        projector_size=SizeEntries(("screenResX", "screenResY")),
        most_distortion=5,
        syntax="xml",
    ),
    ToolFormat(
        "sltk",
        ("cam_K", "cam_kc"),
        ("pro_K", "pro_kc"),
        camera_size=SizeEntries(("cam_size",)),
        projector_size=SizeEntries(("pro_size",)),
    ),
    ToolFormat(
        "slmaster",
        ("M1", "D1"),
        ("M4", "D4"),
        R=("Rlp",),
        T=("Tlp",),
        camera_size=SizeEntries(("S",)),
        most_distortion=5,
    ),
    ToolFormat("opencv-stereo", ("M1", "D1"), ("M2", "D2"), camera_size=SizeEntries(("imageSize",))),
    ToolFormat("stereo-calibration", ("K1", "D1"), ("K2", "D2")),
)
FEWEST_MATCHING = 4
"""Of a tool's six entries: a format is guessed only where most of them are there."""


def recognise(storage: Storage, role: Role | None = None) -> ToolFormat:
    """The tool whose entries these are, all six or the two of one device; a `FileError` says what the nearest lacks."""

    def missing(tool: ToolFormat) -> list[str]:
        pose = [tool.R, tool.T] if role is None else []
        devices = {"camera": tool.camera, "projector": tool.projector}
        names = [name for each, both in devices.items() if role in (None, each) for name in both]
        needed = [(name,) for name in names] + pose
        return [" or ".join(names) for names in needed if not any(name in storage for name in names)]

    nearest = min(TOOL_FORMATS, key=lambda tool: len(missing(tool)))
    lacking = missing(nearest)
    if not lacking:
        return nearest
    most = 6 - FEWEST_MATCHING if role is None else 1
    if len(lacking) > most:
        raise FileError(storage.path, _unknown(storage))
    hint = ""
    if nearest.name == "opencv-stereo" and lacking == ["R", "T"]:
        hint = ": the sample writes them to two files, intrinsics and extrinsics; put both into one folder, or one file"
    raise FileError(storage.path, f"looks like {nearest.name}, but {', '.join(lacking)} is missing{hint}")


def _unknown(storage: Storage) -> str:
    names = ", ".join(tool.name for tool in TOOL_FORMATS)
    held = ", ".join(list(storage.entries)[:8])
    return f"expected a rig of retrue, {names}, Kalibr or BoofCV, or one device of OpenCV, ROS or mrcal; found " + (
        f"entries {held[:120]}" if held else "none"
    )


def rig_from_storage(
    storage: Storage, tool: ToolFormat, camera_size: Size | None, projector_size: Size | None, unit: str | None
) -> Rig:
    """The rig; what the tool does not store must be handed in, and must not contradict what it does."""
    needed: dict[str, Size | str | None] = {"unit": unit}
    sizes: tuple[tuple[Role, Size | None], ...] = (("projector", projector_size), ("camera", camera_size))
    for role, size in sizes:
        if _size(storage, tool, role) is None:
            needed = {f"{role}_size": size, **needed}
    if unit is None or None in needed.values():
        raise asking(storage.path, tool.name, needed)
    camera = camera_from_storage(storage, tool, "camera", camera_size)
    projector = camera_from_storage(storage, tool, "projector", projector_size)
    R = storage.matrix(next(name for name in tool.R if name in storage), 3, 3)
    t = storage.vector(next(name for name in tool.T if name in storage), 3)
    try:
        return Rig(camera, projector, RigidTransform(R, t), unit)
    except InputError as error:
        raise FileError(storage.path, str(error)) from error


def camera_from_storage(storage: Storage, tool: ToolFormat, role: Role, size: Size | None) -> Camera:
    """One device of the rig."""
    K_name, distortion_name = tool.camera if role == "camera" else tool.projector
    K = storage.matrix(K_name, 3, 3)
    K[:2, 2] -= tool.first_pixel
    distortion = storage.numbers(distortion_name)
    size = settled_size(storage.path, tool.name, f"{role}_size", _size(storage, tool, role), size)
    return device(storage.path, f"{K_name}, {distortion_name}", size, K, distortion)


def storage_from_rig(rig: Rig, tool: ToolFormat) -> dict[str, Value]:
    """The entries that the tool reads."""
    pose = rig.projector_from_camera
    entries: dict[str, Value] = {}
    for role, names in (("camera", tool.camera), ("projector", tool.projector)):
        camera = rig.camera if role == "camera" else rig.projector
        distortion = camera.distortion
        if len(distortion) > tool.most_distortion:
            most = tool.most_distortion
            raise InputError(f"{role}.distortion: {tool.name} holds {most} coefficients, this has {len(distortion)}")
        K = camera.K.copy()
        K[:2, 2] += tool.first_pixel
        entries |= {names[0]: K, names[1]: distortion.reshape(1, -1)}
        entries |= dict(_size_entries(camera.size, tool.camera_size if role == "camera" else tool.projector_size))
    entries |= {tool.R[0]: pose.R, tool.T[0]: pose.t.reshape(3, 1)}
    if tool.essential:
        E = skew(pose.t) @ pose.R
        F = np.linalg.inv(rig.projector.K).T @ E @ np.linalg.inv(rig.camera.K)
        entries |= {"E": E, "F": F}
    return entries


def device(
    path: Path, name: str, size: Size, K: FloatArray, distortion: FloatArray, *, fisheye: bool = False
) -> Camera:
    """The camera of OpenCV's K and distortion; a fit of it where its terms are others than ours: fisheye, tilt."""
    if fisheye and len(distortion) != 4:
        raise FileError(path, f"expected four coefficients of a fisheye, found {len(distortion)}")
    if fisheye:
        return fitted_camera(path, name, size, K, equidistant(distortion.tolist()), "fisheye")
    if len(distortion) == 14 and distortion[12:].any():
        return fitted_camera(path, name, size, K, tilted(distortion), "tilted sensor", thin_prism=True)
    try:
        return Camera(size, K, distortion[:12] if len(distortion) == 14 else distortion)
    except InputError as error:
        raise FileError(path, f"{name}: {error}" if name else str(error)) from error


def asking(path: Path, tool: str, needed: Mapping[str, Size | str | None]) -> FileError:
    """For what the file does not hold, and nobody may invent; of `needed`, what is None has not been said."""
    lacking = ", ".join(name for name, value in needed.items() if value is None)
    flags = " ".join(_flag(name, value) for name, value in needed.items())
    return FileError(path, f"{tool} does not store {lacking}: add it once, by retrue convert {path} B.json {flags}")


def _flag(name: str, value: Size | str | None) -> str:
    words = value if value is not None else "mm" if name == "unit" else ("W", "H")
    return " ".join(["--" + name.replace("_", "-"), *([words] if isinstance(words, str) else map(str, words))])


def settled_size(path: Path, tool: str, name: str, stored: Size | None, given: Size | None) -> Size:
    """The size that file and caller agree on; never a guess."""
    if stored is None and given is None:
        raise asking(path, tool, {name: None})
    if stored is not None and given is not None and tuple(given) != stored:
        said, wanted = (f"{width} x {height}" for width, height in (stored, given))
        raise FileError(path, f"{name}: the file says {said}, but it is {wanted}: is this the device's own file?")
    return stored or (given if given is not None else (0, 0))


def _size(storage: Storage, tool: ToolFormat, role: Role) -> Size | None:
    entries = tool.camera_size if role == "camera" else tool.projector_size
    # A fork of scan3d-capture writes procam-calibration's entries as JSON, with the same picture size whatever
    # the camera; its own entry `stereo_error` gives it away.
    if entries is None or (entries.height_first and "stereo_error" in storage):
        return None
    if not all(name in storage for name in entries.names):
        return None
    values = np.concatenate([storage.numbers(name) for name in entries.names])
    if values.size != 2 or not ((values == np.round(values)) & (values >= 1) & (values <= 1_000_000)).all():
        raise FileError(storage.path, f"{', '.join(entries.names)}: expected width and height, found {values[:4]}")
    width, height = values[::-1] if entries.height_first else values
    return int(width), int(height)


def _size_entries(size: Size, entries: SizeEntries | None) -> Iterator[tuple[str, Value]]:
    if entries is None:
        return
    ordered = size[::-1] if entries.height_first else size
    if len(entries.names) == 1:
        yield entries.names[0], np.array(ordered, dtype=np.float64)
    else:
        yield from zip(entries.names, ordered, strict=True)
