"""Clouds and meshes as PLY, OBJ, STL or GLB, as the name of the file ends; read back, ours or another tool's.

Clouds are written as PCD, XYZ, E57 and NPZ too: see `files.exchange.clouds`.

PLY, OBJ   the camera frame, the rig's unit (named in a comment)
STL        the camera frame, millimetres, no colours
GLB        metres; a node turns the camera frame, y down and z forward, to y up and z backward, as glTF has it
"""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from retrue.errors import FileError, require_kind, require_path
from retrue.files.atomic import read_bytes, replaced_file
from retrue.files.exchange.clouds import e57_bytes, npz_bytes, pcd_bytes, require_e57, xyz_bytes
from retrue.files.ply import read_vertices
from retrue.files.ply import write_cloud as write_ply_cloud
from retrue.files.ply import write_mesh as write_ply_mesh
from retrue.reconstruction.cloud import Cloud, Mesh, require_cloud
from retrue.units import metres_per, millimetres_per

if TYPE_CHECKING:
    from trimesh import PointCloud, Trimesh


CLOUD_ENDINGS = (".ply", ".pcd", ".xyz", ".e57", ".npz", ".obj", ".glb")
MESH_ENDINGS = (".ply", ".obj", ".stl", ".glb")
CLOUD_BYTES = {".pcd": pcd_bytes, ".xyz": xyz_bytes, ".e57": e57_bytes, ".npz": npz_bytes}
GLTF_FROM_CAMERA = np.diag([1.0, -1.0, -1.0, 1.0])
LARGEST_FILE = 2**30  # bytes
COMMENT_UNIT = re.compile(rb"(?:comment|camera frame,) unit (\S+)")
GREY = 160


def write_cloud(path: str | Path, cloud: Cloud) -> None:
    """Whole or not at all; normals, where the cloud has them, go into PLY, PCD and NPZ only.

    Raises
    ------
    FileError : the ending is none of `CLOUD_ENDINGS`, or the file cannot be written.
    InputError : the format has a unit of its own, and the length of the cloud's is not known.
    """
    path = require_path(path, "write_cloud(path, cloud)")
    require_cloud(cloud)
    ending = _ending(path, CLOUD_ENDINGS, "cloud")
    if ending == ".ply":
        write_ply_cloud(path, cloud)
        return
    if ending in CLOUD_BYTES:
        content = CLOUD_BYTES[ending](cloud)
        with replaced_file(path) as stream:
            stream.write(content)
        return
    from trimesh import PointCloud

    _write(path, PointCloud(cloud.points, colors=cloud.colors), cloud.unit)


def write_mesh(path: str | Path, mesh: Mesh) -> None:
    """The same of a mesh, whose endings are `MESH_ENDINGS`."""
    path = require_path(path, "write_mesh(path, mesh)")
    require_kind(mesh, Mesh, "mesh", "retrue.make_mesh makes one")
    if _ending(path, MESH_ENDINGS, "mesh") == ".ply":
        write_ply_mesh(path, mesh)
        return
    from trimesh import Trimesh

    _write(path, Trimesh(mesh.points, mesh.faces, vertex_colors=mesh.colors, process=False), mesh.unit)


def require_cloud_ending(path: str | Path, unit: str) -> None:
    """What `write_cloud` would refuse, before there is a cloud."""
    ending = _ending(path, CLOUD_ENDINGS, "cloud")
    _require_unit(ending, unit)
    if ending == ".e57":
        require_e57()


def require_mesh_ending(path: str | Path, unit: str) -> None:
    """What `write_mesh` would refuse, before there is a mesh."""
    _require_unit(_ending(path, MESH_ENDINGS, "mesh"), unit)


def _ending(path: str | Path, endings: tuple[str, ...], what: str) -> str:
    ending = Path(path).suffix.lower()
    if ending not in endings:
        raise FileError(path, f"expected a {what} that ends in {', '.join(endings)}, found {ending or 'no ending'}")
    return ending


def _require_unit(ending: str, unit: str) -> None:
    if ending in (".stl", ".glb", ".e57"):
        metres_per(unit)


def _write(path: str | Path, model: PointCloud | Trimesh, unit: str) -> None:
    """OBJ, STL or GLB."""
    ending = Path(path).suffix.lower()
    exported: Any = model
    options: dict[str, Any] = {}
    if ending == ".obj":
        options["header"] = f"retrue, camera frame, unit {' '.join(unit.split())}"
    elif ending == ".stl":
        model.apply_scale(millimetres_per(unit))
    else:
        from trimesh import Scene

        model.apply_scale(metres_per(unit))
        exported = Scene()
        exported.add_geometry(model, transform=GLTF_FROM_CAMERA)
    content = exported.export(file_type=ending[1:], **options)
    with replaced_file(path) as stream:
        stream.write(content.encode() if isinstance(content, str) else content)


def read_model(path: str | Path, unit: str) -> Cloud | Mesh:
    """The points, or the mesh where there are faces, in the camera frame and the unit that the file names.

    STL is in millimetres and GLB in metres; PLY and OBJ name their unit in a comment if we wrote them, and else are
    taken to be in `unit`. Raises `FileError` for what is no such file, and for one without points.
    """
    path = Path(path)
    ending = path.suffix.lower()
    if ending not in MESH_ENDINGS:
        raise FileError(path, f"expected a cloud or mesh that ends in {', '.join(MESH_ENDINGS)}")
    content = read_bytes(path, LARGEST_FILE)
    found = COMMENT_UNIT.search(content[:400])
    if ending in (".stl", ".glb"):
        unit = "mm" if ending == ".stl" else "m"
    elif found is not None:
        unit = found.group(1).decode("ascii", "replace")
    points, colors, faces, sigma = _ours(path, content) or (*_foreign(path, content, ending), None)
    if not len(points):
        raise FileError(path, "expected points, found none")
    if not np.isfinite(points).all():
        raise FileError(path, "expected finite points, found NaN or infinity")
    if len(faces):
        return Mesh(points, colors, faces, unit)
    return Cloud(points, colors, np.full((len(points), 2), np.nan), unit, sigma=sigma)


def _ours(path: Path, content: bytes) -> Any:
    """Points, colours, faces and sigma (or None) of a PLY in our own layout; None of any other file."""
    if not content.startswith(b"ply\nformat binary_little_endian 1.0\ncomment unit "):
        return None
    vertex, faces = read_vertices(path)
    sigma = vertex["sigma"].astype(np.float64) if "sigma" in (vertex.dtype.names or ()) else None
    return vertex["point"].astype(np.float64), vertex["color"].copy(), faces, sigma


def _foreign(path: Path, content: bytes, ending: str) -> Any:
    """The same of what trimesh can read."""
    import trimesh

    try:
        scene: Any = cast("Any", trimesh).load_scene(io.BytesIO(content), file_type=ending[1:])
        if ending == ".glb":
            scene.apply_transform(np.linalg.inv(GLTF_FROM_CAMERA))
        parts: list[Any] = scene.dump()
    except Exception as error:  # whatever a damaged file makes of a reader of many formats
        kind = ending[1:].upper()
        raise FileError(path, f"expected {kind}, found none that can be read ({type(error).__name__})") from error
    points = [np.asarray(part.vertices, dtype=np.float64) for part in parts]
    for vertices in points:
        if vertices.ndim != 2 or vertices.shape[1] != 3:
            found = vertices.shape[-1] if vertices.ndim else 0
            raise FileError(path, f"expected vertices of three numbers, found {found}: no points in space")
    starts = np.cumsum([0, *map(len, points)])
    faces = [
        np.asarray(part.faces, dtype=np.int64) + start
        for part, start in zip(parts, starts[:-1], strict=True)
        if hasattr(part, "faces")
    ]
    return (
        np.concatenate([np.empty((0, 3)), *points]),
        np.concatenate([np.empty((0, 3), np.uint8), *map(_colors, parts)]),
        np.concatenate([np.empty((0, 3), np.int64), *faces]),
    )


def _colors(part: Any) -> Any:
    """Of the vertices; grey where the file has none."""
    colors = getattr(part, "colors", None)
    if colors is None and getattr(part.visual, "kind", None) == "vertex":
        colors = part.visual.vertex_colors
    if colors is None or len(colors) != len(part.vertices):
        return np.full((len(part.vertices), 3), GREY, np.uint8)
    return np.asarray(colors)[:, :3]
