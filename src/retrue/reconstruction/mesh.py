"""From a cloud to a surface whose faces never bridge a depth jump (`surface_grid.jump_limit`).

Neighbours are cells of the capture's own grid, or those of a Delaunay triangulation in the picture.
"""

from __future__ import annotations

import numpy as np

from retrue.errors import DegenerateError
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.reconstruction.cloud import Cloud, Mesh, require_cloud
from retrue.reconstruction.surface_grid import SurfaceGrid, jump_limit, surface_grid

STEEPEST_COSINE = np.cos(np.radians(85.0))  # a face more edge-on than this is a bridge: it would hardly be lit
LONGEST_EDGE = 3.0  # times the usual edge at either end; a longer one spans a hole that may hide a jump


def make_mesh(cloud: Cloud) -> Mesh:
    """Triangles between neighbours on the surface, facing the camera; points without a face are left out.

    Raises
    ------
    DegenerateError : no three neighbours lie on one surface.
    """
    require_cloud(cloud)
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


def surface_faces(cloud: Cloud) -> IntArray:
    """Faces (M, 3), counter-clockwise as the camera sees them; possibly none.

    Neighbours are cells of the capture's own grid where it has one (`Cloud.cells`), else those of a Delaunay
    triangulation in the picture. Raises `DegenerateError` where points without a grid span no area.
    """
    if cloud.cells is not None:
        faces = grid_faces(surface_grid(cloud.points, cloud.cells, cloud.sigma))
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


def grid_faces(grid: SurfaceGrid) -> IntArray:
    """Faces (M, 3): two a square whose four sides are continuous; one where just one corner is missing or cut off."""
    index, right, down = grid.index, grid.right, grid.down
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]  # a b over c d
    top, bottom, left, right_side = right[:-1], right[1:], down[:, :-1], down[:, 1:]
    whole = top & bottom & left & right_side
    corners = (
        (whole, (a, b, c)),
        (whole, (b, d, c)),
        (~top & ~left & bottom & right_side, (b, d, c)),
        (~top & ~right_side & bottom & left, (a, d, c)),
        (~bottom & ~left & top & right_side, (a, b, d)),
        (~bottom & ~right_side & top & left, (a, b, c)),
    )
    return np.concatenate([np.stack([corner[where] for corner in triangle], axis=1) for where, triangle in corners])


def scattered_faces(points: FloatArray, camera_px: FloatArray) -> IntArray:
    """Faces (M, 3) between points (N, 3) that are neighbours in the picture, with no depth jump between.

    Raises
    ------
    DegenerateError : fewer than three points, or all on one line of the picture.
    """
    from scipy.spatial import Delaunay, QhullError

    try:
        faces = Delaunay(camera_px).simplices.astype(np.int64)
    except (QhullError, ValueError) as error:
        raise DegenerateError(f"mesh: expected points that span an area of the picture, found {len(points)}") from error
    w = 1 / points[:, 2]
    slope = _flattest_slope(w, camera_px, faces)
    sides = [(faces[:, i], faces[:, j]) for i, j in ((0, 1), (1, 2), (2, 0))]
    residuals = np.stack([_slope_residual(w, camera_px, slope, a, b) for a, b in sides])
    angle = float(np.median(np.concatenate([np.linalg.norm(points[a] - points[b], axis=1) * w[a] for a, b in sides])))
    limit = jump_limit(residuals, w, angle)
    continuous = [residual <= np.minimum(limit[a], limit[b]) for residual, (a, b) in zip(residuals, sides, strict=True)]
    return faces[np.logical_and.reduce(continuous) & ~_spans_a_hole(camera_px, faces)]


def _flattest_slope(w: FloatArray, camera_px: FloatArray, faces: IntArray) -> FloatArray:
    """Gradient (N, 2) of w over the picture at each point: of the flattest face there.

    Faces that bridge a jump are steep; on a surface, however steep itself, all faces at a point are alike.
    """
    a, b, c = faces.T
    (x1, y1), (x2, y2) = (camera_px[b] - camera_px[a]).T, (camera_px[c] - camera_px[a]).T
    w1, w2 = w[b] - w[a], w[c] - w[a]
    with np.errstate(invalid="ignore", divide="ignore"):
        gradient = np.stack([w1 * y2 - w2 * y1, w2 * x1 - w1 * x2], axis=1) / (x1 * y2 - x2 * y1)[:, None]
    steepness = np.nan_to_num(np.linalg.norm(gradient, axis=1), nan=np.inf)
    steepest_first = np.argsort(-steepness, kind="stable")
    slope = np.zeros_like(camera_px)
    slope[faces[steepest_first].ravel()] = np.repeat(gradient[steepest_first], 3, axis=0)  # the last one stays
    return slope


def _slope_residual(w: FloatArray, camera_px: FloatArray, slope: FloatArray, a: IntArray, b: IntArray) -> FloatArray:
    """How far the step from a to b departs from the slope at a or at b, whichever is nearer."""
    along = camera_px[b] - camera_px[a]
    step = w[b] - w[a]
    return np.fmin(np.abs(step - (slope[a] * along).sum(axis=1)), np.abs(step - (slope[b] * along).sum(axis=1)))


def _spans_a_hole(camera_px: FloatArray, faces: IntArray) -> BoolArray:
    """Faces with a side much longer than the shortest ways out of either of its ends."""
    sides = [(faces[:, i], faces[:, j]) for i, j in ((0, 1), (1, 2), (2, 0))]
    lengths = [np.linalg.norm(camera_px[b] - camera_px[a], axis=1) for a, b in sides]
    shortest = np.full(len(camera_px), np.inf)
    for (a, b), length in zip(sides, lengths, strict=True):
        np.minimum.at(shortest, a, length)
        np.minimum.at(shortest, b, length)
    return np.logical_or.reduce(
        [
            length > LONGEST_EDGE * np.maximum(shortest[a], shortest[b])
            for (a, b), length in zip(sides, lengths, strict=True)
        ]
    )
