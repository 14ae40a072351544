"""How far two rigs of the same devices are apart: in degrees, in the unit of length, and where the work is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from retrue.errors import InputError
from retrue.geometry.arrays import FloatArray
from retrue.geometry.camera import Camera
from retrue.geometry.transform import direction_angle, rotation_angle
from retrue.geometry.triangulation import triangulate_rays
from retrue.rig import Rig

Pose = tuple[FloatArray, FloatArray]
"""R (3, 3) and t (3,)."""
GRID, FINE_GRID = (17, 13), (129, 97)  # rays across and down the camera picture


@dataclass(frozen=True, slots=True)
class RigDifference:
    """From one rig to another; lengths in their unit.

    Attributes
    ----------
    rotation_deg, translation_deg : of R, and of the direction of t; NaN where a t is zero.
    translation : length of the difference of the two t.
    length : by how much |t| grew.
    working_distance : depth in the camera frame at which the scene was assumed; None where nobody knows it.
    displacement : RMS over the picture of how far a point at that depth lands elsewhere. Infinite where rays do not
        meet, NaN where the projector lights nothing.
    """

    rotation_deg: float
    translation_deg: float
    translation: float
    length: float
    working_distance: float | None = None
    displacement: float | None = None


def rig_difference(first: Rig, second: Rig, working_distance: float | None = None) -> RigDifference:
    """Compare two rigs, intrinsics included as far as they move a point at the working distance.

    Raises InputError where sizes or units differ, or the distance is not positive.

    >>> from retrue.geometry.transform import RigidTransform
    >>> camera = Camera((640, 480), [[800, 0, 320], [0, 800, 240], [0, 0, 1]])
    >>> rig = Rig(camera, camera, RigidTransform(np.eye(3), [-100.0, 0, 0]))
    >>> wider = Rig(camera, camera, RigidTransform(np.eye(3), [-101.0, 0, 0]))
    >>> round(rig_difference(rig, wider, 1000.0).displacement, 1)  # one in a hundred of 1000 and more
    10.4
    """
    for name in ("camera", "projector"):
        sizes = getattr(first, name).size, getattr(second, name).size
        if sizes[0] != sizes[1]:
            raise InputError(f"{name}: expected one size in both rigs, found {sizes[0]} and {sizes[1]}")
    if first.unit != second.unit:
        raise InputError(f"unit: expected one unit in both rigs, found {first.unit!r} and {second.unit!r}")
    if working_distance is not None and not (0 < working_distance < np.inf):
        raise InputError(f"working distance: expected a positive length, found {working_distance:g}")
    a, b = first.projector_from_camera, second.projector_from_camera
    return RigDifference(
        float(np.degrees(rotation_angle(b.R @ a.R.T))),
        float(np.degrees(direction_angle(a.t, b.t))),
        float(np.linalg.norm(b.t - a.t)),
        float(np.linalg.norm(b.t) - np.linalg.norm(a.t)),
        working_distance,
        None if working_distance is None else displacement_rms(first, second, [(b.R, b.t)], working_distance)[0],
    )


def displacement_rms(first: Rig, second: Rig, poses: Sequence[Pose], distance: float) -> list[float]:
    """What both devices of the first rig see at that depth, measured with the second one in each of the poses: RMS."""
    points, seen = _seen_at(first, distance)
    camera_rays = second.camera.unproject(first.camera.project(points))
    projector_rays = second.projector.unproject(seen)
    return [_rms_from(points, pose, second, camera_rays, projector_rays) for pose in poses]


def _rms_from(points: FloatArray, pose: Pose, rig: Rig, camera_rays: FloatArray, projector_rays: FloatArray) -> float:
    """How far from those points (N, 3) their rays meet in a pose, measured with the devices of that rig.

    Infinite where they do not meet, NaN where there is no point.
    """
    if not len(points):
        return float("nan")
    variances = (np.square([1 / device.K[0, 0]]) for device in (rig.camera, rig.projector))
    moved = triangulate_rays(*pose, camera_rays, projector_rays, *variances)
    squares = ((moved - points) ** 2).sum(axis=1)
    return float(np.sqrt(np.where(np.isfinite(squares), squares, np.inf).mean()))


def pixel_displacement(rig: Rig, distance: float) -> float:
    """How far points at that depth land elsewhere, RMS, if the projector's pixels are one off, across and down.

    >>> from retrue.geometry.transform import RigidTransform
    >>> camera = Camera((640, 480), [[800, 0, 320], [0, 800, 240], [0, 0, 1]])
    >>> rig = Rig(camera, camera, RigidTransform(np.eye(3), [-100.0, 0, 0]))
    >>> round(pixel_displacement(rig, 1000.0), 1)  # Z^2 / (f b), and across the ray
    12.9
    """
    points, seen = _seen_at(rig, distance)
    camera_rays = rig.camera.unproject(rig.camera.project(points))
    moved: list[float] = []
    for axis in (0, 1):
        K = rig.projector.K.copy()
        K[axis, 2] += 1
        off = replace(rig.projector, K=K).unproject(seen)
        pose = rig.projector_from_camera
        moved.append(_rms_from(points, (pose.R, pose.t), rig, camera_rays, off))
    return float(np.hypot(moved[0], moved[1]))


def _seen_at(rig: Rig, distance: float) -> tuple[FloatArray, FloatArray]:
    """Points (N, 3) at that depth and their projector pixels (N, 2): of those that this sees, where it sees any."""
    for grid in (GRID, FINE_GRID):  # a small patch of light lies between a few rays
        points = _points_at(rig.camera, distance, grid)
        there = rig.projector_from_camera.apply(points)
        seen, lit = rig.projector.project(there), rig.projector.sees(there)
        if lit.any():
            return points[lit], seen[lit]
    reached = np.isfinite(rig.projector.unproject(seen)).all(axis=1)
    return points[reached], seen[reached]  # it works at another distance


def _points_at(camera: Camera, distance: float, grid: tuple[int, int]) -> FloatArray:
    """Points (N, 3) at that depth, evenly over the picture."""
    across, down = np.meshgrid(
        *(np.linspace(0, side - 1, count) for side, count in zip(camera.size, grid, strict=True))
    )
    rays = camera.unproject(np.column_stack([across.ravel(), down.ravel()]))
    rays = rays[np.isfinite(rays).all(axis=1)]
    return np.column_stack([rays, np.ones(len(rays))]) * distance


def magnification(rig: Rig, distance: float) -> float:
    """Camera pixels that a projector pixel covers on a surface at that distance in front of the camera.

    Of the focal lengths over the depths, on the camera's axis.

    >>> from retrue.geometry.transform import RigidTransform
    >>> camera = Camera((640, 480), [[800, 0, 320], [0, 800, 240], [0, 0, 1]])
    >>> magnification(Rig(camera, camera, RigidTransform(np.eye(3), [-100.0, 0, 500.0])), 1000.0)
    1.5
    """
    if not distance > 0:
        raise InputError(f"distance: expected more than 0, found {distance:g}")
    depth = float(rig.projector_from_camera.apply(np.array([0.0, 0.0, distance]))[2])
    if not depth > 0:
        raise InputError(f"distance: the projector does not see what is {distance:g} {rig.unit} before the camera")
    camera, projector = (float(np.sqrt(device.K[0, 0] * device.K[1, 1])) for device in (rig.camera, rig.projector))
    return camera * depth / (projector * distance)
