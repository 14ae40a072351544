"""Refinement of one relative pose over any number of planes and free points, and its covariance.

The unknowns are R (3), the direction of t (2) and n of each plane (3), with |t| = 1. No 3D point is
a parameter: a free point leaves its epipolar residual; a point on a plane leaves a second one,
along the epipolar line, given the first. Both are whitened, so that their squares sum to the chi-square of the
full bundle adjustment, and both are linearised at the corrected rays, so that the fit settles
where the full bundle adjustment does.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from retrue.errors import DegenerateError
from retrue.geometry.arrays import FloatArray, IntArray
from retrue.geometry.transform import rotation_from_vector, skew

POSE_PARAMETERS = 5
FREE = -1
"""Index of the plane of a point that lies on none."""


@dataclass(frozen=True, slots=True, eq=False)
class TwoViewPoints:
    """N matched rays and what is known of their noise.

    Attributes
    ----------
    camera_rays, projector_rays : (N, 2) undistorted, normalised.
    camera_sigma, projector_sigma : (N,) noise per axis, in the unit of the rays. Zero stands for exact.
    plane_index : (N,) which plane each point may lie on, or `FREE`.
    """

    camera_rays: FloatArray
    projector_rays: FloatArray
    camera_sigma: FloatArray
    projector_sigma: FloatArray
    plane_index: IntArray

    def __len__(self) -> int:
        return len(self.camera_rays)

    def select(self, rows: IntArray | slice | np.ndarray) -> TwoViewPoints:
        """The same, with only those rows."""
        return TwoViewPoints(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


@dataclass(frozen=True, slots=True, eq=False)
class TwoViewPose:
    """A pose up to scale, with the planes that it sees.

    Attributes
    ----------
    R : (3, 3) projector from camera.
    t : (3,) unit direction.
    planes : (P, 3) n of each plane, n . X = 1, in units of |t|.
    """

    R: FloatArray
    t: FloatArray
    planes: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))

    def moved(self, step: FloatArray) -> TwoViewPose:
        """R <- exp([w]x) R, t <- unit(t + B d), n <- n + e for step = (w, d, e ...) of (5 + 3 P,)."""
        t = self.t + tangent_basis(self.t) @ step[3:5]
        return TwoViewPose(
            rotation_from_vector(step[:3]) @ self.R,
            t / np.linalg.norm(t),
            self.planes + step[POSE_PARAMETERS:].reshape(-1, 3),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Residuals:
    """Whitened residuals with their Jacobians.

    Attributes
    ----------
    epipolar : (N,) across the epipolar line, of every point.
    epipolar_jacobian : (5, N) by pose.
    along : (M,) along the epipolar line, of the points `rows` (M,) that have a plane.
    along_jacobian : (8, M) by pose and by the point's own plane.
    """

    epipolar: FloatArray
    epipolar_jacobian: FloatArray
    rows: IntArray
    along: FloatArray
    along_jacobian: FloatArray


def tangent_basis(t: FloatArray) -> FloatArray:
    """(3, 2) orthonormal basis of the plane normal to the unit vector t.

    >>> tangent_basis(np.array([0.0, 0.0, 1.0])).round(9).tolist()
    [[0.0, -1.0], [1.0, 0.0], [0.0, 0.0]]
    """
    axis = np.zeros(3)
    axis[np.argmin(np.abs(t))] = 1.0
    T = skew(t)
    first = T @ axis
    first /= np.linalg.norm(first)
    return np.stack([first, T @ first], axis=1)


def epipolar_residuals(R: FloatArray, t: FloatArray, points: TwoViewPoints) -> FloatArray:
    """Whitened Sampson residual (N,) of y . ([t]x R) x = 0, eq. (19); chi with one degree of freedom each.

    >>> points = TwoViewPoints(*np.array([[[0.0, 0.0]], [[0.1, 3e-3]]]), *np.full((2, 1), 1e-3), np.array([-1]))
    >>> epipolar_residuals(np.eye(3), np.array([1.0, 0, 0]), points).round(4).tolist()
    [-2.1213]
    """
    E = skew(t) @ R
    (ex, ey, value), (fx, fy, _) = _epipolar_lines(E, points.camera_rays, points.projector_rays)
    variance = points.projector_sigma**2 * (ex * ex + ey * ey) + points.camera_sigma**2 * (fx * fx + fy * fy)
    return value / np.sqrt(variance)


def residuals(pose: TwoViewPose, points: TwoViewPoints, *, jacobian: bool = True) -> Residuals:
    """Both families of residuals at a pose, linearised at the corrected rays (see `TwoViewPose`)."""
    R, t = pose.R, pose.t
    E = skew(t) @ R  # [t]x R
    x, y = points.camera_rays, points.projector_rays
    vx, vy = points.camera_sigma**2, points.projector_sigma**2
    (ex, ey, value), (fx, fy, _) = _epipolar_lines(E, x, y)
    gain = value / (vy * (ex * ex + ey * ey) + vx * (fx * fx + fy * fy))
    correction_x, correction_y = vx * gain, vy * gain
    x = x - np.stack([correction_x * fx, correction_x * fy], axis=1)
    y = y - np.stack([correction_y * ex, correction_y * ey], axis=1)
    offset_x, offset_y = points.camera_rays - x, points.projector_rays - y
    (ex, ey, value), (fx, fy, _) = _epipolar_lines(E, x, y)
    value = value + ex * offset_y[:, 0] + ey * offset_y[:, 1] + fx * offset_x[:, 0] + fy * offset_x[:, 1]
    norm = np.sqrt(vy * (ex * ex + ey * ey) + vx * (fx * fx + fy * fy))

    rows = np.flatnonzero(points.plane_index >= 0)
    basis = tangent_basis(t)
    v = x @ R[:, :2].T + R[:, 2]  # R x, (N, 3)
    epipolar_jacobian = np.empty((0, 0))
    if jacobian:
        # e = y . (t x v): by w it is v x (y x t), by t it is v x y.
        y3 = np.concatenate([y, np.ones((len(y), 1))], axis=1).T
        v3 = v.T
        by_rotation = _cross(v3, _cross(y3, t[:, None] * np.ones_like(v3[:1])))
        by_translation = basis.T @ _cross(v3, y3)
        epipolar_jacobian = np.concatenate([by_rotation, by_translation]) / norm
    along, along_jacobian = _along(pose, points, rows, x, v, ex, ey, basis, jacobian)
    return Residuals(value / norm, epipolar_jacobian, rows, along, along_jacobian)


def normal_equations(
    pose: TwoViewPose,
    points: TwoViewPoints,
    found: Residuals,
    epipolar_weights: FloatArray,
    along_weights: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """J^T W J (5 + 3 P, 5 + 3 P) and J^T W r of weighted residuals.

    A plane whose points all lost their weight is held where it is, by one unit of information relative to its n:
    next to nothing where it has points, and enough that it does not leave the pose undetermined.
    """
    size = POSE_PARAMETERS + 3 * len(pose.planes)
    information, gradient = np.zeros((size, size)), np.zeros(size)
    weighted = found.epipolar_jacobian * epipolar_weights
    information[:5, :5] = weighted @ found.epipolar_jacobian.T
    gradient[:5] = weighted @ found.epipolar
    plane_of_row = points.plane_index[found.rows]
    for plane in range(len(pose.planes)):
        mine = plane_of_row == plane
        jacobian = found.along_jacobian[:, mine]
        weighted = jacobian * along_weights[mine]
        index = np.r_[0:5, 5 + 3 * plane : 8 + 3 * plane]
        information[np.ix_(index, index)] += weighted @ jacobian.T
        held = index[POSE_PARAMETERS:]
        information[held, held] += 1 / max(float(pose.planes[plane] @ pose.planes[plane]), 1e-12)
        gradient[index] += weighted @ found.along[mine]
    return information, gradient


def pose_covariance(information: FloatArray) -> FloatArray:
    """(5, 5) covariance of (rotation vector in the projector frame, direction of t in `tangent_basis`).

    The Cramer-Rao bound where `information` comes from true parameters and true variances. Raises
    DegenerateError where the data do not determine the pose.

    >>> pose_covariance(np.diag([4.0, 4, 4, 1, 1])).diagonal().tolist()
    [0.25, 0.25, 0.25, 1.0, 1.0]
    """
    scale = np.sqrt(np.maximum(np.diag(information), 0.0))
    if not (scale > 0).all():
        raise DegenerateError("pose: the points do not determine it; show a plane that fills more of the picture")
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    if not values[0] > 1e-13 * values[-1]:
        raise DegenerateError("pose: the points do not determine it; show a plane that fills more of the picture")
    root = (vectors[:POSE_PARAMETERS] / np.sqrt(values)) / scale[:POSE_PARAMETERS, None]
    return root @ root.T


def cramer_rao_bound(pose: TwoViewPose, points: TwoViewPoints) -> FloatArray:
    """(5, 5) smallest covariance that any unbiased estimator can have, for noise-free points at the true pose.

    Parameters as in `residuals`; the sigmas of `points` are the true ones. Source: docs/method.md.
    """
    found = residuals(pose, points)
    information, _ = normal_equations(pose, points, found, np.ones(len(points)), np.ones(len(found.rows)))
    return pose_covariance(information)


def planes_of_pose(R: FloatArray, t: FloatArray, homographies: list[FloatArray]) -> FloatArray:
    """n (P, 3) of each plane for a given pose: the least-squares solution of lambda H = R + t n^T, eq. (28).

    >>> H = np.eye(3) + np.outer([1.0, 0, 0], [0.1, 0.2, 0.3])
    >>> planes_of_pose(np.eye(3), np.array([1.0, 0, 0]), [2 * H]).round(9).tolist()
    [[0.1, 0.2, 0.3]]
    """
    planes = np.empty((len(homographies), 3))
    for index, H in enumerate(homographies):
        # lambda from the rows that t does not touch: [t]x (lambda H - R) = 0.
        A, B = np.cross(t, H.T).T, skew(t) @ R
        planes[index] = t @ (H * (np.sum(A * B) / np.sum(A * A)) - R)
    return planes


def _epipolar_lines(
    E: FloatArray, x: FloatArray, y: FloatArray
) -> tuple[tuple[FloatArray, FloatArray, FloatArray], tuple[FloatArray, FloatArray, FloatArray]]:
    """First two entries of E x with y . E x, and the first two of E^T y."""
    line = x @ E[:, :2].T + E[:, 2]
    ex, ey = line[:, 0], line[:, 1]
    value = ex * y[:, 0] + ey * y[:, 1] + line[:, 2]
    other = y @ E[:2, :2] + E[2, :2]
    return (ex, ey, value), (other[:, 0], other[:, 1], value)


def _along(
    pose: TwoViewPose,
    points: TwoViewPoints,
    rows: IntArray,
    x: FloatArray,
    v: FloatArray,
    ex: FloatArray,
    ey: FloatArray,
    basis: FloatArray,
    jacobian: bool,
) -> tuple[FloatArray, FloatArray]:
    """The residual along the epipolar line, given the one across it, and its (8, M) Jacobian."""
    if len(rows) == 0:
        return np.empty(0), np.empty((8, 0))
    every = len(rows) == len(x)
    if not every:
        x, v, ex, ey = x[rows], v[rows], ex[rows], ey[rows]
    plane = points.plane_index[rows]
    n = pose.planes[plane]
    disparity = x[:, 0] * n[:, 0] + x[:, 1] * n[:, 1] + n[:, 2]  # |t| / depth
    w0, w1, w2 = (v + disparity[:, None] * pose.t).T  # H x
    h0, h1 = w0 / w2, w1 / w2
    H = pose.R[None] + pose.t[None, :, None] * pose.planes[:, None, :]  # (P, 3, 3)
    Hx = H[plane]
    # d h / d x, (2, 2) per point.
    j00, j01 = (Hx[:, 0, 0] - h0 * Hx[:, 2, 0]) / w2, (Hx[:, 0, 1] - h0 * Hx[:, 2, 1]) / w2
    j10, j11 = (Hx[:, 1, 0] - h1 * Hx[:, 2, 0]) / w2, (Hx[:, 1, 1] - h1 * Hx[:, 2, 1]) / w2
    offset = points.camera_rays[rows] - x
    target = points.projector_rays[rows]
    d0 = target[:, 0] - h0 - j00 * offset[:, 0] - j01 * offset[:, 1]
    d1 = target[:, 1] - h1 - j10 * offset[:, 0] - j11 * offset[:, 1]
    length = np.hypot(ex, ey)
    n0, n1 = ex / length, ey / length  # across the epipolar line; (-n1, n0) runs along it
    vx, vy = points.camera_sigma[rows] ** 2, points.projector_sigma[rows] ** 2
    c00, c01, c11 = vy + vx * (j00**2 + j01**2), vx * (j00 * j10 + j01 * j11), vy + vx * (j10**2 + j11**2)
    across_variance = n0 * n0 * c00 + 2 * n0 * n1 * c01 + n1 * n1 * c11
    along_variance = n1 * n1 * c00 - 2 * n0 * n1 * c01 + n0 * n0 * c11
    covariance = n0 * n1 * (c11 - c00) + (n0 * n0 - n1 * n1) * c01
    slope = covariance / across_variance
    left = along_variance - slope * covariance
    known = left > 1e-12 * along_variance  # else the plane is seen edge-on: no information along the line
    scale = np.where(known, 1 / np.sqrt(np.where(known, left, 1.0)), 0.0)
    g0, g1 = (-n1 - slope * n0) * scale, (n0 - slope * n1) * scale  # residual = g . d
    along = g0 * d0 + g1 * d1
    if not jacobian:
        return along, np.empty((8, 0))
    # d h = (I, -h) d w / w2, so that g . d h = p . d w with p = (g, -g . h) / w2; residual = -p . d w.
    p = np.stack([g0, g1, -(g0 * h0 + g1 * h1)]) / -w2
    by_translation = basis.T @ (p * disparity)
    t_along = pose.t @ p
    by_plane = np.stack([t_along * x[:, 0], t_along * x[:, 1], t_along])
    by_rotation = _cross(v.T, p)  # p . (w x v) = w . (v x p)
    return along, np.concatenate([by_rotation, by_translation, by_plane])


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross product of (3, N) arrays; np.cross is several times slower."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
