"""Camera files that nest: Kalibr's camchain, and BoofCV's YAML of one camera or of a stereo pair.

Both put (0, 0) at a pixel centre, as far as their documents tell, and number devices: the first one is the rig's
camera, the second one its projector.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from retrue.errors import FileError, InputError
from retrue.files.foreign_lenses import (
    Distort,
    double_sphere,
    equidistant,
    extended_unified,
    field_of_view,
    fitted_camera,
    radial_tangential,
    unified,
)
from retrue.files.nested_yaml import Node, parse_nested_yaml
from retrue.geometry.arrays import FloatArray
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform

KALIBR_CAMERA = re.compile(r"^cam[0-9]+[ \t]*:", re.MULTILINE)
BOOFCV_MODEL = re.compile(
    r"^[ \t]*model[ \t]*:[ \t]*[\"']?(pinhole\w*|stereo\w*|omnidirectional\w*|kannala\w*)", re.MULTILINE
)


@dataclass(frozen=True, slots=True)
class Devices:
    """What such a file holds.

    Attributes
    ----------
    cameras : of one device or two.
    second_from_first : their pose; None of one device.
    unit : of its translation, where the tool has one; "" where it leaves that to its user.
    """

    tool: str
    cameras: tuple[Camera, ...]
    second_from_first: RigidTransform | None = None
    unit: str = ""


def is_kalibr(text: str) -> bool:
    """Whether this is a camchain."""
    return KALIBR_CAMERA.search(text) is not None and "camera_model" in text


def is_boofcv(text: str) -> bool:
    """Whether BoofCV wrote this."""
    return BOOFCV_MODEL.search(text) is not None and ("pinhole:" in text or "rightToLeft:" in text)


def devices_from_kalibr(path: Path, text: str) -> Devices:
    """The first two cameras of a camchain: T_cn_cnm1 of cam1 takes points of cam0 to cam1, in metres."""
    chain = parse_nested_yaml(path, text)
    names = sorted(name for name in chain.members if re.fullmatch(r"cam[0-9]+", name))
    if len(names) > 2:
        raise FileError(path, f"Kalibr: expected one camera or two, found {', '.join(names)}; keep the two of the rig")
    nodes = [chain.node(name) for name in names]
    cameras = tuple(_kalibr_lens(node) for node in nodes)
    if len(nodes) < 2:
        return Devices("Kalibr", cameras)
    return Devices("Kalibr", cameras, _kalibr_pose(*nodes), "m")


def devices_from_boofcv(path: Path, text: str) -> Devices:
    """One camera; or left and right, whose `rightToLeft` takes points of the right one to the left one."""
    file = parse_nested_yaml(path, text)
    if "left" not in file:
        return Devices("BoofCV", (_boofcv_lens(file),))
    pose = file.node("rightToLeft")
    R, t = pose.numbers("rotation", 9).reshape(3, 3), np.array([pose.number(axis) for axis in "xyz"])
    left_from_right = _rigid(pose, R, t)
    return Devices(
        "BoofCV", tuple(_boofcv_lens(file.node(side)) for side in ("left", "right")), left_from_right.inverse()
    )


def _kalibr_lens(node: Node) -> Camera:
    model, distortion = node.text("camera_model").lower(), node.text("distortion_model").lower()
    first, lengths = _kalibr_intrinsics(node, model)
    size = _size(node, *node.numbers("resolution", 2))
    fx, fy, cx, cy = first[lengths:]
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    bare = distortion in ("none", "")
    coefficients = np.zeros(0) if bare else node.numbers("distortion_coeffs")
    expected = {"radtan": 4, "equidistant": 4, "equi": 4, "fov": 1, "none": 0, "": 0}.get(distortion)
    if expected is None or len(coefficients) != expected:
        raise FileError(
            node.path,
            f"{node.name}: expected distortion_model radtan or equidistant with four distortion_coeffs, fov with one, "
            f"or none; found {distortion[:40]!r} with {len(coefficients)}",
        )
    if model == "pinhole" and distortion in ("radtan", "none", ""):
        return _camera(node, size, K, coefficients)
    name = f"{model}-{distortion or 'none'}"
    after: Distort = {
        "radtan": lambda: radial_tangential(coefficients[:2].tolist(), *coefficients[2:].tolist()),
        "equidistant": lambda: equidistant(coefficients.tolist()),
        "equi": lambda: equidistant(coefficients.tolist()),
        "fov": lambda: field_of_view(float(coefficients[0])),
    }.get(distortion, lambda: radial_tangential([]))()
    own = first[:lengths].tolist()
    if model == "pinhole":
        return _fitted(node, size, K, after, name)
    if model == "omni":
        return _fitted(node, size, K, unified(own[0], after), name)
    if distortion not in ("none", ""):
        raise FileError(node.path, f"{node.name}: expected no distortion beside {model}, found {distortion}")
    return _fitted(node, size, K, (extended_unified if model == "eucm" else double_sphere)(*own), name)


def _kalibr_intrinsics(node: Node, model: str) -> tuple[FloatArray, int]:
    """All intrinsics, and how many of them come before fx, fy, cx, cy."""
    lengths = {"pinhole": 0, "omni": 1, "eucm": 2, "ds": 2}
    if model not in lengths:
        raise FileError(node.path, f"{node.name}.camera_model: expected {', '.join(lengths)}, found {model[:40]!r}")
    return node.numbers("intrinsics", 4 + lengths[model]), lengths[model]


def _kalibr_pose(first: Node, second: Node) -> RigidTransform:
    """cam1 from cam0; from both poses to the IMU where the chain itself is not told."""
    if "T_cn_cnm1" in second or not ("T_cam_imu" in second and "T_cam_imu" in first):
        return _homogeneous(second, "T_cn_cnm1")
    return _homogeneous(second, "T_cam_imu") @ _homogeneous(first, "T_cam_imu").inverse()


def _homogeneous(node: Node, name: str) -> RigidTransform:
    T = node.numbers(name, 16).reshape(4, 4)
    if not np.array_equal(T[3], [0, 0, 0, 1]):
        raise FileError(node.path, f"{node.name}.{name}: expected a last row 0 0 0 1, found {T[3]}")
    return _rigid(node, T[:3, :3], T[:3, 3])


def _rigid(node: Node, R: FloatArray, t: FloatArray) -> RigidTransform:
    try:
        return RigidTransform(R, t)
    except InputError as error:
        raise FileError(node.path, f"{node.name}: {error}") from error


def _boofcv_lens(node: Node) -> Camera:
    model, pinhole = node.text("model"), node.node("pinhole")
    size = _size(node, pinhole.number("width"), pinhole.number("height"))
    fx, fy, cx, cy, skew = (pinhole.number(name) for name in ("fx", "fy", "cx", "cy", "skew"))
    K = np.array([[fx, skew, cx], [0, fy, cy], [0, 0, 1]])
    radial: list[float] = []
    t1 = t2 = 0.0
    if "radial_tangential" in node:
        lens = node.node("radial_tangential")
        radial = lens.numbers("radial").tolist() if "radial" in lens else []
        t1, t2 = (lens.number(name) if name in lens else 0.0 for name in ("t1", "t2"))
    if model.startswith("pinhole"):
        if len(radial) <= 3:
            k1, k2, k3 = [*radial, 0.0, 0.0, 0.0][:3]
            return _camera(node, size, K, np.array([k1, k2, t1, t2, k3]))
        name = f"{len(radial)} radial coefficients"
        return _fitted(node, size, K, radial_tangential(radial, t1, t2), name)
    if model.startswith("omnidirectional"):
        lens = unified(node.number("mirror_offset"), radial_tangential(radial, t1, t2))
        return _fitted(node, size, K, lens, model)
    raise FileError(
        node.path, f"model: BoofCV's {model[:40]!r} is not read; expected a pinhole, omnidirectional or stereo one"
    )


def _size(node: Node, width: float, height: float) -> tuple[int, int]:
    if not (width == round(width) and height == round(height)):
        raise FileError(node.path, f"{node.name}: expected a whole width and height, found {width:g} x {height:g}")
    return int(width), int(height)


def _camera(node: Node, size: tuple[int, int], K: FloatArray, distortion: FloatArray) -> Camera:
    try:
        return Camera(size, K, distortion)
    except InputError as error:
        raise FileError(node.path, f"{node.name}: {error}" if node.name else str(error)) from error


def _fitted(node: Node, size: tuple[int, int], K: FloatArray, distort: Distort, model: str) -> Camera:
    return fitted_camera(node.path, node.name, size, K, distort, model)
