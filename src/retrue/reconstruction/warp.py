"""Projection mapping: which pixel of a picture each projector pixel must show, so that a viewer sees it undistorted."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from retrue.errors import DegenerateError, InputError, require_kind
from retrue.geometry.arrays import BoolArray, FloatArray, finite_array
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.reconstruction.cloud import Cloud, require_cloud
from retrue.reconstruction.depth_map import draw_faces
from retrue.reconstruction.mesh import surface_faces
from retrue.rig import Rig, require_rig
from retrue.values import ByValue

MOST_MISSING = 0.05  # of the pixels where the picture goes: small holes are no reason to make it small

Rectangle = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Warp(ByValue):
    """A picture laid onto a surface.

    Attributes
    ----------
    st : (h, w, 2) for each projector pixel, the place in the picture: s from its left edge to its right one, t from its
        bottom edge to its top one, both 0 to 1; NaN where the pixel shows none of it.
    view : a camera without distortion where the viewer stands, in which the picture is undistorted.
    rectangle : x, y of the picture's top left corner in the view, its width and height there; in pixels, whose
        centres are whole numbers.
    """

    st: FloatArray
    view: Camera
    rectangle: Rectangle


def warp(
    rig: Rig,
    cloud: Cloud,
    picture_size: tuple[int, int],
    *,
    view: Camera | None = None,
    view_from_camera: RigidTransform | None = None,
    rectangle: Rectangle | None = None,
) -> Warp:
    """The warp that makes a picture look flat and upright from one place, on whatever surface was scanned.

    Each projector pixel's ray is followed to the surface of `make_mesh`, the point there is seen from the viewer's
    place, and where that falls into `rectangle` is what the pixel shows.

    Parameters
    ----------
    rig : with which the cloud was made.
    cloud : the surface, as the projector lit it.
    picture_size : (width, height); only its aspect ratio counts where no rectangle is given.
    view : what the viewer sees with; the rig's camera without its distortion, unless told otherwise.
    view_from_camera : where the viewer is; at the rig's camera, unless told otherwise.
    rectangle : where the picture goes in the view; the largest one that lies on the surface but for 5 % of its
        pixels, unless told otherwise.

    Raises
    ------
    DegenerateError : the cloud has no surface, or no part of the rectangle lies on it.
    InputError : a rectangle or a size without area.
    """
    require_rig(rig)
    require_cloud(cloud)
    sides = finite_array(picture_size, (2,), "picture_size")
    if not (sides > 0).all():
        raise InputError(f"picture_size: expected positive numbers, found {picture_size}")
    if view is not None:
        require_kind(view, Camera, "view", "retrue.read_device reads one")
    if view_from_camera is not None:
        require_kind(view_from_camera, RigidTransform, "view_from_camera")
    view = replace(rig.camera, distortion=()) if view is None else replace(view, distortion=())
    view_from_camera = RigidTransform.identity() if view_from_camera is None else view_from_camera
    faces = surface_faces(cloud)
    if not len(faces):
        raise DegenerateError(f"warp: no three of {len(cloud)} points are neighbours on one surface")
    if rectangle is None:
        seen = draw_faces(view_from_camera.apply(cloud.points), faces, view) > 0
        rectangle = _largest_rectangle(seen, picture_size[0] / picture_size[1])
    left, top, width, height = finite_array(rectangle, (4,), "rectangle").tolist()
    if not (width > 0 and height > 0):
        raise InputError(f"rectangle: expected a positive width and height, found {width:g} x {height:g}")
    depth = draw_faces(rig.projector_from_camera.apply(cloud.points), faces, rig.projector)
    y, x = np.mgrid[: rig.projector.size[1], : rig.projector.size[0]]
    rays = rig.projector.unproject(np.stack([x, y], axis=-1))
    points = np.concatenate([rays * depth[..., None], depth[..., None]], axis=-1)
    at = view.project((view_from_camera @ rig.projector_from_camera.inverse()).apply(points))
    st = np.stack([(at[..., 0] - left) / width, 1 - (at[..., 1] - top) / height], axis=-1)
    with np.errstate(invalid="ignore"):
        st[~((st >= 0) & (st <= 1)).all(axis=-1)] = np.nan
    if not np.isfinite(st).any():
        raise DegenerateError("warp: no part of the rectangle lies on the scanned surface")
    return Warp(st, view, rectangle)


def _largest_rectangle(seen: BoolArray, aspect: float) -> Rectangle:
    """The largest one of that aspect ratio that hardly misses a pixel, by halving; edges are those of pixels."""
    total = np.pad(np.cumsum(np.cumsum(seen, axis=0, dtype=np.int64), axis=1), ((1, 0), (1, 0)))
    found: Rectangle | None = None
    fits, fails = 0, min(seen.shape[0], int(seen.shape[1] / aspect)) + 1
    while fails - fits > 1:
        height = (fits + fails) // 2
        width = max(1, round(height * aspect))
        inside = total[height:, width:] - total[:-height, width:] - total[height:, :-width] + total[:-height, :-width]
        whole = np.argwhere(inside >= (1 - MOST_MISSING) * width * height)
        if len(whole):
            top, left = whole[np.argmin(np.linalg.norm(whole - whole.mean(axis=0), axis=1))].tolist()
            found, fits = (left - 0.5, top - 0.5, float(width), float(height)), height
        else:
            fails = height
    if found is None:
        raise DegenerateError("warp: no pixel of the view sees the scanned surface")
    return found
