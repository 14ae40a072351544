"""Faces between the neighbours on a surface, whatever the topology of the points is."""

from __future__ import annotations

import numpy as np

from retrue.geometry.arrays import FloatArray, IntArray
from retrue.reconstruction.cloud import Cloud
from retrue.reconstruction.grid_faces import grid_faces
from retrue.reconstruction.scattered_faces import scattered_faces
from retrue.reconstruction.surface_grid import surface_grid

STEEPEST_COSINE = np.cos(np.radians(85.0))  # a face more edge-on than this is a bridge: it would hardly be lit


def surface_faces(cloud: Cloud) -> IntArray:
    """Faces (M, 3), counter-clockwise as the camera sees them; possibly none.

    Neighbours are cells of the capture's own grid where it has one (`Cloud.cells`), else those of a Delaunay
    triangulation in the picture. Raises `DegenerateError` where points without a grid span no area.
    """
    if cloud.cells is not None:
        faces = grid_faces(surface_grid(cloud.points, cloud.cells))
    else:
        faces = scattered_faces(cloud.points, cloud.camera_px)
    return _facing_the_camera(cloud.points, faces)


def _facing_the_camera(points: FloatArray, faces: IntArray) -> IntArray:
    """The faces that are not seen edge-on, each turned so that its normal points to the camera."""
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    normal = np.cross(b - a, c - a)
    towards = -(normal * a).sum(axis=1)
    lengths = np.linalg.norm(normal, axis=1) * np.linalg.norm(a, axis=1)
    faces = np.where(towards[:, None] < 0, faces[:, [0, 2, 1]], faces)
    return faces[np.abs(towards) > STEEPEST_COSINE * lengths]
