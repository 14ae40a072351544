"""Where the bundle adjustment starts: intrinsics from planes (Zhang 2000), poses from their homographies.

For a plane with homography H = K [r1 r2 t] and w = K^-T K^-1: h1' w h2 = 0 and h1' w h1 = h2' w h2, linear in w.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from retrue.calibration.jacobians import residuals
from retrue.calibration.observations import View, corner_group
from retrue.calibration.setup import Setup
from retrue.errors import DegenerateError, InputError
from retrue.geometry.arrays import FloatArray
from retrue.geometry.camera import Camera
from retrue.geometry.homography import fit_homography
from retrue.geometry.transform import RigidTransform, nearest_rotation

Size = tuple[int, int]
FARTHEST_AXIS = 1.0
"""Of the picture's size: few poses suggest principal points anywhere, and a fit does not come back from there."""


def first_camera(views: list[View], size: Size, known: Camera | None) -> Setup:
    """The first device and the board's poses. Raises `DegenerateError` where the views do not tell."""
    homographies = [board_homography(view, 0) for view in views]
    candidates = [known] if known else _cameras(homographies, size)
    setups = [
        Setup.started((camera,), RigidTransform.identity(), poses)
        for camera in candidates
        if (poses := _poses(camera, homographies)) is not None
    ]
    group = corner_group(views, 0)
    return _best([(setup, residuals(setup, group)) for setup in setups], "camera")


def with_second(setup: Setup, views: list[View], size: Size, known: Camera | None) -> Setup:
    """The same, with the second device: a projector, or another camera."""
    if not all(np.isfinite(view.pixels[1][view.seen(1)]).all() for view in views):
        from retrue.calibration.one_coordinate import with_second_by_one_coordinate

        return with_second_by_one_coordinate(setup, views, size, known)
    homographies = [board_homography(view, 1) for view in views]
    group = corner_group(views, 1)
    poses = np.stack([pose.R for pose in setup.first_from_board]), np.stack([p.t for p in setup.first_from_board])
    points = np.einsum("nij,nj->ni", poses[0][group.view], group.board_points) + poses[1][group.view]
    candidates = [known] if known else [*_cameras(homographies, size), *_resected(points, group.pixels, size)]
    setups: list[tuple[Setup, FloatArray]] = []
    for camera in candidates:
        seconds = _poses(camera, homographies)
        if seconds is None:
            continue
        for second_from_board, first_from_board in zip(seconds, setup.first_from_board, strict=True):
            second_from_first = second_from_board @ first_from_board.inverse()
            candidate = Setup.started((*setup.devices, camera), second_from_first, setup.first_from_board)
            setups.append((candidate, residuals(candidate, group)))
    return _best(setups, "projector")


def board_homography(view: View, device: int) -> FloatArray:
    """Pixels of a device from the board (3, 3)."""
    seen = view.seen(device)
    if len(seen) < 4:
        raise DegenerateError(f"{view.name}: expected at least four corners, found {len(seen)}")
    try:
        return fit_homography(view.board_xy[seen], view.pixels[device][seen], source_sigma=0.0)
    except DegenerateError as error:
        raise DegenerateError(f"{view.name}: the board's corners lie on a line") from error


def _cameras(homographies: list[FloatArray], size: Size) -> list[Camera]:
    """Pinhole cameras that these planes suggest: Zhang's, and with the principal point at the middle."""
    cameras: list[Camera] = []
    for K in (*_zhang(homographies, size), *_focal_only(homographies, size)):
        middle = 0.5 * (np.array(size) - 1)
        sound = 0.05 * max(size) < min(K[0, 0], K[1, 1]) and max(K[0, 0], K[1, 1]) < 100 * max(size)
        if sound and (np.abs(K[:2, 2] - middle) < FARTHEST_AXIS * np.array(size)).all():
            cameras.append(Camera(size, K))
    return cameras


def _zhang(homographies: list[FloatArray], size: Size) -> Iterator[FloatArray]:
    """fx, fy, cx, cy from at least two planes; no skew."""
    scale = max(size)
    shrink = np.diag([1 / scale, 1 / scale, 1.0])
    rows: list[FloatArray] = []
    for homography in homographies:
        h = (shrink @ homography / np.linalg.norm(homography[:, :2])).T
        rows += [_zhang_row(h[0], h[1]), _zhang_row(h[0], h[0]) - _zhang_row(h[1], h[1])]
    if len(homographies) < 2:
        return
    b11, b22, b13, b23, b33 = np.linalg.svd(np.array(rows))[2][-1]
    if b11 < 0:
        b11, b22, b13, b23, b33 = -b11, -b22, -b13, -b23, -b33
    if not (b11 > 0 and b22 > 0):
        return
    level = b33 - b13**2 / b11 - b23**2 / b22
    if level > 0:
        fx, fy = scale * np.sqrt(level / b11), scale * np.sqrt(level / b22)
        yield np.array([[fx, 0, -scale * b13 / b11], [0, fy, -scale * b23 / b22], [0, 0, 1]])


def _zhang_row(a: FloatArray, b: FloatArray) -> FloatArray:
    """a' w b as coefficients of w11, w22, w13, w23, w33."""
    return np.array([a[0] * b[0], a[1] * b[1], a[0] * b[2] + a[2] * b[0], a[1] * b[2] + a[2] * b[1], a[2] * b[2]])


def _focal_only(homographies: list[FloatArray], size: Size) -> Iterator[FloatArray]:
    """One focal length, with the principal point at the middle of the picture, and at its lower and upper edge.

    Projectors shift their lens so that the axis leaves the panel at the middle of its lower or upper edge.
    """
    width, height = size
    for cy in (0.5 * (height - 1), float(height - 1), 0.0):
        centre = np.array([0.5 * (width - 1), cy])
        left, right = 0.0, 0.0
        for homography in homographies:
            h = homography / np.linalg.norm(homography[:, :2])
            (x1, y1, z1), (x2, y2, z2) = (
                np.append(column[:2] - centre * column[2], column[2] * width) for column in h.T[:2]
            )
            for a, b in ((x1 * x2 + y1 * y2, z1 * z2), (x1**2 + y1**2 - x2**2 - y2**2, z1**2 - z2**2)):
                left, right = left + a * a, right - a * b
        if right > 0:  # a / f^2 + b / width^2 = 0 in the least-squares sense
            f = width * np.sqrt(left / right)
            yield np.array([[f, 0, centre[0]], [0, f, centre[1]], [0, 0, 1]])


def _resected(points: FloatArray, pixels: FloatArray, size: Size) -> list[Camera]:
    """The intrinsics of the linear resection (DLT) of points (N, 3) that do not lie in one plane."""
    if len(points) < 6:
        return []
    middle, spread = points.mean(axis=0), float(points.std())
    scaled = np.concatenate([(points - middle) / spread, np.ones((len(points), 1))], axis=1)
    u, v = ((pixels - pixels.mean(axis=0)) / max(size)).T
    zero = np.zeros_like(scaled)
    rows = np.concatenate(
        [
            np.concatenate([scaled, zero, -u[:, None] * scaled], axis=1),
            np.concatenate([zero, scaled, -v[:, None] * scaled], axis=1),
        ]
    )
    values, vectors = np.linalg.eigh(rows.T @ rows)
    if not values[1] > 1e-12 * values[-1]:
        return []
    P = vectors[:, 0].reshape(3, 4)
    back = np.eye(3)
    back[:2, :2] *= max(size)
    back[:2, 2] = pixels.mean(axis=0)
    flip = np.eye(3)[::-1]
    _, r = np.linalg.qr((flip @ back @ P[:, :3]).T)  # RQ: the upper triangle first
    upper = flip @ r.T @ flip
    upper = upper @ np.diag(np.sign(np.diag(upper)))
    if not abs(upper[2, 2]) > 0:
        return []
    fx, fy, cx, cy = upper[[0, 1, 0, 1], [0, 1, 2, 2]] / upper[2, 2]
    try:
        return [Camera(size, np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]))]
    except InputError:
        return []


def _poses(camera: Camera, homographies: list[FloatArray]) -> tuple[RigidTransform, ...] | None:
    """The board's pose in each view: K^-1 H = [r1 r2 t] up to scale."""
    poses: list[RigidTransform] = []
    for homography in homographies:
        columns = np.asarray(np.linalg.solve(camera.K, homography), dtype=np.float64)
        length = 0.5 * (np.linalg.norm(columns[:, 0]) + np.linalg.norm(columns[:, 1]))
        columns = columns / (np.sign(columns[2, 2]) * length)  # the board's origin is in front
        if not np.isfinite(columns).all():
            return None
        third = np.asarray(np.cross(columns[:, 0], columns[:, 1]), dtype=np.float64)
        R = nearest_rotation(np.column_stack([columns[:, 0], columns[:, 1], third]))
        poses.append(RigidTransform(R, columns[:, 2]))
    return tuple(poses)


def _best(setups: list[tuple[Setup, FloatArray]], device: str) -> Setup:
    """The start with the smallest typical error."""
    if setups:
        lengths = [np.linalg.norm(error, axis=1) for _, error in setups]
        typical = [float(np.median(np.where(np.isfinite(length), length, 1e9))) for length in lengths]
        if min(typical) < 1e6:
            return setups[int(np.argmin(typical))][0]
    raise DegenerateError(f"the views do not determine the {device}: hold the board at other angles")
