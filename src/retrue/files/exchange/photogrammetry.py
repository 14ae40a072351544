"""A scan as folders that COLMAP and nerfstudio start from: cameras, poses, pictures, points.

Both put (0, 0) at the corner of the top-left pixel, so that its centre is (0.5, 0.5): half a pixel is added on the way
out. The world is the cloud's frame, which for one capture is the rig's camera.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retrue.errors import FileError, InputError, require_kinds, require_path
from retrue.files.atomic import replaced_file
from retrue.files.exchange.depth_maps import DEPTH_SCALE, write_depth_map
from retrue.files.images import write_png
from retrue.geometry.arrays import FloatArray, Image, require_picture
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.reconstruction.cloud import Cloud, require_cloud
from retrue.rig import Rig, require_rig
from retrue.units import metres_per

HALF = 0.5
VIEW_FROM_DEVICE = np.diag([1.0, -1.0, -1.0])  # nerfstudio's cameras look along -z, y up, as OpenGL's do


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One picture, and where it was taken from.

    Attributes
    ----------
    name : of its file, without the ending; one word, which COLMAP's lists of words can hold, of this view alone.
    camera : its intrinsics.
    device_from_world : its pose, in the cloud's unit.
    pixels : (N, 2) where it sees each point of the cloud; NaN where it does not.
    picture : (h, w) or (h, w, 3); None: no file is written.
    depth : (h, w) as by `depth_map`; None: unknown.
    """

    name: str
    camera: Camera
    device_from_world: RigidTransform
    pixels: FloatArray
    picture: Image | None = None
    depth: FloatArray | None = None


def rig_views(
    rig: Rig,
    cloud: Cloud,
    photograph: Image | None,
    shown: Image | None,
    depth: FloatArray | None = None,
    shown_depth: FloatArray | None = None,
) -> tuple[View, View]:
    """The camera, with its photograph; and the projector, a camera run backwards, with what it showed.

    `depth` and `shown_depth` are the surface's on the pixels of both (`depth_map`).
    """
    require_rig(rig)
    require_cloud(cloud)
    for name, picture in (("photograph", photograph), ("shown", shown)):
        if picture is not None:
            require_picture(picture, name)
    projector_px = rig.projector.project(rig.projector_from_camera.apply(cloud.points))
    camera = View("camera", rig.camera, RigidTransform.identity(), cloud.camera_px, photograph, depth)
    return camera, View("projector", rig.projector, rig.projector_from_camera, projector_px, shown, shown_depth)


def write_colmap(folder: str | Path, cloud: Cloud, views: Sequence[View]) -> None:
    """`sparse/0/cameras.txt`, `images.txt`, `points3D.txt` and `images/`, in the cloud's unit.

    Source: COLMAP, "Output format"; its camera models OPENCV (k1 k2 p1 p2) and FULL_OPENCV (and k3 k4 k5 k6).

    Raises
    ------
    InputError : views that do not suit each other or the cloud, or a lens with skew or thin prisms, which COLMAP cannot
        hold. `FileError` : it cannot be written.
    """
    folder = require_path(folder, "write_colmap(folder, cloud, views)")
    require_cloud(cloud)
    _require_views(views, cloud)
    cameras = [_colmap_camera(number, view) for number, view in enumerate(views, start=1)]
    sparse = _made(folder / "sparse" / "0")
    _write_lines(sparse / "cameras.txt", cameras)
    seen = [np.flatnonzero(np.isfinite(view.pixels).all(axis=1)) for view in views]
    images: list[str] = []
    for number, (view, rows) in enumerate(zip(views, seen, strict=True), start=1):
        pose = " ".join(map(repr, [*_quaternion(view.device_from_world.R), *view.device_from_world.t.tolist()]))
        images.append(f"{number} {pose} {number} {view.name}.png")
        pixels = (view.pixels[rows] + HALF).tolist()
        images.append(" ".join(f"{x:.9g} {y:.9g} {row + 1}" for (x, y), row in zip(pixels, rows.tolist(), strict=True)))
    _write_lines(sparse / "images.txt", images)
    _write_lines(sparse / "points3D.txt", _colmap_points(cloud, views, seen))
    _write_pictures(folder / "images", views)


def write_nerfstudio(folder: str | Path, cloud: Cloud, views: Sequence[View]) -> None:
    """`transforms.json`, `images/`, `depth/` and the points as `points.ply`, all in metres.

    Source: nerfstudio, "Data conventions". Views without a picture are left out: there is nothing to learn
    from them. It takes depths of all frames or of none, so that a frame without any gets a map that knows nothing.

    Raises
    ------
    InputError : views that do not suit each other or the cloud, none with a picture, a lens that it cannot hold, or a
        unit of unknown length.
    """
    from retrue.files.ply import write_cloud

    folder = require_path(folder, "write_nerfstudio(folder, cloud, views)")
    require_cloud(cloud)
    _require_views(views, cloud)
    metres = metres_per(cloud.unit)
    views = [view for view in views if view.picture is not None]
    if not views:
        raise InputError("nerfstudio: expected a view with a picture, found none; hand in pictures, not a CSV")
    frames = [_nerfstudio_frame(view, metres) for view in views]
    _made(folder)
    _write_pictures(folder / "images", views)
    if any(view.depth is not None for view in views):
        for view, frame in zip(views, frames, strict=True):
            frame["depth_file_path"] = f"depth/{view.name}.png"
            depth = np.full(view.camera.size[::-1], np.nan) if view.depth is None else view.depth
            write_depth_map(_made(folder / "depth") / f"{view.name}.png", depth, view.camera, cloud.unit)
    in_metres = Cloud(cloud.points * metres, cloud.colors, cloud.camera_px, "m")
    write_cloud(folder / "points.ply", in_metres)
    whole = {"camera_model": "OPENCV", "ply_file_path": "points.ply", "depth_unit_scale_factor": 1 / DEPTH_SCALE}
    with replaced_file(folder / "transforms.json") as stream:
        stream.write(json.dumps({**whole, "frames": frames}, indent=1).encode())


def _require_views(views: Sequence[View], cloud: Cloud) -> None:
    require_kinds(views, View, "views", "retrue.rig_views makes them")
    names = [view.name for view in views]
    for view in views:
        if not re.fullmatch(r"[^\s/\\]+", view.name) or names.count(view.name) > 1:
            raise InputError(f"views: expected names of one word each, all different, found {view.name!r} in {names}")
        if len(view.pixels) != len(cloud):
            raise InputError(f"{view.name}: expected a pixel of each of {len(cloud)} points, found {len(view.pixels)}")
        raster = None if view.picture is None else (view.picture.shape[1], view.picture.shape[0])
        if raster not in (None, view.camera.size):
            found, expected = (f"{width} x {height}" for width, height in (raster, view.camera.size))
            raise InputError(f"{view.name}: expected a picture of the camera's {expected} pixels, found {found}")


def _colmap_camera(number: int, view: View) -> str:
    camera = view.camera
    k1, k2, p1, p2, k3, *more = _lens(view, "COLMAP", 8)
    lens = ("OPENCV", [k1, k2, p1, p2]) if not any([k3, *more]) else ("FULL_OPENCV", [k1, k2, p1, p2, k3, *more])
    numbers = [camera.K[0, 0], camera.K[1, 1], camera.K[0, 2] + HALF, camera.K[1, 2] + HALF, *lens[1]]
    return f"{number} {lens[0]} {camera.size[0]} {camera.size[1]} {' '.join(repr(float(value)) for value in numbers)}"


def _colmap_points(cloud: Cloud, views: Sequence[View], seen: Sequence[NDArray[np.int64]]) -> list[str]:
    """One line a point, its error the RMS of its residuals in pixels."""
    square, count = np.zeros(len(cloud)), np.zeros(len(cloud))
    tracks: list[list[str]] = [[] for _ in range(len(cloud))]
    for number, (view, rows) in enumerate(zip(views, seen, strict=True), start=1):
        off = view.camera.project(view.device_from_world.apply(cloud.points[rows])) - view.pixels[rows]
        square[rows] += np.nan_to_num((off**2).sum(axis=1))
        count[rows] += 1
        for place, row in enumerate(rows.tolist()):
            tracks[row].append(f"{number} {place}")
    error = np.sqrt(square / np.maximum(count, 1))
    rows = zip(cloud.points.tolist(), cloud.colors.tolist(), error.tolist(), tracks, strict=True)
    return [
        f"{number} {x!r} {y!r} {z!r} {red} {green} {blue} {off:.6g} {' '.join(track)}"
        for number, ((x, y, z), (red, green, blue), off, track) in enumerate(rows, start=1)
    ]


def _nerfstudio_frame(view: View, metres: float) -> dict[str, Any]:
    camera = view.camera
    k1, k2, p1, p2, k3, *more = _lens(view, "nerfstudio", 5)
    assert not more
    pose = np.eye(4)
    world_from_device = view.device_from_world.inverse()
    pose[:3, :3], pose[:3, 3] = world_from_device.R @ VIEW_FROM_DEVICE, world_from_device.t * metres
    return {
        "file_path": f"images/{view.name}.png",
        "w": camera.size[0],
        "h": camera.size[1],
        "fl_x": float(camera.K[0, 0]),
        "fl_y": float(camera.K[1, 1]),
        "cx": float(camera.K[0, 2]) + HALF,
        "cy": float(camera.K[1, 2]) + HALF,
        **{"k1": k1, "k2": k2, "k3": k3, "k4": 0.0, "p1": p1, "p2": p2},
        "transform_matrix": pose.tolist(),
    }


def _lens(view: View, tool: str, most: int) -> list[float]:
    """The coefficients that the tool has room for."""
    if view.camera.K[0, 1] != 0:
        raise InputError(f"{view.name}: {tool} has no skew, this device has {view.camera.K[0, 1]:g}")
    coefficients = [float(value) for value in view.camera.distortion]
    if any(coefficients[most:]):
        raise InputError(
            f"{view.name}: {tool} holds {most} coefficients of distortion, this lens has {len(coefficients)}"
        )
    return (coefficients + [0.0] * most)[:most]


def _quaternion(R: FloatArray) -> list[float]:
    """(w, x, y, z), w not negative."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(R).as_quat(canonical=True).tolist()
    return [w, x, y, z]


def _write_pictures(folder: Path, views: Sequence[View]) -> None:
    for view in views:
        if view.picture is not None:
            write_png(_made(folder) / f"{view.name}.png", view.picture)


def _write_lines(path: Path, lines: Sequence[str]) -> None:
    with replaced_file(path) as stream:
        stream.write(("\n".join(lines) + "\n").encode("utf-8"))


def _made(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(folder, f"cannot be made a folder: {error.strerror or error}") from error
    return folder
