"""How far matched rays miss each other, or a homography, and where they meet: Lindstrom's iteration, point by point."""

from __future__ import annotations

import cython
from cython.cimports.libc.math import sqrt

NAN = cython.declare(cython.double, float("nan"))
INFINITY = cython.declare(cython.double, float("inf"))
STEPS = cython.declare(cython.Py_ssize_t, 2)


def triangulate(
    R: cython.const[cython.double][:, ::1],
    t: cython.const[cython.double][::1],
    E: cython.const[cython.double][:, ::1],
    camera_rays: cython.const[cython.double][:, ::1],
    projector_rays: cython.const[cython.double][:, ::1],
    camera_variance: cython.const[cython.double][::1],
    projector_variance: cython.const[cython.double][::1],
    smallest_parallax: cython.double,
    points: cython.double[:, ::1],
) -> None:
    """`points` (N, 3) <- where the rays meet, corrected by as little as they must be; NaN where that is not in front.

    The equations are those of `geometry.triangulation`; variances (N,), or (1,) for all.
    """
    cython.declare(k=cython.Py_ssize_t)
    camera_stride: cython.Py_ssize_t = camera_variance.shape[0] > 1
    projector_stride: cython.Py_ssize_t = projector_variance.shape[0] > 1
    with cython.nogil:
        a, b, c, d = E[0, 0], E[0, 1], E[1, 0], E[1, 1]
        for k in range(camera_rays.shape[0]):
            x1, x2, y1, y2 = camera_rays[k, 0], camera_rays[k, 1], projector_rays[k, 0], projector_rays[k, 1]
            vx, vy = camera_variance[k * camera_stride], projector_variance[k * projector_stride]
            # Each step walks from the given rays along the normals at the present estimate: a quadratic.
            l1, l2 = a * x1 + b * x2 + E[0, 2], c * x1 + d * x2 + E[1, 2]
            m1, m2 = a * y1 + c * y2 + E[2, 0], b * y1 + d * y2 + E[2, 1]
            error = y1 * l1 + y2 * l2 + (E[2, 0] * x1 + E[2, 1] * x2 + E[2, 2])
            p1, p2, q1, q2 = x1, x2, y1, y2
            for _ in range(STEPS):
                u1, u2 = vx * (a * q1 + c * q2 + E[2, 0]), vx * (b * q1 + d * q2 + E[2, 1])
                v1, v2 = vy * (a * p1 + b * p2 + E[0, 2]), vy * (c * p1 + d * p2 + E[1, 2])
                quadratic = v1 * (a * u1 + b * u2) + v2 * (c * u1 + d * u2)
                half_linear = 0.5 * (v1 * l1 + v2 * l2 + u1 * m1 + u2 * m2)
                square = half_linear * half_linear - quadratic * error
                below = half_linear + sqrt(square) if square >= 0 else NAN
                step = error / below if below != 0 else NAN  # the smaller root
                p1, p2, q1, q2 = x1 - step * u1, x2 - step * u2, y1 - step * v1, y2 - step * v2
            # X = Z (x, 1) from Z (y x R x) = -(y x t).
            w1, w2 = R[0, 0] * p1 + R[0, 1] * p2 + R[0, 2], R[1, 0] * p1 + R[1, 1] * p2 + R[1, 2]
            w3 = R[2, 0] * p1 + R[2, 1] * p2 + R[2, 2]
            c1, c2, c3 = q2 * w3 - w2, w1 - q1 * w3, q1 * w2 - q2 * w1
            d1, d2, d3 = q2 * t[2] - t[1], t[0] - q1 * t[2], q1 * t[1] - q2 * t[0]
            parallax = c1 * c1 + c2 * c2 + c3 * c3
            lengths = (p1 * p1 + p2 * p2 + 1) * (q1 * q1 + q2 * q2 + 1)
            Z = NAN
            if parallax > smallest_parallax * smallest_parallax * lengths:
                Z = -(c1 * d1 + c2 * d2 + c3 * d3) / parallax
            if not (0 < Z < INFINITY and Z * w3 + t[2] > 0):
                Z = NAN
            points[k, 0], points[k, 1], points[k, 2] = p1 * Z, p2 * Z, Z


def sampson(
    E: cython.const[cython.double][:, ::1],
    camera_rays: cython.const[cython.double][:, ::1],
    projector_rays: cython.const[cython.double][:, ::1],
    camera_sigma: cython.const[cython.double][::1],
    projector_sigma: cython.const[cython.double][::1],
    distances: cython.double[::1],
) -> None:
    """`distances` (N,) <- signed ones of rays (N, 2) from meeting, in their sigmas (N,), or (1,) for all; NaN at an
    epipole. To first order: the equation is that of `geometry.triangulation`.
    """
    cython.declare(k=cython.Py_ssize_t)
    camera_stride: cython.Py_ssize_t = camera_sigma.shape[0] > 1
    projector_stride: cython.Py_ssize_t = projector_sigma.shape[0] > 1
    with cython.nogil:
        for k in range(camera_rays.shape[0]):
            x, y, u, v = camera_rays[k, 0], camera_rays[k, 1], projector_rays[k, 0], projector_rays[k, 1]
            by_x, by_y = camera_sigma[k * camera_stride], projector_sigma[k * projector_stride]
            l1, l2 = E[0, 0] * x + E[0, 1] * y + E[0, 2], E[1, 0] * x + E[1, 1] * y + E[1, 2]
            m1, m2 = E[0, 0] * u + E[1, 0] * v + E[2, 0], E[0, 1] * u + E[1, 1] * v + E[2, 1]
            error = u * l1 + v * l2 + (E[2, 0] * x + E[2, 1] * y + E[2, 2])
            variance = by_x * by_x * (m1 * m1 + m2 * m2) + by_y * by_y * (l1 * l1 + l2 * l2)
            distances[k] = error / sqrt(variance) if variance > 0 else NAN


def missed(
    homographies: cython.const[cython.double][:, :, ::1],
    plane_index: cython.const[cython.longlong][::1],
    camera_rays: cython.const[cython.double][:, ::1],
    projector_rays: cython.const[cython.double][:, ::1],
    camera_sigma: cython.const[cython.double][::1],
    projector_sigma: cython.const[cython.double][::1],
    found: cython.double[:, ::1],
) -> None:
    """`found` (N, 2) <- what the homography (P, 3, 3) of its plane misses each point by, in its own sigma; NaN on none.

    That is C^-1/2 (y - H x), with C = sy^2 I + sx^2 J J^T and J = d y / d x: the camera's noise as the homography has
    it there, longer one way than the other where the plane is seen aslant.
    """
    cython.declare(k=cython.Py_ssize_t, p=cython.Py_ssize_t)
    with cython.nogil:
        for k in range(camera_rays.shape[0]):
            p = plane_index[k]
            found[k, 0], found[k, 1] = NAN, NAN
            if not 0 <= p < homographies.shape[0]:
                continue
            x, y = camera_rays[k, 0], camera_rays[k, 1]
            a, b, c = homographies[p, 0, 0], homographies[p, 0, 1], homographies[p, 0, 2]
            d, e, f = homographies[p, 1, 0], homographies[p, 1, 1], homographies[p, 1, 2]
            g, h, i = homographies[p, 2, 0], homographies[p, 2, 1], homographies[p, 2, 2]
            depth = g * x + h * y + i
            if depth == 0:
                continue
            u, v = (a * x + b * y + c) / depth, (d * x + e * y + f) / depth
            j11, j12 = (a - u * g) / depth, (b - u * h) / depth
            j21, j22 = (d - v * g) / depth, (e - v * h) / depth
            vx, vy = camera_sigma[k] * camera_sigma[k], projector_sigma[k] * projector_sigma[k]
            c11, c12 = vy + vx * (j11 * j11 + j12 * j12), vx * (j11 * j21 + j12 * j22)
            c22 = vy + vx * (j21 * j21 + j22 * j22)
            # C^1/2 = (C + s I) / t with s^2 = det C and t^2 = tr C + 2 s, by Cayley and Hamilton.
            determinant = c11 * c22 - c12 * c12
            s = sqrt(determinant) if determinant > 0 else 0.0
            scale = s * sqrt(c11 + c22 + 2 * s)
            right, down = projector_rays[k, 0] - u, projector_rays[k, 1] - v
            found[k, 0] = ((c22 + s) * right - c12 * down) / scale
            found[k, 1] = ((c11 + s) * down - c12 * right) / scale
