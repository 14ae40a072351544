"""From a cloud to a surface whose faces never bridge a depth jump.

Depth jumps are judged in inverse depth w = 1 / Z: on a plane w is linear in the picture, and its noise is even
over the picture, because w is linear in disparity. A step is a jump when it leaves the slope of the surface
on BOTH of its sides by more than the noise explains, and by more than a fraction of the spacing of points.
"""

from __future__ import annotations

import numpy as np

from retrue.errors import DegenerateError
from retrue.geometry.arrays import BoolArray, IntArray
from retrue.reconstruction.cloud import Cloud, Mesh
from retrue.reconstruction.faces import surface_faces


def make_mesh(cloud: Cloud) -> Mesh:
    """Triangles between neighbours on the surface, facing the camera; points without a face are left out.

    Raises
    ------
    DegenerateError : no three neighbours lie on one surface.
    """
    faces = surface_faces(cloud)
    if not len(faces):
        raise DegenerateError(f"mesh: no three of {len(cloud)} points are neighbours on one surface")
    used, faces = _renumbered(faces, len(cloud))
    return Mesh(cloud.points[used], cloud.colors[used], faces, cloud.unit)


def _renumbered(faces: IntArray, count: int) -> tuple[BoolArray, IntArray]:
    """Which points the faces use, and the faces as indices into those."""
    used = np.zeros(count, dtype=np.bool_)
    used[faces] = True
    return used, (np.cumsum(used) - 1)[faces]
