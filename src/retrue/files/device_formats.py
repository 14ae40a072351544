"""Files of one device: OpenCV's calibration samples, ROS camera_info, mrcal's cameramodel.

All put (0, 0) at a pixel centre, as we do.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from retrue.errors import FileError, InputError
from retrue.files.storage import Storage
from retrue.files.tool_formats import Role, Size, device, settled_size
from retrue.geometry.arrays import LARGEST_SIDE, FloatArray, whole_size
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform, vector_from_rotation

OPENCV_NAMES = (
    ("camera_matrix", "Camera_Matrix", "cameraMatrix", "camera_Matrix", "CameraMatrix"),
    ("distortion_coefficients", "Distortion_Coefficients", "dist_coeffs", "distCoeffs", "dist_coeff", "distortion"),
)
"""Of K and of the distortion: the calibration samples of OpenCV 2 to 5, its interactive tool, its tutorials."""
OPENCV_SIZES = (
    ("image_width", "image_height"),
    ("image_Width", "image_Height"),
    ("cameraResolution",),
    ("image_size",),
)


def is_opencv_device(storage: Storage) -> bool:
    """Whether this is what a calibration of one camera by OpenCV's samples leaves."""
    return all(any(name in storage for name in names) for names in OPENCV_NAMES)


def camera_from_opencv(storage: Storage, role: Role, size: Size | None) -> Camera:
    """The device; `size` where the file does not say. With `fisheye_model: 1`, the distortion is OpenCV's fisheye's."""
    K_name, distortion_name = (_first(storage, *names) for names in OPENCV_NAMES)
    K, distortion = storage.matrix(K_name, 3, 3), storage.numbers(distortion_name)
    names = next((names for names in OPENCV_SIZES if all(name in storage for name in names)), ())
    stored: Size | None = None
    if names:
        sides = np.concatenate([storage.numbers(name) for name in names])
        if sides.size != 2 or not ((sides == np.round(sides)) & (sides >= 1) & (sides <= LARGEST_SIDE)).all():
            raise FileError(storage.path, f"{', '.join(names)}: expected width and height, found {sides[:4]}")
        stored = int(sides[0]), int(sides[1])
    size = settled_size(storage.path, "OpenCV's file of one camera", f"{role}_size", stored, size)
    fisheye = "fisheye_model" in storage and storage.text("fisheye_model") in ("1", "true")
    return device(storage.path, K_name, size, K, distortion, fisheye=fisheye)


ROS_MODELS = {"plumb_bob": 5, "rational_polynomial": 8}
"""ROS's names for OpenCV's distortion, and how many coefficients each has."""
ROS_FISHEYES = ("equidistant", "fisheye")
"""Its names for the distortion of OpenCV's fisheye model."""


def is_ros(storage: Storage) -> bool:
    """Whether this is a camera_info file, or a printed CameraInfo message."""
    return "distortion_model" in storage and ("camera_matrix" in storage or "K" in storage or "k" in storage)


def camera_from_ros(storage: Storage) -> Camera:
    """The device; from the K and D of the raw picture, not from the rectified P."""
    model = storage.text("distortion_model")
    if model not in ROS_MODELS and model not in ROS_FISHEYES:
        raise FileError(
            storage.path, f"distortion_model: expected {', '.join((*ROS_MODELS, *ROS_FISHEYES))}, found {model[:40]!r}"
        )
    K = storage.matrix(_first(storage, "camera_matrix", "K", "k"), 3, 3)
    distortion = storage.numbers(_first(storage, "distortion_coefficients", "D", "d"))
    width = storage.vector(_first(storage, "image_width", "width"), 1)[0]
    height = storage.vector(_first(storage, "image_height", "height"), 1)[0]
    try:
        size = whole_size((width, height), "size")
    except InputError as error:
        raise FileError(storage.path, str(error)) from error
    return device(storage.path, "", size, K, distortion, fisheye=model in ROS_FISHEYES)


def ros_text(camera: Camera, name: str) -> str:
    """A camera_info file; R is the identity and P = [K 0]: nothing is rectified."""
    models = {count: model for model, count in ROS_MODELS.items()}
    if len(camera.distortion) not in models:
        raise InputError(f"distortion: ROS holds 5 or 8 coefficients, this lens has {len(camera.distortion)}")
    P = np.hstack([camera.K, np.zeros((3, 1))])
    return (
        f"image_width: {camera.size[0]}\nimage_height: {camera.size[1]}\ncamera_name: {name}\n"
        + _ros_matrix("camera_matrix", camera.K)
        + f"distortion_model: {models[len(camera.distortion)]}\n"
        + _ros_matrix("distortion_coefficients", camera.distortion.reshape(1, -1))
        + _ros_matrix("rectification_matrix", np.eye(3))
        + _ros_matrix("projection_matrix", P)
    )


MRCAL_MODELS = {f"LENSMODEL_OPENCV{count}": count for count in (4, 5, 8, 12)} | {"LENSMODEL_PINHOLE": 0}


def is_mrcal(text: str) -> bool:
    """Whether this is a cameramodel: the text of a Python dictionary with a lens model."""
    return re.search(r"""^[ \t{]*["']lensmodel["']\s*:""", text, re.MULTILINE) is not None


def camera_from_mrcal(path: Path, text: str) -> Camera:
    """The device. The file is Python text; only the entries that we need are looked for, nothing is evaluated."""
    text = re.sub(r"^[ \t]*#.*$", "", text, flags=re.MULTILINE)
    model = re.search(r"""["']lensmodel["']\s*:\s*["']([\w.=-]{1,200})["']""", text)
    name = model[1] if model else "none"
    if name not in MRCAL_MODELS:
        raise FileError(path, f"lensmodel: expected one of {', '.join(sorted(MRCAL_MODELS))}, found {name[:60]}")
    intrinsics = _mrcal_numbers(path, text, "intrinsics")
    if len(intrinsics) != 4 + MRCAL_MODELS[name]:
        raise FileError(path, f"intrinsics: expected {4 + MRCAL_MODELS[name]} numbers, found {len(intrinsics)}")
    size = _mrcal_numbers(path, text, "imagersize")
    fx, fy, cx, cy = intrinsics[:4]
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    try:
        return Camera((size[0], size[-1]), K, intrinsics[4:])
    except InputError as error:
        raise FileError(path, str(error)) from error


def mrcal_text(camera: Camera, device_from_camera: RigidTransform) -> str:
    """A cameramodel whose reference frame is the rig's camera."""
    if camera.K[0, 1] != 0:
        raise InputError(f"K: mrcal has no skew, this device has {camera.K[0, 1]:g}")
    rt = [*vector_from_rotation(device_from_camera.R).tolist(), *device_from_camera.t.tolist()]
    K = camera.K
    intrinsics = [K[0, 0], K[1, 1], K[0, 2], K[1, 2], *camera.distortion]
    return (
        f"{{\n    'lensmodel':  'LENSMODEL_OPENCV{len(camera.distortion)}',\n\n"
        "    # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....\n"
        f"    'intrinsics': [ {_row(intrinsics)}],\n\n"
        f"    # extrinsics are rt_fromref\n    'extrinsics': [ {_row(rt)}],\n\n"
        f"    'imagersize': [ {camera.size[0]}, {camera.size[1]},]\n}}\n"
    )


def _first(storage: Storage, *names: str) -> str:
    return next((name for name in names if name in storage), names[0])


def _ros_matrix(name: str, matrix: FloatArray) -> str:
    rows, cols = matrix.shape
    data = ", ".join(map(repr, matrix.ravel().tolist()))
    return f"{name}:\n  rows: {rows}\n  cols: {cols}\n  data: [{data}]\n"


def _mrcal_numbers(path: Path, text: str, name: str) -> FloatArray:
    found = re.search(rf"""["']{name}["']\s*:\s*[\[(]([^\[\](){{}}]*)[\])]""", text)
    words = re.sub(r"#.*", "", found[1]).replace(",", " ").split() if found else []
    try:
        numbers = [float(word) for word in words[:100]]
    except ValueError as error:
        raise FileError(path, f"{name}: expected numbers, found {error}") from error
    if len(numbers) < 2:
        raise FileError(path, f"{name}: expected a list of numbers, found {len(numbers)}")
    return np.array(numbers, dtype=np.float64)


def _row(numbers: Sequence[float]) -> str:
    return "".join(f"{float(number)!r}, " for number in numbers)
