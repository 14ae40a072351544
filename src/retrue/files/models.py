"""Clouds and meshes as PLY, OBJ, STL or GLB, as the name of the file ends.

PLY, OBJ   the camera frame, the rig's unit (named in a comment)
STL        the camera frame, millimetres, no colours
GLB        metres; a node turns the camera frame, y down and z forward, to y up and z backward, as glTF has it
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from retrue.errors import FileError
from retrue.files.atomic import replaced_file
from retrue.files.ply import write_cloud as write_ply_cloud
from retrue.files.ply import write_mesh as write_ply_mesh
from retrue.reconstruction.cloud import Cloud, Mesh
from retrue.units import metres_per

if TYPE_CHECKING:
    from trimesh import PointCloud, Trimesh

CLOUD_ENDINGS = (".ply", ".obj", ".glb")
MESH_ENDINGS = (".ply", ".obj", ".stl", ".glb")
GLTF_FROM_CAMERA = np.diag([1.0, -1.0, -1.0, 1.0])
MM_PER_METRE = 1000.0


def write_cloud(path: str | Path, cloud: Cloud) -> None:
    """Whole or not at all; normals, where the cloud has them, go into PLY only.

    Raises
    ------
    FileError : the ending is none of `CLOUD_ENDINGS`, or the file cannot be written.
    InputError : the format has a unit of its own, and the length of the cloud's is not known.
    """
    if _ending(path, CLOUD_ENDINGS, "cloud") == ".ply":
        write_ply_cloud(path, cloud)
        return
    from trimesh import PointCloud

    _write(path, PointCloud(cloud.points, colors=cloud.colors), cloud.unit)


def write_mesh(path: str | Path, mesh: Mesh) -> None:
    """The same of a mesh, whose endings are `MESH_ENDINGS`."""
    if _ending(path, MESH_ENDINGS, "mesh") == ".ply":
        write_ply_mesh(path, mesh)
        return
    from trimesh import Trimesh

    _write(path, Trimesh(mesh.points, mesh.faces, vertex_colors=mesh.colors, process=False), mesh.unit)


def require_cloud_ending(path: str | Path, unit: str) -> None:
    """What `write_cloud` would refuse, before there is a cloud."""
    _require_unit(_ending(path, CLOUD_ENDINGS, "cloud"), unit)


def require_mesh_ending(path: str | Path, unit: str) -> None:
    """What `write_mesh` would refuse, before there is a mesh."""
    _require_unit(_ending(path, MESH_ENDINGS, "mesh"), unit)


def _ending(path: str | Path, endings: tuple[str, ...], what: str) -> str:
    ending = Path(path).suffix.lower()
    if ending not in endings:
        raise FileError(path, f"expected a {what} that ends in {', '.join(endings)}, found {ending or 'no ending'}")
    return ending


def _require_unit(ending: str, unit: str) -> None:
    if ending in (".stl", ".glb"):
        metres_per(unit)


def _write(path: str | Path, model: PointCloud | Trimesh, unit: str) -> None:
    """OBJ, STL or GLB."""
    ending = Path(path).suffix.lower()
    exported: Any = model
    options: dict[str, Any] = {}
    if ending == ".obj":
        options["header"] = f"retrue, camera frame, unit {' '.join(unit.split())}"
    elif ending == ".stl":
        model.apply_scale(MM_PER_METRE * metres_per(unit))
    else:
        from trimesh import Scene

        model.apply_scale(metres_per(unit))
        exported = Scene()
        exported.add_geometry(model, transform=GLTF_FROM_CAMERA)
    content = exported.export(file_type=ending[1:], **options)
    with replaced_file(path) as stream:
        stream.write(content.encode() if isinstance(content, str) else content)
