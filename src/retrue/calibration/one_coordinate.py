"""A projector of whose pixels one coordinate is decoded: a camera of one dimension.

With x the known coordinate and X a point of the camera's frame, x = (f r_x + c r_z | f t_x + c t_z) X / (r_z | t_z) X:
a 2 x 4 matrix, of which seven numbers can be known: f, c, the whole rotation, t_x and t_z. The other focal length,
principal point and t_y leave no trace but in the lens, whose middle they move.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from retrue.calibration.closed_form import Size
from retrue.calibration.observations import View, corner_group
from retrue.calibration.setup import Setup
from retrue.errors import DegenerateError, InputError
from retrue.geometry.arrays import FloatArray
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform, nearest_rotation, skew

UNDETERMINED = "the views do not determine the projector: hold the board at other angles, nearer and farther"
USED = 0.45
"""Of the projector's picture, to either side of its middle: where points of the unknown coordinate are put at most."""


def with_second_by_one_coordinate(setup: Setup, views: list[View], size: Size, known: Camera | None) -> Setup:
    """The setup with the projector, by the linear resection of the coordinate that most corners tell.

    What that coordinate does not tell is assumed: square pixels, but within the picture; the principal point in its
    middle; the lens at the height of the boards' middle.
    """
    group = corner_group(views, 1)
    R, t = np.stack([pose.R for pose in setup.first_from_board]), np.stack([p.t for p in setup.first_from_board])
    points = np.einsum("nij,nj->ni", R[group.view], group.board_points) + t[group.view]
    axis = int(np.argmax(np.isfinite(group.pixels).sum(axis=0)))
    told = np.isfinite(group.pixels[:, axis])
    first, last = _resected(points[told], group.pixels[told, axis], max(size))
    along, forward = _axes(first, last, known.K if known else None, axis)
    across = skew(forward) @ along * (1 if axis == 0 else -1)
    turn = nearest_rotation(np.stack([along, across, forward] if axis == 0 else [across, along, forward]))
    f, c = _scale(first, last, known, axis)
    position = np.zeros(3)
    position[2], position[axis] = last[3], (first[3] - c * last[3]) / f
    position[1 - axis] = -float((points @ turn[1 - axis]).mean())
    second = RigidTransform(turn, position)
    seen = second.apply(points)
    if not (seen[:, 2] > 0).all():
        raise DegenerateError(UNDETERMINED)
    reach = float(np.abs(seen[:, 1 - axis] / seen[:, 2]).max())
    try:
        camera = known or _camera(size, axis, f, c, reach)
    except InputError as error:
        raise DegenerateError(UNDETERMINED) from error
    return Setup.started((*setup.devices, camera), second, setup.first_from_board)


def squared(setup: Setup, unknown: list[int], views: list[View]) -> Setup:
    """After the fit: the focal length of an unknown coordinate as that of the other, as far as the picture holds it."""
    if not unknown:
        return setup
    camera, axis = setup.devices[1], 1 - unknown[0]
    group = corner_group(views, 1)
    R, t = np.stack([pose.R for pose in setup.first_from_board]), np.stack([p.t for p in setup.first_from_board])
    points = np.einsum("nij,nj->ni", R[group.view], group.board_points) + t[group.view]
    seen = setup.second_from_first.apply(points)
    reach = float(np.abs(seen[:, 1 - axis] / seen[:, 2]).max())
    bare = _camera(camera.size, axis, camera.K[axis, axis], camera.K[axis, 2], reach)
    return replace(setup, devices=(setup.devices[0], Camera(camera.size, bare.K, camera.distortion)))


def _resected(points: FloatArray, pixels: FloatArray, side: int) -> tuple[FloatArray, FloatArray]:
    """Rows (4,) and (4,) with x = first . (X, 1) / last . (X, 1), |last[:3]| = 1, by linear least squares."""
    if len(points) < 8:
        raise DegenerateError(UNDETERMINED)
    middle, spread = points.mean(axis=0), float(points.std())
    scaled = np.concatenate([(points - middle) / spread, np.ones((len(points), 1))], axis=1)
    x = (pixels - pixels.mean()) / side
    rows = np.concatenate([scaled, -x[:, None] * scaled], axis=1)
    solution = _smallest(rows)
    for _ in range(2):  # over their depth, points far and near count by their pixels
        solution = _smallest(rows / np.maximum(np.abs(scaled @ solution[4:]), 1e-6)[:, None])
    first, last = side * solution[:4] + float(pixels.mean()) * solution[4:], solution[4:]
    unscale = np.eye(4) / spread
    unscale[3, 3] = 1
    unscale[:3, 3] = -middle / spread
    first, last = first @ unscale, last @ unscale
    ahead = float(np.median(np.column_stack([points, np.ones(len(points))]) @ last))
    length = float(np.copysign(np.linalg.norm(last[:3]), ahead))
    return first / length, last / length


def _smallest(rows: FloatArray) -> FloatArray:
    """The unit vector that the rows are nearest to orthogonal to."""
    values, vectors = np.linalg.eigh(rows.T @ rows)
    if not values[1] > 1e-12 * values[-1]:
        raise DegenerateError(UNDETERMINED)
    return np.asarray(vectors[:, 0], dtype=np.float64)


def _scale(first: FloatArray, last: FloatArray, known: Camera | None, axis: int) -> tuple[float, float]:
    """Focal length and principal point."""
    if known is not None:
        return float(known.K[axis, axis]), float(known.K[axis, 2])
    c = float(first[:3] @ last[:3])
    return float(np.linalg.norm(first[:3] - c * last[:3])), c


def _axes(first: FloatArray, last: FloatArray, K: FloatArray | None, axis: int) -> tuple[FloatArray, FloatArray]:
    """Unit vectors, in the camera's frame, along the coordinate and along the projector's axis."""
    forward = last[:3]
    c = float(K[axis, 2]) if K is not None else float(first[:3] @ forward)
    along = first[:3] - c * forward
    along = along - (along @ forward) * forward
    return along / np.linalg.norm(along), forward


def _camera(size: Size, axis: int, f: float, c: float, reach: float) -> Camera:
    """With the other focal length the same, or as short as keeps what was seen in the picture."""
    K = np.eye(3)
    other = 1 - axis
    K[axis, axis], K[axis, 2] = f, c
    K[other, other] = min(f, USED * size[other] / max(reach, 1e-9))
    K[other, 2] = 0.5 * (size[other] - 1)
    return Camera(size, K)
