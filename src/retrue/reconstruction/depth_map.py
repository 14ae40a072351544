"""A cloud as a picture of depths, by drawing its surface into a camera."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from retrue.errors import DegenerateError, require_kind
from retrue.geometry.arrays import FloatArray, IntArray
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.reconstruction.cloud import Cloud, require_cloud
from retrue.reconstruction.mesh import surface_faces

PIXELS_AT_A_TIME = 4_000_000  # to save memory
EDGE = 1e-9  # a pixel on the side that two faces share belongs to both


def depth_map(cloud: Cloud, camera: Camera, camera_from_cloud: RigidTransform | None = None) -> FloatArray:
    """Depth Z (h, w) of the surface at every pixel centre of `camera`, in the cloud's unit; NaN where there is none.

    The surface is that of `make_mesh`, so that no depth is invented across a jump. Within a face 1 / Z is linear in
    the ray, which is exact on a plane: the pixel's undistorted ray (x, y) meets the plane n . X = 1 of the face at
    1 / Z = n . (x, y, 1). Where faces lie behind each other the nearest one counts.

    Parameters
    ----------
    camera : the rig's own, for a map that lies on its photograph; or one without distortion, for programs that know
        pinhole cameras only; or any device.
    camera_from_cloud : where it stands; None: in the cloud's frame.

    Raises
    ------
    DegenerateError : no three neighbours of the cloud lie on one surface.

    >>> points = np.array([[-1.0, -1, 10], [1, -1, 10], [-1, 1, 10], [1, 1, 10]])
    >>> cells, grey = np.array([[0, 0], [0, 1], [1, 0], [1, 1]]), np.full((4, 3), 128, np.uint8)
    >>> camera = Camera((5, 5), [[10, 0, 2], [0, 10, 2], [0, 0, 1]])
    >>> depth_map(Cloud(points, grey, camera.project(points), "mm", cells), camera)[1]
    array([nan, 10., 10., 10., nan])
    """
    require_cloud(cloud)
    require_kind(camera, Camera, "camera", "retrue.read_device reads one")
    faces = surface_faces(cloud)
    if not len(faces):
        raise DegenerateError(f"depth map: no three of {len(cloud)} points are neighbours on one surface")
    points = cloud.points if camera_from_cloud is None else camera_from_cloud.apply(cloud.points)
    return draw_faces(points, faces, camera)


def draw_faces(points: FloatArray, faces: IntArray, camera: Camera) -> FloatArray:
    """The same of any triangles (M, 3) over points (N, 3); those that reach behind the camera are left out."""
    width, height = camera.size
    y, x = np.mgrid[:height, :width]
    rays = camera.unproject(np.stack([x, y], axis=-1)).reshape(-1, 2)
    inverse = np.zeros(height * width)  # of the depth; zero is infinitely far
    pixels = camera.project(points)
    faces = faces[np.isfinite(pixels[faces]).all(axis=(1, 2))]
    corners = pixels[faces]
    # A lens bends the sides of a face outwards by far less than a pixel.
    low = np.clip(np.floor(corners.min(axis=1)).astype(np.int64), 0, [width, height])
    high = np.clip(np.ceil(corners.max(axis=1)).astype(np.int64) + 1, 0, [width, height])
    spans = np.maximum(high - low, 0)
    for some in _shares(spans.prod(axis=1)):
        _draw(points, faces[some], low[some], spans[some], rays, width, inverse)
    with np.errstate(divide="ignore"):
        depth = np.where(inverse > 0, 1 / inverse, np.nan)
    return depth.reshape(height, width)


def _shares(counts: IntArray) -> list[slice]:
    """Runs of faces that cover about so many pixels each."""
    number = np.cumsum(counts) // PIXELS_AT_A_TIME
    starts = [0, *(np.flatnonzero(np.diff(number)) + 1).tolist(), len(counts)]
    return [slice(first, last) for first, last in pairwise(starts)]


def _draw(
    points: FloatArray,
    faces: IntArray,
    low: IntArray,
    spans: IntArray,
    rays: FloatArray,
    width: int,
    inverse: FloatArray,
) -> None:
    """Ask every pixel of the box about each face whether its ray meets the face, and where."""
    counts = spans.prod(axis=1)
    face = np.repeat(np.arange(len(faces)), counts)
    place = np.arange(len(face)) - np.repeat(np.cumsum(counts) - counts, counts)
    row = low[face, 1] + place // spans[face, 0]
    column = low[face, 0] + place % spans[face, 0]
    pixel = row * width + column
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    # The ray (x, y, 1) is u a + v b + w c; it meets the face where none is negative, at 1 / Z = u + v + w.
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    with np.errstate(divide="ignore", invalid="ignore"):
        sides = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1) / volume[:, None, None]
        at = np.column_stack([rays[pixel], np.ones(len(pixel))])
        shares = np.einsum("ikj,ij->ik", sides[face], at)
        total = shares.sum(axis=1)
        met = (shares >= -EDGE * total[:, None]).all(axis=1) & (total > 0)
    np.maximum.at(inverse, pixel[met], total[met])
