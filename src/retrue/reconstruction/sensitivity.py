"""How a triangulated point moves with the pixels that it was measured from, and with the rig.

A point X is seen at the pixels h(X, q) of both devices, (4,), where q are the `RIG_NUMBERS`. `reconstruct` answers
the X whose rays lie nearest to the measured ones, in pixels of the mean focal length of each device. So, linearised
there, with A = dh / dX and M such rays by pixels,

    dX = B (dm - dh/dq dq),   B = (A^T M^T M A)^-1 A^T M^T M.

Of one projector coordinate the other has no row, and B = A^-1.
"""

from __future__ import annotations

import numpy as np

from retrue.geometry.arrays import FloatArray
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.geometry.two_view import tangent_basis
from retrue.rig import Rig
from retrue.rig_evidence import LENS, POSE, RIG_NUMBERS


def pixels_by_point(rig: Rig, points: FloatArray, axes: tuple[int, ...]) -> FloatArray:
    """A (N, 2 + len(axes), 3): the camera's pixel, and those coordinates of the projector's, by points (N, 3)."""
    in_projector = rig.projector_from_camera.apply(points)
    camera = _by_point(rig.camera, points)
    projector = _by_point(rig.projector, in_projector) @ rig.projector_from_camera.R
    return np.concatenate([camera, projector[:, list(axes)]], axis=1)


def point_by_pixels(rig: Rig, points: FloatArray, axes: tuple[int, ...]) -> FloatArray:
    """B (N, 3, 2 + len(axes)): points (N, 3) by the pixels that they were measured from; NaN where those hold none."""
    A = pixels_by_point(rig, points, axes)
    if len(axes) == 2:
        M = _straightened(rig, points)
        A = M @ A
        return _inverse(np.swapaxes(A, 1, 2) @ A) @ (np.swapaxes(A, 1, 2) @ M)
    return _inverse(np.swapaxes(A, 1, 2) @ A) @ np.swapaxes(A, 1, 2)


def miss_by_pixels(rig: Rig, points: FloatArray) -> FloatArray:
    """(N, 4) the distance by which both rays of points (N, 3) miss each other, up to its sign, by their four pixels.

    It is along the unit vector normal to the columns of M A: the error that no point explains.
    """
    M = _straightened(rig, points)
    A = M @ pixels_by_point(rig, points, (0, 1))
    rows = ((1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2))
    minors = [np.einsum("ni,ni->n", A[:, i], np.cross(A[:, j], A[:, k])) for i, j, k in rows]
    normal = np.stack([minors[0], -minors[1], minors[2], -minors[3]], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return (normal[:, None] @ M)[:, 0]


def _straightened(rig: Rig, points: FloatArray) -> FloatArray:
    """M (N, 4, 4): undistorted rays, in pixels of the mean focal length, by the pixels of both devices."""
    M = np.zeros((len(points), 4, 4))
    for first, device, seen in (
        (0, rig.camera, points),
        (2, rig.projector, rig.projector_from_camera.apply(points)),
    ):
        (a, b), (c, d) = np.moveaxis(device.ray_jacobian(seen[:, :2] / seen[:, 2:]), 0, -1)
        scale = np.sqrt(device.K[0, 0] * device.K[1, 1]) / (a * d - b * c)
        own = M[:, first : first + 2, first : first + 2]
        own[:, 0, 0], own[:, 0, 1], own[:, 1, 0], own[:, 1, 1] = d * scale, -b * scale, -c * scale, a * scale
    return M


def _inverse(symmetric: FloatArray) -> FloatArray:
    """(N, 3, 3); NaN of a matrix that has none."""
    a, b, c, d, e, f = (symmetric[:, i, j] for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)))
    inverse = np.empty_like(symmetric)
    inverse[:, 0, 0], inverse[:, 1, 1], inverse[:, 2, 2] = d * f - e * e, a * f - c * c, a * d - b * b
    inverse[:, 0, 1] = inverse[:, 1, 0] = c * e - b * f
    inverse[:, 0, 2] = inverse[:, 2, 0] = b * e - c * d
    inverse[:, 1, 2] = inverse[:, 2, 1] = b * c - a * e
    determinant = a * inverse[:, 0, 0] + b * inverse[:, 0, 1] + c * inverse[:, 0, 2]
    return inverse / np.where(determinant > 0, determinant, np.nan)[:, None, None]


def pixels_by_rig(rig: Rig, points: FloatArray, axes: tuple[int, ...]) -> FloatArray:
    """dh/dq (N, 2 + len(axes), 14)."""
    pose = rig.projector_from_camera
    found = np.zeros((len(points), 4, RIG_NUMBERS))
    found[:, :2, POSE : POSE + LENS] = _by_lens(rig.camera, points)
    in_projector = pose.apply(points)
    found[:, 2:, POSE + LENS :] = _by_lens(rig.projector, in_projector)
    moved = np.empty((len(points), 3, POSE))
    turned = in_projector - pose.t
    for axis in range(3):  # R <- exp([w]x) R
        moved[:, :, axis] = np.cross(np.eye(3)[axis], turned)
    length = float(np.linalg.norm(pose.t))
    moved[:, :, 3:5] = length * tangent_basis(pose.t / length)
    moved[:, :, 5] = pose.t
    found[:, 2:, :POSE] = _by_point(rig.projector, in_projector) @ moved
    return found[:, [0, 1, *(2 + axis for axis in axes)]]


def moved_rig(rig: Rig, change: FloatArray) -> Rig:
    """The rig with its numbers q changed by (14,)."""
    pose = rig.projector_from_camera
    length = float(np.linalg.norm(pose.t))
    direction = pose.t / length + tangent_basis(pose.t / length) @ change[3:5]
    turn = RigidTransform.from_rotation_vector(change[:3], np.zeros(3))
    t = direction / np.linalg.norm(direction) * length * np.exp(change[5])
    camera, projector = (
        _moved_lens(device, change[first : first + LENS])
        for device, first in ((rig.camera, POSE), (rig.projector, POSE + LENS))
    )
    return Rig(camera, projector, RigidTransform(turn.R @ pose.R, t), rig.unit, rig.evidence)


def _moved_lens(device: Camera, change: FloatArray) -> Camera:
    K, distortion = device.K.copy(), device.distortion.copy()
    K[:2, :2] *= np.exp(change[0])
    K[:2, 2] += change[1:3]
    distortion[0] += change[3]
    return Camera(device.size, K, distortion)


def _by_point(device: Camera, points: FloatArray) -> FloatArray:
    """(N, 2, 3) pixel by points (N, 3) of the device's frame."""
    rays = points[:, :2] / points[:, 2:]
    perspective = np.zeros((len(points), 2, 3))
    perspective[:, 0, 0] = perspective[:, 1, 1] = 1 / points[:, 2]
    perspective[:, :, 2] = -rays / points[:, 2:]
    return device.ray_jacobian(rays) @ perspective


def _by_lens(device: Camera, points: FloatArray) -> FloatArray:
    """(N, 2, 4) pixel by the log of the focal length, the principal point and k1."""
    rays = points[:, :2] / points[:, 2:]
    found = np.empty((len(points), 2, LENS))
    found[:, :, 0] = device.distort(rays) @ device.K[:2, :2].T
    found[:, :, 1:3] = np.eye(2)
    square = (rays**2).sum(axis=1, keepdims=True)
    k4, k5, k6 = np.pad(device.distortion, (0, 7))[5:8]
    found[:, :, 3] = rays * square / (1 + square * (k4 + square * (k5 + square * k6))) @ device.K[:2, :2].T
    return found
