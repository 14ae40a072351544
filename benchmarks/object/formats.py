"""What other programs' own libraries read of what is handed over: largest differences from what was written.

    python -m benchmarks.object.formats

On a scan of a wall with a ball and a crate. Needs Open3D beside the extras `e57`, `ros` and `peers`.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from benchmarks.object.scenes import PATTERNS, make_rig, make_scene, take
from retrue.files.exchange.depth_maps import write_depth_map
from retrue.files.exchange.photogrammetry import rig_views, write_colmap, write_nerfstudio
from retrue.files.exchange.ros import write_bag
from retrue.files.exchange.warps import write_st_map
from retrue.files.models import write_cloud, write_mesh
from retrue.geometry.arrays import FloatArray
from retrue.reconstruction.cloud import Cloud
from retrue.reconstruction.depth_map import depth_map
from retrue.reconstruction.mesh import make_mesh
from retrue.reconstruction.normals import with_normals
from retrue.reconstruction.reconstruct import reconstruct
from retrue.reconstruction.warp import warp
from retrue.rig import Rig

Row = tuple[str, str, float, str]


def clouds_by_open3d(folder: Path, cloud: Cloud) -> Iterator[Row]:
    import open3d as o3d

    for ending in ("ply", "pcd", "xyz"):
        path = folder / f"cloud.{ending}"
        write_cloud(path, cloud)
        kind = {"xyz": "xyzrgb"}.get(ending, "auto")
        read = o3d.io.read_point_cloud(str(path), format=kind)
        yield f".{ending}", "Open3D", _off(np.asarray(read.points), cloud.points), "of the depth"
        if read.has_colors():
            levels = np.asarray(read.colors) * (255 if np.asarray(read.colors).max() <= 1 else 1)
            yield f".{ending} colours", "Open3D", float(np.abs(levels - cloud.colors).max()), "grey levels"
    mesh = make_mesh(cloud)
    for ending in ("ply", "obj", "stl", "glb"):
        write_mesh(folder / f"mesh.{ending}", mesh)
        read = o3d.io.read_triangle_mesh(str(folder / f"mesh.{ending}"))
        yield f"mesh .{ending}", "Open3D", float(len(read.triangles) - len(mesh.faces)), "faces"


def e57_by_pye57(folder: Path, cloud: Cloud) -> Iterator[Row]:
    import pye57

    write_cloud(folder / "cloud.e57", cloud)
    read = pye57.E57(str(folder / "cloud.e57")).read_scan(0, colors=True, ignore_missing_fields=True)
    points = np.stack([read[f"cartesian{axis}"] for axis in "XYZ"], axis=1) * 1000
    yield ".e57", "pye57", _off(points, cloud.points), "of the depth"
    colors = np.stack([read[f"color{name}"] for name in ("Red", "Green", "Blue")], axis=1)
    yield ".e57 colours", "pye57", float(np.abs(colors.astype(float) - cloud.colors).max()), "grey levels"


def bag_by_rosbags(folder: Path, rig: Rig, cloud: Cloud) -> Iterator[Row]:
    from rosbags.highlevel import AnyReader

    write_bag(folder / "bag", rig, [cloud], [10**18])
    with AnyReader([folder / "bag"]) as reader:
        read = {link.topic: reader.deserialize(raw, link.msgtype) for link, _, raw in reader.messages()}
    table = read["/points"].data.view("<f4").reshape(len(cloud), -1)
    yield "bag, /points", "rosbags", _off(1000 * table[:, :3].astype(float), cloud.points), "of the depth"
    k = read["/camera/camera_info"].k.reshape(3, 3)
    yield "bag, camera_info", "rosbags", float(np.abs(k - rig.camera.K).max()), "px"


def colmap_by_pycolmap(folder: Path, rig: Rig, cloud: Cloud) -> Iterator[Row]:
    import pycolmap

    picture = np.zeros((*rig.camera.size[::-1], 3), np.uint8)
    shown = np.zeros((*rig.projector.size[::-1], 3), np.uint8)
    write_colmap(folder / "colmap", cloud, rig_views(rig, cloud, picture, shown))
    model = pycolmap.Reconstruction(folder / "colmap" / "sparse" / "0")
    points = np.array([model.points3D[number].xyz for number in sorted(model.points3D)])
    yield "colmap points", "pycolmap", _off(points, cloud.points), "of the depth"
    for number, (device, seen) in enumerate(
        ((rig.camera, cloud.points), (rig.projector, rig.projector_from_camera.apply(cloud.points))), 1
    ):
        image = model.images[number]
        camera = model.cameras[image.camera_id]
        pixels = np.array([camera.img_from_cam(point) for point in image.cam_from_world() * points])
        yield f"colmap image {number}", "pycolmap", float(np.abs(pixels - 0.5 - device.project(seen)).max()), "px"
    views = rig_views(rig, cloud, picture, shown, depth_map(cloud, rig.camera))
    write_nerfstudio(folder / "nerf", cloud, views)
    said = json.loads((folder / "nerf" / "transforms.json").read_text())
    frame = said["frames"][0]
    k = np.array([[frame["fl_x"], 0, frame["cx"] - 0.5], [0, frame["fl_y"], frame["cy"] - 0.5], [0, 0, 1]])
    lens = np.array([frame[name] for name in ("k1", "k2", "p1", "p2", "k3")])
    world_from_view = np.array(frame["transform_matrix"])
    view = (cloud.points / 1000 - world_from_view[:3, 3]) @ world_from_view[:3, :3]
    pixels = cv2.projectPoints(view * [1, -1, -1], np.zeros(3), np.zeros(3), k, lens)[0][:, 0]
    yield "nerfstudio frame", "OpenCV", float(np.abs(pixels - rig.camera.project(cloud.points)).max()), "px"


def pictures_by_opencv(folder: Path, rig: Rig, cloud: Cloud) -> Iterator[Row]:
    depth = depth_map(cloud, rig.camera)
    for ending in ("tiff", "png"):
        write_depth_map(folder / f"depth.{ending}", depth, rig.camera, "mm")
        read = cv2.imread(str(folder / f"depth.{ending}"), cv2.IMREAD_UNCHANGED).astype(float)
        there = np.isfinite(depth) & (depth > 0)
        yield f"depth .{ending}", "OpenCV", float(np.abs(read - depth)[there].max()), "mm"
    map_ = warp(rig, cloud, (400, 300))
    write_st_map(folder / "st.tiff", map_)
    read = cv2.imread(str(folder / "st.tiff"), cv2.IMREAD_UNCHANGED)[..., ::-1]
    yield "ST map", "OpenCV", float(np.abs(read[..., :2] - np.nan_to_num(map_.st)).max()), "of the picture"


def _off(found: FloatArray, written: FloatArray) -> float:
    assert found.shape == written.shape, (found.shape, written.shape)
    return float((np.abs(found - written) / written[:, 2:]).max())


def main() -> None:
    rig = make_rig((1280, 960))
    shot = take(rig, make_scene(np.random.default_rng(40), 900.0), PATTERNS["color grid"](), 900.0, 40)
    cloud = with_normals(reconstruct(rig, shot.points))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for rows in (
            clouds_by_open3d(folder, cloud),
            e57_by_pye57(folder, cloud),
            bag_by_rosbags(folder, rig, cloud),
            colmap_by_pycolmap(folder, rig, cloud),
            pictures_by_opencv(folder, rig, cloud),
        ):
            for what, library, off, unit in rows:
                print(f"{what:18} {library:9} {off:9.2g} {unit}", flush=True)


if __name__ == "__main__":
    main()
