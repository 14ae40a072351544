"""From a cloud to a surface whose faces never bridge a depth jump.

Depth jumps are judged in inverse depth w = 1 / Z: on a plane w is linear in the picture, and its noise is even
over the picture, because w is linear in disparity. A step is a jump when it leaves the slope of the surface
on BOTH of its sides by more than the noise explains, and by more than a fraction of the spacing of points.
"""

from __future__ import annotations

import numpy as np

from retrue.errors import DegenerateError
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.reconstruction.cloud import Cloud, Mesh
from retrue.reconstruction.grid_faces import grid_faces
from retrue.reconstruction.scattered_faces import scattered_faces

STEEPEST_COSINE = np.cos(np.radians(85.0))  # a face more edge-on than this is a bridge: it would hardly be lit


def make_mesh(cloud: Cloud) -> Mesh:
    """Triangles between neighbours on the surface, facing the camera.

    Neighbours are cells of the capture's own grid where it has one (`Cloud.cells`), else those of a Delaunay
    triangulation in the picture. Points without a face are left out.

    Raises
    ------
    DegenerateError : no three neighbours lie on one surface.
    """
    faces = (
        grid_faces(cloud.points, cloud.cells)
        if cloud.cells is not None
        else scattered_faces(cloud.points, cloud.camera_px)
    )
    faces = _facing_the_camera(cloud.points, faces)
    if not len(faces):
        raise DegenerateError(f"mesh: no three of {len(cloud)} points are neighbours on one surface")
    used, faces = _renumbered(faces, len(cloud))
    return Mesh(cloud.points[used], cloud.colors[used], faces, cloud.unit)


def _facing_the_camera(points: FloatArray, faces: IntArray) -> IntArray:
    """The faces that are not seen edge-on, each turned so that its normal points to the camera."""
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    normal = np.cross(b - a, c - a)
    towards = -(normal * a).sum(axis=1)
    lengths = np.linalg.norm(normal, axis=1) * np.linalg.norm(a, axis=1)
    faces = np.where(towards[:, None] < 0, faces[:, [0, 2, 1]], faces)
    return faces[np.abs(towards) > STEEPEST_COSINE * lengths]


def _renumbered(faces: IntArray, count: int) -> tuple[BoolArray, IntArray]:
    """Which points the faces use, and the faces as indices into those."""
    used = np.zeros(count, dtype=np.bool_)
    used[faces] = True
    return used, (np.cumsum(used) - 1)[faces]
