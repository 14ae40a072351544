"""Clouds and meshes as PLY, binary little-endian, as the contract lays it out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retrue.errors import FileError
from retrue.files.atomic import replaced_file
from retrue.geometry.arrays import FloatArray, IntArray
from retrue.reconstruction.cloud import Cloud, Mesh

PARTS = {"point": ("<f4", 3), "normal": ("<f4", 3), "color": ("u1", 3), "sigma": ("<f4", ())}
"""Of a vertex, in their order; `normal` and `sigma` only where they are known."""
FACE = np.dtype([("corners", "u1"), ("vertices", "<i4", 3)])
PROPERTIES = {
    "point": ["property float x", "property float y", "property float z"],
    "normal": ["property float nx", "property float ny", "property float nz"],
    "color": ["property uchar red", "property uchar green", "property uchar blue"],
    "sigma": ["property float sigma"],
}
FACE_PROPERTY = "property list uchar int vertex_indices"
LONGEST_HEADER = 4096  # bytes


def write_cloud(path: str | Path, cloud: Cloud) -> None:
    """`float x y z`, `uchar red green blue`, in the camera frame and the cloud's unit (in a comment).

    Of a cloud with normals `float nx ny nz` stand between the two; last comes `float sigma`, where it is known.
    """
    known = {"point": cloud.points, "normal": cloud.normals, "color": cloud.colors, "sigma": cloud.sigma}
    _write(path, cloud.unit, _vertices(known), None)


def write_mesh(path: str | Path, mesh: Mesh) -> None:
    """The same with triangles, `list uchar int vertex_indices`."""
    faces = np.empty(len(mesh.faces), FACE)
    faces["corners"], faces["vertices"] = 3, mesh.faces
    _write(path, mesh.unit, _vertices({"point": mesh.points, "color": mesh.colors}), faces)


def read_ply(path: str | Path) -> tuple[FloatArray, NDArray[np.uint8], IntArray]:
    """Points (N, 3), colours (N, 3) and faces (M, 3; none: M = 0) of a file of that layout."""
    vertex, faces = read_vertices(path)
    return vertex["point"].astype(np.float64), vertex["color"].copy(), faces


def read_vertices(path: str | Path) -> tuple[NDArray[np.void], IntArray]:
    """All that the file says of its points, (N,) with fields of `PARTS`, and its faces (M, 3)."""
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from error
    header, mark, body = content[:LONGEST_HEADER].partition(b"end_header\n")
    body = content[len(header) + len(mark) :]
    lines = [line for line in header.decode("ascii", "replace").splitlines() if not line.startswith("comment")]
    counts = {name: int(count) for kind, name, count in map(str.split, _elements(lines)) if kind and count.isdigit()}
    vertices, faces = counts.get("vertex", 0), counts.get("face", 0)
    layout = _layout(name for name in PARTS if name in ("point", "color") or PROPERTIES[name][0] in lines)
    expected = _header(layout, vertices, faces if "face" in counts else None)
    if not mark or lines != expected:
        raise FileError(
            path, "expected a binary little-endian PLY of float x y z, uchar red green blue (and triangles)"
        )
    if len(body) != vertices * layout.itemsize + faces * FACE.itemsize:
        raise FileError(path, f"expected {vertices} points and {faces} faces, found {len(body)} bytes: is it cut off?")
    vertex = np.frombuffer(body, layout, vertices)
    face = np.frombuffer(body, FACE, faces, offset=vertices * layout.itemsize)
    return vertex, face["vertices"].astype(np.int64)


def _layout(names: Iterable[str]) -> np.dtype[np.void]:
    return np.dtype([(name, *PARTS[name]) for name in names])


def _vertices(known: Mapping[str, NDArray[Any] | None]) -> NDArray[np.void]:
    there = {name: column for name, column in known.items() if column is not None}
    vertices = np.empty(len(there["point"]), _layout(there))
    for name, column in there.items():
        vertices[name] = column
    return vertices


def _write(path: str | Path, unit: str, vertices: NDArray[np.void], faces: NDArray[np.void] | None) -> None:
    header = _header(vertices.dtype, len(vertices), None if faces is None else len(faces))
    printable_unit = "".join(unit.split()).encode("ascii", "replace").decode("ascii")
    header.insert(2, f"comment unit {printable_unit}")
    with replaced_file(path) as stream:
        stream.write(("\n".join(header) + "\nend_header\n").encode("ascii"))
        stream.write(vertices.tobytes())
        if faces is not None:
            stream.write(faces.tobytes())


def _header(layout: np.dtype[np.void], vertices: int, faces: int | None) -> list[str]:
    properties = [line for name in layout.names or () for line in PROPERTIES[name]]
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {vertices}", *properties]
    return lines if faces is None else [*lines, f"element face {faces}", FACE_PROPERTY]


def _elements(lines: list[str]) -> list[str]:
    return [line for line in lines if line.startswith("element ") and len(line.split()) == 3]
