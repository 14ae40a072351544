"""Residuals of a calibration and their derivatives by its `Columns`, in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from retrue.calibration.observations import CornerObservations, Group, PlaneObservations, SceneObservations
from retrue.calibration.setup import BEND, INTRINSICS, POSE, Setup
from retrue.geometry.arrays import FloatArray, IntArray
from retrue.geometry.camera import Camera
from retrue.geometry.triangulation import depths_on_rays

OF_BOARD = len(BEND) + len(POSE)
"""Number of the columns that move points of the board."""


def linearise(setup: Setup, group: Group) -> tuple[FloatArray, FloatArray]:
    """Predicted minus measured pixels (N, 2), and their derivatives (N, 2, columns.all).

    Of dense points, the two numbers are along and across the epipolar line: a board that is not quite flat shows
    along it only; and a scene of unknown shape tells nothing along it, there they are zero.
    """
    if isinstance(group, CornerObservations):
        return _linearise_corners(setup, group)
    return _linearise_plane(setup, group) if isinstance(group, PlaneObservations) else _linearise_scene(setup, group)


def residuals(setup: Setup, group: Group) -> FloatArray:
    """The first part of `linearise`."""
    R, t = _board_poses(setup, group.view)
    if isinstance(group, CornerObservations):
        points = np.einsum("nij,nj->ni", R, _bent(setup, group.board_points)[0]) + t
        if group.device == 1:
            points = setup.second_from_first.apply(points)
        return _known(
            setup.devices[group.device].project(points) + group.device * setup.shifts[group.view] - group.pixels
        )
    camera, projector = setup.devices
    rays = camera.unproject(group.camera_px)
    known = isinstance(group, PlaneObservations)
    points = _on_board(setup, rays, R, t)[0] if known else triangulated(setup, rays, group.projector_px)
    points = setup.second_from_first.apply(points)
    along = _pixel_by_point(projector, points) @ setup.second_from_first.R @ _homogeneous(rays)[:, :, None]
    missed = projector.project(points) + setup.shifts[group.view] - group.projector_px
    error = _along_and_across(along, missed[:, :, None], group.projector_px)[:, :, 0]
    return error if known else error * [0, 1]


def _linearise_corners(setup: Setup, group: CornerObservations) -> tuple[FloatArray, FloatArray]:
    R, t = _board_poses(setup, group.view)
    points, by_bend = _bent(setup, group.board_points)
    turned = np.einsum("nij,nj->ni", R, points)
    by_bend = R[:, :, 2:] * by_bend[:, None, :]
    by_board = np.concatenate([by_bend, -_skew(turned), np.broadcast_to(np.eye(3), R.shape)], axis=2)
    residual, jacobian, _ = _through_device(setup, group.device, turned + t, by_board, group.pixels, group.view)
    jacobian[np.isnan(residual) & np.isnan(group.pixels)] = 0
    return _known(residual), jacobian


def _linearise_plane(setup: Setup, group: PlaneObservations) -> tuple[FloatArray, FloatArray]:
    R, t = _board_poses(setup, group.view)
    normal = R[:, :, 2]
    rays = setup.devices[0].unproject(group.camera_px)
    points, depth, slope, by_bend = _on_board(setup, rays, R, t)
    ray = _homogeneous(rays)
    by_turn, by_shift = np.cross(normal, t - points) / slope, normal / slope  # of the depth
    by_board = ray[:, :, None] * np.concatenate([by_bend / slope, by_turn, by_shift], axis=1)[:, None, :]
    by_ray = depth[:, :, None] * (np.eye(3) - ray[:, :, None] * (normal / slope)[:, None, :])[:, :, :2]
    return _through_both(setup, group, rays, points, by_ray, by_board)


def _linearise_scene(setup: Setup, group: SceneObservations) -> tuple[FloatArray, FloatArray]:
    rays = setup.devices[0].unproject(group.camera_px)
    points = triangulated(setup, rays, group.projector_px)
    by_ray = points[:, 2, None, None] * np.eye(3)[:, :2]
    residual, jacobian = _through_both(setup, group, rays, points, by_ray, np.zeros((len(points), 3, OF_BOARD)))
    residual[:, 0] = jacobian[:, 0] = 0
    return residual, jacobian


def _through_both(
    setup: Setup,
    group: PlaneObservations | SceneObservations,
    rays: FloatArray,
    points: FloatArray,
    by_ray: FloatArray,
    by_board: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Residuals and derivatives along and across the epipolar line, of points (N, 3) on the first device's rays (N, 2).

    by_ray (N, 3, 2): the first device's intrinsics move the ray that passes through the pixel, and so the point.
    """
    camera = setup.devices[0]
    residual, jacobian, by_point = _through_device(setup, 1, points, by_board, group.projector_px, group.view)
    ray_by_intrinsics = -np.linalg.solve(camera.ray_jacobian(rays), _by_intrinsics(camera, rays))
    jacobian[:, :, setup.columns.intrinsics(0)] = by_point @ by_ray @ ray_by_intrinsics
    along = by_point @ _homogeneous(rays)[:, :, None]
    return (
        _along_and_across(along, residual[:, :, None], group.projector_px)[:, :, 0],
        _along_and_across(along, jacobian, group.projector_px),
    )


def triangulated(setup: Setup, rays: FloatArray, projector_px: FloatArray) -> FloatArray:
    """Points (N, 3) on the first device's rays, nearest to where the second sees them."""
    depths = depths_on_rays(setup.second_from_first, rays, setup.devices[1].unproject(projector_px))
    return _homogeneous(rays) * depths[:, None]


def on_plane_of(setup: Setup, rays: FloatArray, projector_px: FloatArray, axis: int) -> FloatArray:
    """Points (N, 3) where the first device's rays meet the planes of the projector's columns (axis 0), or rows (1)."""
    ray, pose = _homogeneous(rays), setup.second_from_first
    known = setup.devices[1].unproject(projector_px)[:, axis]
    across = known[:, None] * pose.R[2] - pose.R[axis]  # normals of those planes
    depth = (pose.t[axis] - known * pose.t[2]) / (across * ray).sum(axis=1)
    return ray * depth[:, None]


def _through_device(
    setup: Setup, device: int, points: FloatArray, by_board: FloatArray, measured: FloatArray, view: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Residuals and derivatives of `points` (N, 3) of the first frame, also by the point itself (N, 2, 3).

    by_board (N, 3, OF_BOARD): how the points move with the board's columns, its bend and its pose.
    """
    camera, second, columns = setup.devices[device], setup.second_from_first, setup.columns
    jacobian = np.zeros((len(points), 2, columns.all))
    turned = points @ second.R.T
    seen = turned + second.t if device == 1 else points
    rays = seen[:, :2] / seen[:, 2:]
    by_point = _pixel_by_point(camera, seen)
    jacobian[:, :, columns.intrinsics(device)] = _by_intrinsics(camera, rays)
    if device == 1:
        jacobian[:, :, columns.rotation] = -by_point @ _skew(turned)
        jacobian[:, :, columns.translation] = by_point
        jacobian[:, :, columns.shift] = np.eye(2)
        by_point = by_point @ second.R
    jacobian[:, :, columns.board] = by_point @ by_board
    return camera.project(seen) + device * setup.shifts[view] - measured, jacobian, by_point


def _homogeneous(rays: FloatArray) -> FloatArray:
    return np.concatenate([rays, np.ones((len(rays), 1))], axis=1)


def predicted_px(setup: Setup, group: CornerObservations) -> FloatArray:
    """Pixels (N, 2) of the corners: as measured, and by the fit in the coordinate that the code has not."""
    whole = residuals(setup, replace(group, pixels=np.zeros_like(group.pixels)))
    return np.where(np.isnan(group.pixels), whole, group.pixels)


def _known(error: FloatArray) -> FloatArray:
    """Zero where nothing was measured."""
    one = np.isnan(error).sum(axis=1, keepdims=True) == 1
    return np.where(np.isnan(error) & one, 0.0, error)


def _along_and_across(along: FloatArray, columns: FloatArray, measured: FloatArray) -> FloatArray:
    """`_turned_to_epipolar`; where one coordinate alone is `measured` (N, 2), that one, and zero."""
    turned = _turned_to_epipolar(along, columns)
    one = np.flatnonzero(np.isnan(measured).any(axis=1))
    turned[one, 0] = columns[one, np.isnan(measured[one, 0]).astype(np.int64)]
    turned[one, 1] = 0
    return turned


def _turned_to_epipolar(along: FloatArray, columns: FloatArray) -> FloatArray:
    """`columns` (N, 2, C) of pixels, turned so that the first row lies along the epipolar line."""
    along = along[:, :, 0] / np.linalg.norm(along[:, :, 0], axis=1, keepdims=True)
    x, y = along.T[:, :, None]
    return np.stack([x * columns[:, 0] + y * columns[:, 1], x * columns[:, 1] - y * columns[:, 0]], axis=1)


def _pixel_by_point(camera: Camera, points: FloatArray) -> FloatArray:
    """(N, 2, 3) d pixel / d point of the camera's frame."""
    rays = points[:, :2] / points[:, 2:]
    by_point = np.zeros((len(points), 2, 3))
    by_point[:, 0, 0] = by_point[:, 1, 1] = 1
    by_point[:, :, 2] = -rays
    return camera.ray_jacobian(rays) @ by_point / points[:, 2, None, None]


def _by_intrinsics(camera: Camera, rays: FloatArray) -> FloatArray:
    """(N, 2, 9) d pixel / d `INTRINSICS`, at undistorted rays (N, 2); of a polynomial lens."""
    x, y = rays.T
    r2 = x * x + y * y
    jacobian = np.zeros((len(rays), 2, len(INTRINSICS)))
    distorted = camera.distort(rays)
    jacobian[:, 0, 0], jacobian[:, 1, 1] = distorted.T
    jacobian[:, 0, 2] = jacobian[:, 1, 3] = 1
    lens = np.empty((len(rays), 2, 5))
    for column, power in ((0, r2), (1, r2**2), (4, r2**3)):
        lens[:, :, column] = rays * power[:, None]
    lens[:, 0, 2] = lens[:, 1, 3] = 2 * x * y
    lens[:, 1, 2], lens[:, 0, 3] = r2 + 2 * y * y, r2 + 2 * x * x
    jacobian[:, :, 4:] = camera.K[:2, :2] @ lens
    return jacobian


def _board_poses(setup: Setup, view: IntArray) -> tuple[FloatArray, FloatArray]:
    R = np.stack([pose.R for pose in setup.first_from_board])
    t = np.stack([pose.t for pose in setup.first_from_board])
    return R[view], t[view]


def _bent(setup: Setup, board_points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points (N, 3) of the board as it is, from where they lie on it; and the derivative of their z by the bend."""
    x, y = board_points[:, 0], board_points[:, 1]
    by_bend = np.stack([x * x, x * y, y * y], axis=-1)
    return np.column_stack([x, y, by_bend @ setup.bend]), by_bend


def _on_board(
    setup: Setup, rays: FloatArray, R: FloatArray, t: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Where rays (N, 2) meet the boards at R (N, 3, 3), t (N, 3).

    Points (N, 3), depths (N, 1), normal . ray (N, 1), and the derivative (N, 3) of the board's z there by its bend.
    To first order in the bend: the board's z is that where the ray meets its plane.
    """
    ray = _homogeneous(rays)
    normal = R[:, :, 2]
    slope = np.sum(normal * ray, axis=1, keepdims=True)
    level = np.sum(normal * t, axis=1, keepdims=True)
    flat = np.einsum("nji,nj->ni", R, ray * (level / slope) - t)
    bent, by_bend = _bent(setup, flat)
    depth = (level + bent[:, 2:]) / slope
    return ray * depth, depth, slope, by_bend


def _skew(v: FloatArray) -> FloatArray:
    matrix = np.zeros((len(v), 3, 3))
    matrix[:, 0, 1], matrix[:, 0, 2], matrix[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    return matrix - matrix.transpose(0, 2, 1)
