"""Clouds and meshes of any format that we write, ours or another tool's."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any, cast

import numpy as np

from retrue.errors import FileError
from retrue.files.models import GLTF_FROM_CAMERA, MESH_ENDINGS
from retrue.files.ply import read_ply
from retrue.files.text import read_bytes
from retrue.reconstruction.cloud import Cloud, Mesh

LARGEST_FILE = 2**30  # bytes
COMMENT_UNIT = re.compile(rb"(?:comment|camera frame,) unit (\S+)")
GREY = 160


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
    points, colors, faces = _ours(path, content) or _foreign(path, content, ending)
    if not len(points):
        raise FileError(path, "expected points, found none")
    if not np.isfinite(points).all():
        raise FileError(path, "expected finite points, found NaN or infinity")
    if len(faces):
        return Mesh(points, colors, faces, unit)
    return Cloud(points, colors, np.full((len(points), 2), np.nan), unit)


def _ours(path: Path, content: bytes) -> Any:
    """Points, colours and faces of a PLY in our own layout; None of any other file."""
    if not content.startswith(b"ply\nformat binary_little_endian 1.0\ncomment unit "):
        return None
    return read_ply(path)


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
