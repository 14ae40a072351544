"""Where two rays meet: the paper's linear least squares, and the statistically optimal answer.

Both take undistorted normalised rays (x, y) = (X / Z, Y / Z) of each device, N at a time.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from retrue.errors import require_kind
from retrue.geometry.arrays import FloatArray
from retrue.geometry.transform import RigidTransform, skew

BLOCK = 8192  # points at a time: what fits into the processor's cache
SMALLEST_PARALLAX = 1e-12  # radians; below it the depth has no digit left in double precision

# One device's rays as columns (x, y); what a scalar or an array per point is.
_Columns = tuple[FloatArray, FloatArray]
_Solver = Callable[[_Columns, _Columns, FloatArray, FloatArray], tuple[FloatArray, FloatArray, FloatArray]]


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
    E = skew(projector_from_camera.t) @ projector_from_camera.R
    R, t = projector_from_camera.R, projector_from_camera.t

    def solve(
        x: _Columns, y: _Columns, camera_variance: FloatArray, projector_variance: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        x, y = _corrected_rays(E, x, y, camera_variance, projector_variance)
        return _intersection(R, t, x, y)

    return _in_blocks(
        solve, projector_from_camera, camera_rays, projector_rays, np.square(camera_sigma), np.square(projector_sigma)
    )


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

    def solve(x: _Columns, y: _Columns, *_: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        return _least_squares(R, t, x, y)

    return _in_blocks(solve, projector_from_camera, camera_rays, projector_rays, np.ones(()), np.ones(()))


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
    x, y = np.asarray(camera_rays, dtype=np.float64), np.asarray(projector_rays, dtype=np.float64)
    line_in_projector = x @ E[:, :2].T + E[:, 2]
    line_in_camera = y @ E[:2, :2] + E[2, :2]
    error = (y * line_in_projector[:, :2]).sum(axis=1) + line_in_projector[:, 2]
    variance = np.square(camera_sigma) * np.square(line_in_camera).sum(axis=1)
    variance = variance + np.square(projector_sigma) * np.square(line_in_projector[:, :2]).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(variance > 0, error / np.sqrt(variance), np.nan)


def _in_blocks(
    solve: _Solver,
    projector_from_camera: RigidTransform,
    camera_rays: ArrayLike,
    projector_rays: ArrayLike,
    camera_variance: FloatArray,
    projector_variance: FloatArray,
) -> FloatArray:
    """`solve` a cache-full at a time, NaN where the point is not in front of both devices."""
    x, y = np.asarray(camera_rays, dtype=np.float64), np.asarray(projector_rays, dtype=np.float64)
    camera_variance = np.broadcast_to(camera_variance, len(x)) if camera_variance.ndim else camera_variance
    projector_variance = np.broadcast_to(projector_variance, len(x)) if projector_variance.ndim else projector_variance
    r3, t3 = projector_from_camera.R[2], projector_from_camera.t[2]
    points = np.empty((len(x), 3))
    with np.errstate(all="ignore"):
        for start in range(0, len(x), BLOCK):
            rows = slice(start, start + BLOCK)
            X, Y, Z = solve(
                (x[rows, 0].copy(), x[rows, 1].copy()),
                (y[rows, 0].copy(), y[rows, 1].copy()),
                camera_variance[rows] if camera_variance.ndim else camera_variance,
                projector_variance[rows] if projector_variance.ndim else projector_variance,
            )
            projector_depth = r3[0] * X + r3[1] * Y + r3[2] * Z + t3
            in_front = (Z > 0) & (projector_depth > 0) & np.isfinite(X) & np.isfinite(Y) & np.isfinite(Z)
            for axis, column in enumerate((X, Y, Z)):
                points[rows, axis] = np.where(in_front, column, np.nan)
    return points


def _corrected_rays(
    E: FloatArray, x: _Columns, y: _Columns, camera_variance: FloatArray, projector_variance: FloatArray
) -> tuple[_Columns, _Columns]:
    """The nearest pair of rays that meet, by Lindstrom's iteration.

    Each step walks from the ORIGINAL rays along the epipolar lines' normals at the present estimate,
    x - k s_x^2 n_x and y - k s_y^2 n_y, to where they meet: a quadratic in k.
    """
    (x1, x2), (y1, y2) = x, y
    l1, l2 = _line_normal(E, x)
    m1, m2 = _line_normal(E.T, y)
    error = y1 * l1 + y2 * l2 + (E[2, 0] * x1 + E[2, 1] * x2 + E[2, 2])
    (a, b), (c, d) = E[:2, :2]
    for _ in range(2):
        n1, n2 = _line_normal(E.T, y)
        u1, u2 = camera_variance * n1, camera_variance * n2
        n1, n2 = _line_normal(E, x)
        v1, v2 = projector_variance * n1, projector_variance * n2
        quadratic = v1 * (a * u1 + b * u2) + v2 * (c * u1 + d * u2)
        half_linear = 0.5 * (v1 * l1 + v2 * l2 + u1 * m1 + u2 * m2)
        root = np.sqrt(half_linear * half_linear - quadratic * error)
        k = error / (half_linear + root)  # the smaller root; half_linear is positive up to second order
        x, y = (x1 - k * u1, x2 - k * u2), (y1 - k * v1, y2 - k * v2)
    return x, y


def _line_normal(E: FloatArray, ray: _Columns) -> _Columns:
    """The first two entries of E (ray, 1): normal to the epipolar line in the other device."""
    first, second = (row[0] * ray[0] + row[1] * ray[1] + row[2] for row in E[:2])
    return first, second


def _intersection(R: FloatArray, t: FloatArray, x: _Columns, y: _Columns) -> tuple[FloatArray, FloatArray, FloatArray]:
    """X = Z (x, 1) from Z (y x R x) = -(y x t), for rays that meet."""
    (x1, x2), (y1, y2) = x, y
    p1, p2, p3 = (row[0] * x1 + row[1] * x2 + row[2] for row in R)
    c1, c2, c3 = y2 * p3 - p2, p1 - y1 * p3, y1 * p2 - y2 * p1
    d1, d2, d3 = y2 * t[2] - t[1], t[0] - y1 * t[2], y1 * t[1] - y2 * t[0]
    parallax = c1 * c1 + c2 * c2 + c3 * c3
    Z = -(c1 * d1 + c2 * d2 + c3 * d3) / parallax
    lengths = (x1 * x1 + x2 * x2 + 1) * (y1 * y1 + y2 * y2 + 1)
    Z = np.where(parallax > SMALLEST_PARALLAX**2 * lengths, Z, np.nan)
    return x1 * Z, x2 * Z, Z


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
