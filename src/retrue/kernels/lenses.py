"""Rays through lenses that change, and bowed planes taken off them: where they go, and how with each unknown."""

from __future__ import annotations

import cython
from cython.cimports.libc.math import fabs

SETTLED = cython.declare(cython.double, 1e-14)
NEAR = cython.declare(cython.double, 1e-7)
FAR = cython.declare(cython.double, 1e3)  # a ray that the lens model cannot reach
STEPS = cython.declare(cython.Py_ssize_t, 20)

Distorted = cython.struct(
    x=cython.double,
    y=cython.double,
    a=cython.double,  # d x / d ray: a, b; d y / d ray: c, d
    b=cython.double,
    c=cython.double,
    d=cython.double,
    by_k1=cython.double,  # times the ray
)


@cython.cfunc
@cython.nogil
@cython.inline
@cython.exceptval(check=False)
def _distort(lens: cython.const[cython.double][::1], x: cython.double, y: cython.double) -> Distorted:
    """OpenCV's model with all twelve coefficients, and its derivatives."""
    r2 = x * x + y * y
    above = 1 + r2 * (lens[0] + r2 * (lens[1] + r2 * lens[4]))
    below = 1 + r2 * (lens[5] + r2 * (lens[6] + r2 * lens[7]))
    radial = above / below
    slope = lens[0] + r2 * (2 * lens[1] + r2 * 3 * lens[4])
    slope = (slope - radial * (lens[5] + r2 * (2 * lens[6] + r2 * 3 * lens[7]))) / below
    p1, p2 = lens[2], lens[3]
    both = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
    thin_x, thin_y = 2 * (lens[8] + 2 * lens[9] * r2), 2 * (lens[10] + 2 * lens[11] * r2)
    return Distorted(
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + r2 * (lens[8] + lens[9] * r2),
        y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + r2 * (lens[10] + lens[11] * r2),
        radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x + thin_x * x,
        both + thin_x * y,
        both + thin_y * x,
        radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x + thin_y * y,
        r2 / below,
    )


def turn_rays(
    K: cython.const[cython.double][:, ::1],
    lens: cython.const[cython.double][::1],
    pixels: cython.const[cython.double][:, ::1],
    moves: cython.bint,
    rays: cython.double[:, ::1],
    turns: cython.double[:, :, ::1],
) -> None:
    """`rays` (N, 2) <- those of the pixels, from where they are near; `turns` (N, 2, A >= 4) <- how they move.

    Newton's method, where they move at all. The four unknowns are the log of the focal length, the principal point and
    k1, the pixel held: -(d pixel / d ray)^-1 d pixel / d unknown. `lens` (12,) distorts, `K` is (3, 3).
    """
    cython.declare(k=cython.Py_ssize_t)
    with cython.nogil:
        fx, skew, fy = K[0, 0], K[0, 1], K[1, 1]
        for k in range(pixels.shape[0]):
            x, y = rays[k, 0], rays[k, 1]
            seen = _distort(lens, x, y)
            if moves:
                at_y = (pixels[k, 1] - K[1, 2]) / fy
                at_x = (pixels[k, 0] - K[0, 2] - skew * at_y) / fx
                error = 0.0
                for _ in range(STEPS):
                    ex, ey = seen.x - at_x, seen.y - at_y
                    error = max(fabs(ex), fabs(ey))
                    determinant = seen.a * seen.d - seen.b * seen.c
                    if not error > SETTLED or determinant == 0:
                        break
                    x, y = x - (seen.d * ex - seen.b * ey) / determinant, y - (seen.a * ey - seen.c * ex) / determinant
                    if error < NEAR:  # the next error is its square
                        break
                    seen = _distort(lens, x, y)
                determinant = seen.a * seen.d - seen.b * seen.c
                if not (error < NEAR and determinant > 0 and seen.a > 0 and seen.d > 0):
                    x, y = FAR, FAR
                    seen = _distort(lens, x, y)
                rays[k, 0], rays[k, 1] = x, y
            # d pixel / d ray = K (a b; c d), its inverse by Cramer's rule.
            a, b = fx * seen.a + skew * seen.c, fx * seen.b + skew * seen.d
            c, d = fy * seen.c, fy * seen.d
            determinant = a * d - b * c
            scale = -1 / determinant if determinant != 0 else 0.0
            by_x, by_y = fx * seen.x + skew * seen.y, fy * seen.y
            turns[k, 0, 0], turns[k, 1, 0] = (d * by_x - b * by_y) * scale, (a * by_y - c * by_x) * scale
            turns[k, 0, 1], turns[k, 1, 1] = d * scale, -c * scale
            turns[k, 0, 2], turns[k, 1, 2] = -b * scale, a * scale
            by_x, by_y = (fx * x + skew * y) * seen.by_k1, fy * y * seen.by_k1
            turns[k, 0, 3], turns[k, 1, 3] = (d * by_x - b * by_y) * scale, (a * by_y - c * by_x) * scale


def take_off_bows(
    R: cython.const[cython.double][:, ::1],
    t: cython.const[cython.double][::1],
    planes: cython.const[cython.double][:, ::1],
    bows: cython.const[cython.double][:, ::1],
    flatness: cython.double,
    shapes: cython.const[cython.double][:, ::1],
    plane_index: cython.const[cython.longlong][::1],
    camera_rays: cython.const[cython.double][:, ::1],
    rays: cython.double[:, ::1],
    turns: cython.double[:, :, ::1],
) -> None:
    """Take the bows (P, B) of each point's plane off the projector's `rays`; last of `turns` <- how they move them.

    A bow moves what is seen of a plane along the epipolar line: by `flatness`, of the disparity, times `shapes` (N, B).
    """
    cython.declare(k=cython.Py_ssize_t, i=cython.Py_ssize_t, plane=cython.Py_ssize_t)
    count: cython.Py_ssize_t = bows.shape[1]
    first: cython.Py_ssize_t = turns.shape[2] - count
    with cython.nogil:
        for k in range(plane_index.shape[0]):
            plane = plane_index[k]
            along_x, along_y = 0.0, 0.0
            if plane >= 0:
                x, y = camera_rays[k, 0], camera_rays[k, 1]
                disparity = planes[plane, 0] * x + planes[plane, 1] * y + planes[plane, 2]
                depth = R[2, 0] * x + R[2, 1] * y + R[2, 2] + disparity * t[2]
                if depth != 0:
                    hx = (R[0, 0] * x + R[0, 1] * y + R[0, 2] + disparity * t[0]) / depth
                    hy = (R[1, 0] * x + R[1, 1] * y + R[1, 2] + disparity * t[1]) / depth
                    along_x = (t[0] - hx * t[2]) / depth * disparity * flatness
                    along_y = (t[1] - hy * t[2]) / depth * disparity * flatness
            for i in range(count):
                turns[k, 0, first + i], turns[k, 1, first + i] = -along_x * shapes[k, i], -along_y * shapes[k, i]
                if plane >= 0:
                    rays[k, 0] += turns[k, 0, first + i] * bows[plane, i]
                    rays[k, 1] += turns[k, 1, first + i] * bows[plane, i]
