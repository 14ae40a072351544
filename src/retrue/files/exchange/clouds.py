"""Clouds as other programs take them: PCD, XYZ, E57 and NPZ. Each function gives the bytes of a file.

PCD   version 0.7 of the Point Cloud Library, binary: x y z, packed rgb, normals, sigma; the rig's unit, in a comment
XYZ   text, a point a line: x y z red green blue; the rig's unit, which the format cannot name
E57   ASTM E2807, one scan: metres, single precision, colours; needs pye57, `pip install ".[e57]"`
NPZ   NumPy's archive: every array of the cloud by its name, exact, and `unit`; the rig's unit
"""

from __future__ import annotations

import io
import tempfile
from importlib.util import find_spec
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from retrue.errors import InputError, in_brief, require_kind
from retrue.geometry.arrays import FloatArray, array_of, finite_array
from retrue.reconstruction.cloud import Cloud
from retrue.units import metres_per

GREY = 128
ARRAYS = ("points", "colors", "camera_px", "cells", "normals", "sigma")


def make_cloud(
    points: ArrayLike, colors: ArrayLike | None = None, normals: ArrayLike | None = None, *, unit: str
) -> Cloud:
    """A cloud from plain arrays, as Open3D, trimesh and others give them.

    From Open3D `make_cloud(pcd.points, pcd.colors, pcd.normals, unit="mm")`, from trimesh `make_cloud(pc.vertices,
    pc.colors, unit="mm")`; empty arrays stand for none. Back again the arrays are the cloud's own: `cloud.points`,
    `cloud.colors` (over 255 for Open3D), `cloud.normals`.

    Parameters
    ----------
    points : (N, 3). colors : (N, 3) or more columns, uint8, or floats from 0 to 1. normals : (N, 3).

    Raises
    ------
    InputError : arrays of other shapes, or points that are not finite.

    >>> make_cloud([[0, 0, 1500.0]], [[1.0, 0.5, 0.0]], unit="mm").colors.tolist()
    [[255, 128, 0]]
    """
    places = finite_array(points, (None, 3), "points")
    columns = np.asarray(colors if colors is not None else [])
    if not columns.size:
        columns = np.full((len(places), 3), GREY, np.uint8)
    if columns.dtype.kind not in "fiub":
        raise InputError(f"colors: expected numbers, found {in_brief(colors)}")
    if columns.ndim != 2 or len(columns) != len(places) or columns.shape[1] < 3:
        raise InputError(
            f"colors: expected {len(places)} rows of three or more, found {' x '.join(map(str, columns.shape))}"
        )
    if columns.dtype.kind == "f":
        columns = np.round(np.clip(np.nan_to_num(columns), 0, 1) * 255)
    known = None if normals is None or not np.size(normals) else array_of(normals, places.shape, "normals")
    require_kind(unit, str, "unit")
    return Cloud(places, columns[:, :3].astype(np.uint8), np.full((len(places), 2), np.nan), unit, normals=known)


def pcd_bytes(cloud: Cloud) -> bytes:
    """Little-endian, as every machine that the format's own library runs on. Source: PCL, "The PCD file format".

    The three colours are bytes of one number, `rgb`, red the highest of them: what PCL and Open3D look for.
    """
    red, green, blue = cloud.colors.T.astype(np.uint32)
    columns: list[tuple[str, Any]] = [(name, cloud.points[:, axis]) for axis, name in enumerate("xyz")]
    columns.append(("rgb", (red << 16 | green << 8 | blue).view(np.float32)))
    if cloud.normals is not None:
        columns += [(f"normal_{name}", cloud.normals[:, axis]) for axis, name in enumerate("xyz")]
    if cloud.sigma is not None:
        columns.append(("sigma", cloud.sigma))
    table = np.empty(len(cloud), [(name, "<f4") for name, _ in columns])
    for name, column in columns:
        table[name] = column
    count = len(columns)
    header = [
        f"# .PCD v0.7 - camera frame, unit {' '.join(cloud.unit.split()).encode('ascii', 'replace').decode()}",
        "VERSION 0.7",
        f"FIELDS {' '.join(name for name, _ in columns)}",
        f"SIZE {' '.join(['4'] * count)}",
        f"TYPE {' '.join(['F'] * count)}",
        f"COUNT {' '.join(['1'] * count)}",
        f"WIDTH {len(cloud)}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {len(cloud)}",
        "DATA binary",
    ]
    return ("\n".join(header) + "\n").encode("ascii") + table.tobytes()


def xyz_bytes(cloud: Cloud) -> bytes:
    """Nine significant digits, which is more than single precision; no header, for most readers would stumble on it."""
    stream = io.StringIO()
    np.savetxt(stream, np.column_stack([cloud.points, cloud.colors]), "%.9g %.9g %.9g %d %d %d")
    return stream.getvalue().encode("ascii")


def npz_bytes(cloud: Cloud) -> bytes:
    """What `numpy.load` gives back without pickles: the arrays that the cloud has, and `unit`, a text."""
    arrays = {name: values for name in ARRAYS if (values := getattr(cloud, name)) is not None}
    stream = io.BytesIO()
    np.savez_compressed(stream, unit=np.array(cloud.unit), **arrays)
    return stream.getvalue()


def e57_bytes(cloud: Cloud) -> bytes:
    """One scan whose frame is the camera's. Raises `InputError` without pye57, a known unit, or any point."""
    metres = metres_per(cloud.unit)
    require_e57()
    if not len(cloud):
        raise InputError("E57: expected points, found none; the format's bounds need some: write .ply or .pcd")
    import pye57

    fields: dict[str, FloatArray] = {
        f"cartesian{axis}": column.astype(np.float32).astype(np.float64)
        for axis, column in zip("XYZ", cloud.points.T * metres, strict=True)
    }
    for name, column in zip(("Red", "Green", "Blue"), cloud.colors.T, strict=True):
        fields[f"color{name}"] = np.ascontiguousarray(column, dtype=np.float64)
    with tempfile.TemporaryDirectory() as folder:  # its library writes to a name only
        path = Path(folder) / "cloud.e57"
        file: Any = cast("Any", pye57).E57(str(path), mode="w")
        file.write_scan_raw(fields, name="retrue")
        file.close()
        return path.read_bytes()


def require_e57() -> None:
    """An `InputError` where the library that writes E57 is not installed."""
    if find_spec("pye57") is None:
        raise InputError('E57: expected the library pye57, found none; pip install ".[e57]"')
