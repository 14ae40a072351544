"""Outlines of a region of a grid: closed polygons through its outermost points."""

from __future__ import annotations

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.reconstruction.mesh import grid_faces
from retrue.reconstruction.pieces import linked_pieces
from retrue.reconstruction.surface_grid import SurfaceGrid

MOST_ROUNDS = 50


def region_outlines(grid: SurfaceGrid, region: BoolArray) -> list[list[IntArray]]:
    """For each piece of the region, loops of points: all around it first as faces lie, then around its holes.

    `region` (N,) says which points of the grid belong. Where two parts of a piece touch in a single point, faces
    there are taken away, so that each loop is a simple polygon.
    """
    faces = _faces_of(grid, region)
    for _ in range(MOST_ROUNDS):
        start, end = _rim(faces, len(region))
        touching = np.flatnonzero(np.bincount(start, minlength=len(region)) > 1)
        if not len(touching):
            break
        faces = faces[~np.isin(faces, touching).any(axis=1)]
    else:
        return []
    piece = linked_pieces(faces[:, [0, 1]].ravel(), faces[:, [1, 2]].ravel(), len(region))
    by_piece: dict[int, list[IntArray]] = {}
    for loop in _loops(start, end):
        by_piece.setdefault(int(piece[loop[0]]), []).append(loop)
    return list(by_piece.values())


def signed_area(polygon: FloatArray) -> float:
    """Of a polygon (K, 2); positive where it runs from the first axis to the second.

    >>> signed_area(np.array([[0, 0], [2, 0], [2, 1.5], [0, 1.5]]))
    3.0
    """
    x, y = (polygon - polygon[0]).T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def _faces_of(grid: SurfaceGrid, region: BoolArray) -> IntArray:
    """Faces between points of the region only."""
    here = (grid.index >= 0) & region[grid.index]
    right = grid.right & here[:, :-1] & here[:, 1:]
    down = grid.down & here[:-1] & here[1:]
    return grid_faces(SurfaceGrid(grid.index, grid.w, right, down, grid.limit))


def _rim(faces: IntArray, count: int) -> tuple[IntArray, IntArray]:
    """Directed edges that only one face has."""
    a, b = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    single = ~np.isin(a * count + b, b * count + a)
    return a[single], b[single]


def _loops(start: IntArray, end: IntArray) -> list[IntArray]:
    """The closed chains of edges of which no two start at one point."""
    following = dict(zip(start.tolist(), end.tolist(), strict=True))
    loops: list[IntArray] = []
    while following:
        first, at = following.popitem()
        loop = [first]
        while at != first:
            loop.append(at)
            at = following.pop(at)
        loops.append(np.array(loop))
    return loops
