"""Where two rays meet: the paper's linear least squares, and the statistically optimal answer.

Both take undistorted normalised rays (x, y) = (X / Z, Y / Z) of each device, N at a time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from retrue.errors import require_kind
from retrue.geometry.arrays import FloatArray, array_of
from retrue.geometry.transform import RigidTransform, skew
from retrue.kernels import triangulation as kernel

BLOCK = 8192  # points at a time: what fits into the processor's cache
SMALLEST_PARALLAX = 1e-12  # radians; below it the depth has no digit left in double precision

# One device's rays as columns (x, y).
_Columns = tuple[FloatArray, FloatArray]


def triangulate(
    projector_from_camera: RigidTransform,
    camera_rays: ArrayLike,
    projector_rays: ArrayLike,
    *,
    camera_sigma: ArrayLike = 1.0,
    projector_sigma: ArrayLike = 1.0,
) -> FloatArray:
    """Points (N, 3) whose projections lie nearest to both rays: maximum likelihood for Gaussian noise.

    Minimises |dx|^2 / camera_sigma^2 + |dy|^2 / projector_sigma^2 under (y + dy)^T E (x + dx) = 0,
    E = [t]x R, by two steps of Lindstrom's iteration, each of which meets the constraint exactly; the
    corrected rays then truly intersect.

    Parameters
    ----------
    projector_from_camera : the rig's pose; t gives the unit of the answer.
    camera_rays, projector_rays : (N, 2) undistorted normalised rays of the two devices.
    camera_sigma, projector_sigma : noise of the rays, scalars or (N,); only their ratio matters.
        For pixel noise that is the same in both devices: one over the focal length of each.

    Returns
    -------
    (N, 3) in the camera frame, in the unit of t; NaN where the rays meet behind either device, or
    nowhere (parallel).

    Source: P. Lindstrom, "Triangulation made easy", CVPR 2010 (niter2, here with unequal noise).

    >>> pose = RigidTransform.from_rotation_vector([0.0, 0.3, 0.0], [-0.5, 0.0, 0.1])
    >>> seen = pose.apply([0.2, -0.1, 2.0])
    >>> triangulate(pose, [[0.1, -0.05]], [seen[:2] / seen[2]]).round(9).tolist()
    [[0.2, -0.1, 2.0]]
    """
    require_kind(projector_from_camera, RigidTransform, "projector_from_camera")
    R, t = projector_from_camera.R, projector_from_camera.t
    x = np.ascontiguousarray(array_of(camera_rays, (None, 2), "camera_rays"))
    y = np.ascontiguousarray(array_of(projector_rays, (len(x), 2), "projector_rays"))
    vx = np.square(_one_or_each(camera_sigma, len(x), "camera_sigma"))
    vy = np.square(_one_or_each(projector_sigma, len(x), "projector_sigma"))
    return triangulate_rays(R, t, x, y, vx, vy)


def triangulate_rays(
    R: FloatArray, t: FloatArray, x: FloatArray, y: FloatArray, x_variance: FloatArray, y_variance: FloatArray
) -> FloatArray:
    """The same of arrays that nobody need ask whether they are rays (N, 2) and variances, (1,) or (N,)."""
    points = np.empty((len(x), 3))
    R, t, E = (np.ascontiguousarray(part) for part in (R, t, skew(t) @ R))
    kernel.triangulate(R, t, E, x, y, x_variance, y_variance, SMALLEST_PARALLAX, points)
    return points


def triangulate_linear(
    projector_from_camera: RigidTransform, camera_rays: ArrayLike, projector_rays: ArrayLike
) -> FloatArray:
    """Points (N, 3) by least squares on the four linear equations in X, eqs (5) and (6) of the paper.

    Rows (1, 0, -x1), (0, 1, -x2), r1 - y1 r3, r2 - y2 r3 with right sides 0, 0, y1 t3 - t1, y2 t3 - t2; the
    3 x 3 normal equations are solved by cofactors for all points at once. It minimises an algebraic
    error; `triangulate` minimises the geometric one. Frames, units and NaN as there.

    Source: Zhang, Li, Wu 2007, eqs (5) and (6), on undistorted normalised rays.

    >>> pose = RigidTransform.from_rotation_vector([0.0, 0.3, 0.0], [-0.5, 0.0, 0.1])
    >>> seen = pose.apply([0.2, -0.1, 2.0])
    >>> triangulate_linear(pose, [[0.1, -0.05]], [seen[:2] / seen[2]]).round(9).tolist()
    [[0.2, -0.1, 2.0]]
    """
    R, t = projector_from_camera.R, projector_from_camera.t

    x, y = np.asarray(camera_rays, dtype=np.float64), np.asarray(projector_rays, dtype=np.float64)
    points = np.empty((len(x), 3))
    with np.errstate(all="ignore"):
        for start in range(0, len(x), BLOCK):
            rows = slice(start, start + BLOCK)
            X, Y, Z = _least_squares(
                R, t, (x[rows, 0].copy(), x[rows, 1].copy()), (y[rows, 0].copy(), y[rows, 1].copy())
            )
            projector_depth = R[2, 0] * X + R[2, 1] * Y + R[2, 2] * Z + t[2]
            in_front = (Z > 0) & (projector_depth > 0) & np.isfinite(X) & np.isfinite(Y) & np.isfinite(Z)
            for axis, column in enumerate((X, Y, Z)):
                points[rows, axis] = np.where(in_front, column, np.nan)
    return points


def depths_on_rays(
    projector_from_camera: RigidTransform, camera_rays: ArrayLike, projector_rays: ArrayLike
) -> FloatArray:
    """Depth (N,) of the point ON each camera ray that the projector sees nearest to its own ray; NaN for parallel ones.

    Least squares in Z (R x - y (R x)_3) = y t_3 - t, the first two rows: distances in the projector's picture.

    >>> depths_on_rays(RigidTransform(np.eye(3), [-1.0, 0.0, 0.0]), [[0.2, 0.1], [0.2, 0.1]], [[0.1, 0.1], [0.2, 0.1]])
    array([10., nan])
    """
    x, y = np.asarray(camera_rays, dtype=np.float64), np.asarray(projector_rays, dtype=np.float64)
    R, t = projector_from_camera.R, projector_from_camera.t
    turned = x @ R[:, :2].T + R[:, 2]
    a, b = turned[:, :2] - y * turned[:, 2:], y * t[2] - t[:2]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.sum(a * b, axis=1) / np.sum(a * a, axis=1)


def sampson_distances(
    projector_from_camera: RigidTransform,
    camera_rays: ArrayLike,
    projector_rays: ArrayLike,
    *,
    camera_sigma: ArrayLike = 1.0,
    projector_sigma: ArrayLike = 1.0,
) -> FloatArray:
    """Signed distance (N,) of each pair of rays from meeting, in units of the sigmas, to first order.

    e / sqrt(camera_sigma^2 |(E^T y)_12|^2 + projector_sigma^2 |(E x)_12|^2), e = y^T E x, E = [t]x R. With sigmas
    of one over the focal lengths the unit is the pixel. NaN at an epipole, where every ray meets.

    >>> sideways = RigidTransform(np.eye(3), [-1.0, 0.0, 0.0])
    >>> sampson_distances(sideways, [[0.2, 0.1]], [[0.1, 0.13]]).round(6).tolist()  # 0.03 apart, shared by two rays
    [0.021213]
    """
    E = skew(projector_from_camera.t) @ projector_from_camera.R
    return distances_of_essential(E, camera_rays, projector_rays, camera_sigma, projector_sigma)


def distances_of_essential(
    E: FloatArray,
    camera_rays: ArrayLike,
    projector_rays: ArrayLike,
    camera_sigma: ArrayLike = 1.0,
    projector_sigma: ArrayLike = 1.0,
) -> FloatArray:
    """The same (N,) of an essential matrix (3, 3), of any scale."""
    x = np.ascontiguousarray(array_of(camera_rays, (None, 2), "camera_rays"))
    y = np.ascontiguousarray(array_of(projector_rays, (len(x), 2), "projector_rays"))
    sigma = _one_or_each(camera_sigma, len(x), "camera_sigma"), _one_or_each(projector_sigma, len(x), "projector_sigma")
    distances = np.empty(len(x))
    kernel.sampson(np.ascontiguousarray(E), x, y, *sigma, distances)
    return distances


def _one_or_each(sigma: ArrayLike, count: int, name: str) -> FloatArray:
    """(1,) of a number, else (N,)."""
    return np.ascontiguousarray(array_of(np.atleast_1d(sigma), (1 if np.ndim(sigma) == 0 else count,), name))


def _least_squares(R: FloatArray, t: FloatArray, x: _Columns, y: _Columns) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A^T A X = A^T b of the four equations, by cofactors."""
    (x1, x2), (y1, y2) = x, y
    p1, p2, p3 = (R[0, i] - y1 * R[2, i] for i in range(3))
    q1, q2, q3 = (R[1, i] - y2 * R[2, i] for i in range(3))
    g, h = y1 * t[2] - t[0], y2 * t[2] - t[1]
    m11, m22, m33 = 1 + p1 * p1 + q1 * q1, 1 + p2 * p2 + q2 * q2, x1 * x1 + x2 * x2 + p3 * p3 + q3 * q3
    m12, m13, m23 = p1 * p2 + q1 * q2, p1 * p3 + q1 * q3 - x1, p2 * p3 + q2 * q3 - x2
    b1, b2, b3 = p1 * g + q1 * h, p2 * g + q2 * h, p3 * g + q3 * h
    c11, c12, c13 = m22 * m33 - m23 * m23, m13 * m23 - m12 * m33, m12 * m23 - m13 * m22
    c22, c23, c33 = m11 * m33 - m13 * m13, m12 * m13 - m11 * m23, m11 * m22 - m12 * m12
    determinant = m11 * c11 + m12 * c12 + m13 * c13
    # The determinant falls with the square of the parallax, and so reaches rounding earlier.
    smallest = np.finfo(np.float64).eps * m11 * m22 * m33
    inverse = 1 / np.where(determinant > smallest, determinant, np.nan)
    X = (c11 * b1 + c12 * b2 + c13 * b3) * inverse
    Y = (c12 * b1 + c22 * b2 + c23 * b3) * inverse
    Z = (c13 * b1 + c23 * b2 + c33 * b3) * inverse
    return X, Y, Z
