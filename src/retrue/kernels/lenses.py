"""Rays through lenses, and through lenses that change: where they go, and how with each unknown."""

from __future__ import annotations

import cython
from cython.cimports.libc.math import fabs, sqrt

SETTLED = cython.declare(cython.double, 1e-14)
NEAR = cython.declare(cython.double, 1e-7)
FAR = cython.declare(cython.double, 1e3)  # a ray that the lens model cannot reach
STEPS = cython.declare(cython.Py_ssize_t, 20)
SMALLEST = cython.declare(cython.double, 1e-12)  # determinant, px^2
FIXED = cython.declare(cython.Py_ssize_t, 3)  # steps of a fixed point, before Newton's
LOT = cython.declare(cython.Py_ssize_t, 16)  # rays at a time: one after the other, each would wait for its divisions
REACHED = cython.declare(cython.double, 1e-9)
NAN = cython.declare(cython.double, float("nan"))

Distorted = cython.struct(
    x=cython.double,
    y=cython.double,
    a=cython.double,  # d x / d ray: a, b; d y / d ray: c, d
    b=cython.double,
    c=cython.double,
    d=cython.double,
    by_k1=cython.double,  # times the ray
)
Terms = cython.struct(radial=cython.double, x=cython.double, y=cython.double)


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


@cython.cfunc
@cython.nogil
@cython.inline
@cython.exceptval(check=False)
def _terms(lens: cython.const[cython.double][::1], x: cython.double, y: cython.double) -> Terms:
    """What the model multiplies a ray by, and what it adds."""
    r2 = x * x + y * y
    radial = 1 + r2 * (lens[0] + r2 * (lens[1] + r2 * lens[4]))
    radial = radial / (1 + r2 * (lens[5] + r2 * (lens[6] + r2 * lens[7])))
    by_x = 2 * lens[2] * x * y + lens[3] * (r2 + 2 * x * x)
    by_y = lens[2] * (r2 + 2 * y * y) + 2 * lens[3] * x * y
    return Terms(radial, by_x + r2 * (lens[8] + lens[9] * r2), by_y + r2 * (lens[10] + lens[11] * r2))


def distort(
    lens: cython.const[cython.double][::1],
    rays: cython.const[cython.double][:, ::1],
    distorted: cython.double[:, ::1],
) -> None:
    """`distorted` (N, 2) <- rays (N, 2) as a lens of twelve coefficients shows them."""
    cython.declare(k=cython.Py_ssize_t)
    with cython.nogil:
        for k in range(rays.shape[0]):
            x, y = rays[k, 0], rays[k, 1]
            terms = _terms(lens, x, y)
            distorted[k, 0], distorted[k, 1] = x * terms.radial + terms.x, y * terms.radial + terms.y


def project(
    K: cython.const[cython.double][:, ::1],
    lens: cython.const[cython.double][::1],
    distorts: cython.bint,
    points: cython.const[cython.double][:, ::1],
    pixels: cython.double[:, ::1],
) -> None:
    """`pixels` (N, 2) <- of points (N, 3) through K (3, 3), and a lens of twelve coefficients if it `distorts`.

    NaN of points that are not before the device.
    """
    cython.declare(k=cython.Py_ssize_t)
    with cython.nogil:
        for k in range(points.shape[0]):
            if not points[k, 2] > 0:
                pixels[k, 0], pixels[k, 1] = NAN, NAN
                continue
            x, y = points[k, 0] / points[k, 2], points[k, 1] / points[k, 2]
            if distorts:
                terms = _terms(lens, x, y)
                x, y = x * terms.radial + terms.x, y * terms.radial + terms.y
            pixels[k, 0], pixels[k, 1] = K[0, 0] * x + K[0, 1] * y + K[0, 2], K[1, 1] * y + K[1, 2]


def undistort(
    lens: cython.const[cython.double][::1],
    distorted: cython.const[cython.double][:, ::1],
    error: cython.double[:, ::1],
    rays: cython.double[:, ::1],
) -> None:
    """`rays` (N, 2) <- those that the lens distorts into (N, 2): steps of a fixed point, then Newton's for all of them
    until each has settled; NaN where none does, or only beyond the fold of the model. `error` (N, 2) is room.
    """
    cython.declare(k=cython.Py_ssize_t)
    with cython.nogil:
        for k in range(distorted.shape[0]):
            x, y = distorted[k, 0], distorted[k, 1]
            for _ in range(FIXED):
                terms = _terms(lens, x, y)
                x, y = (distorted[k, 0] - terms.x) / terms.radial, (distorted[k, 1] - terms.y) / terms.radial
            rays[k, 0], rays[k, 1] = x, y
        for _ in range(STEPS):
            settled: cython.bint = True
            for k in range(distorted.shape[0]):
                x, y = rays[k, 0], rays[k, 1]
                terms = _terms(lens, x, y)
                ex, ey = x * terms.radial + terms.x - distorted[k, 0], y * terms.radial + terms.y - distorted[k, 1]
                error[k, 0], error[k, 1] = ex, ey
                settled = settled and not (fabs(ex) > SETTLED or fabs(ey) > SETTLED)
            if settled:
                break
            for k in range(distorted.shape[0]):
                x, y, ex, ey = rays[k, 0], rays[k, 1], error[k, 0], error[k, 1]
                seen = _distort(lens, x, y)
                determinant = seen.a * seen.d - seen.b * seen.c
                rays[k, 0] = x - (seen.d * ex - seen.b * ey) / determinant
                rays[k, 1] = y - (seen.a * ey - seen.c * ex) / determinant
        for k in range(distorted.shape[0]):
            seen = _distort(lens, rays[k, 0], rays[k, 1])
            reached: cython.bint = fabs(error[k, 0]) < REACHED and fabs(error[k, 1]) < REACHED
            if not (reached and seen.a * seen.d - seen.b * seen.c > 0 and seen.a > 0 and seen.d > 0):
                rays[k, 0], rays[k, 1] = NAN, NAN


def in_pixels(
    K: cython.const[cython.double][:, ::1],
    lens: cython.const[cython.double][::1],
    rays: cython.const[cython.double][:, ::1],
    sigma: cython.double[::1],
) -> None:
    """`sigma` (N,) of rays (N, 2) <- in pixels of the device, root |d pixel / d ray| of each."""
    cython.declare(k=cython.Py_ssize_t)
    with cython.nogil:
        scale = K[0, 0] * K[1, 1]
        for k in range(rays.shape[0]):
            seen = _distort(lens, rays[k, 0], rays[k, 1])
            sigma[k] *= sqrt(max(scale * (seen.a * seen.d - seen.b * seen.c), SMALLEST))


def move_rays(
    K: cython.const[cython.double][:, ::1],
    lens: cython.const[cython.double][::1],
    pixels: cython.const[cython.double][:, ::1],
    rays: cython.double[:, ::1],
    sigma: cython.double[::1],
) -> None:
    """`rays` (N, 2), those of the pixels through the device's own lens, <- through another: Newton's method.

    `lens` (12,) distorts, `K` is (3, 3). `sigma` (N,) <- of each ray, from that in pixels: it shrinks where the lens
    magnifies.
    """
    cython.declare(k=cython.Py_ssize_t, m=cython.Py_ssize_t, first=cython.Py_ssize_t, taken=cython.Py_ssize_t)
    x, y = cython.declare(cython.double[16]), cython.declare(cython.double[16])
    at_x, at_y = cython.declare(cython.double[16]), cython.declare(cython.double[16])
    error, determinant = cython.declare(cython.double[16]), cython.declare(cython.double[16])
    a, d = cython.declare(cython.double[16]), cython.declare(cython.double[16])
    going = cython.declare(cython.double[16])  # 1 or 0
    with cython.nogil:
        fx, skew, fy = K[0, 0], K[0, 1], K[1, 1]
        scale = fx * fy
        first = 0
        while first < pixels.shape[0]:
            taken = min(LOT, pixels.shape[0] - first)
            for m in range(LOT):  # all are computed
                k = first + min(m, taken - 1)
                x[m], y[m], going[m] = rays[k, 0], rays[k, 1], 1.0
                at_y[m] = (pixels[k, 1] - K[1, 2]) / fy
                at_x[m] = (pixels[k, 0] - K[0, 2] - skew * at_y[m]) / fx
            for _ in range(STEPS):
                for m in range(LOT):
                    u, v, moves, last = x[m], y[m], going[m], error[m]
                    last_a, last_d, last_determinant = a[m], d[m], determinant[m]
                    seen = _distort(lens, u, v)
                    ex, ey, now = seen.x - at_x[m], seen.y - at_y[m], seen.a * seen.d - seen.b * seen.c
                    nu, nv = u - (seen.d * ex - seen.b * ey) / now, v - (seen.a * ey - seen.c * ex) / now
                    ex, ey = fabs(ex), fabs(ey)
                    far = ex if ex > ey else ey
                    last, last_a = far if moves > 0 else last, seen.a if moves > 0 else last_a
                    last_d, last_determinant = seen.d if moves > 0 else last_d, now if moves > 0 else last_determinant
                    error[m], a[m], d[m], determinant[m] = last, last_a, last_d, last_determinant
                    moves = moves if far > SETTLED else 0.0
                    moves = moves if now != 0 else 0.0
                    x[m], y[m] = nu if moves > 0 else u, nv if moves > 0 else v
                    going[m] = 0.0 if far < NEAR else moves  # the next error is its square
                left = 0.0
                for m in range(LOT):
                    left += going[m]
                if not left > 0:
                    break
            for m in range(taken):
                k = first + m
                reached: cython.bint = error[m] < NEAR and determinant[m] > 0 and a[m] > 0 and d[m] > 0
                rays[k, 0], rays[k, 1] = x[m] if reached else FAR, y[m] if reached else FAR
                sigma[k] /= sqrt(max(scale * determinant[m], SMALLEST))
            first += taken


def turns_of_rays(
    K: cython.const[cython.double][:, ::1],
    lens: cython.const[cython.double][::1],
    rays: cython.const[cython.double][:, ::1],
    turns: cython.double[:, :, ::1],
) -> None:
    """`turns` (N, 2, 4) <- how rays (N, 2) move with the lens, their pixel held.

    That is -(d pixel / d ray)^-1 d pixel / d unknown of the log of the focal length, the principal point and k1.
    """
    cython.declare(k=cython.Py_ssize_t)
    with cython.nogil:
        fx, skew, fy = K[0, 0], K[0, 1], K[1, 1]
        for k in range(rays.shape[0]):
            x, y = rays[k, 0], rays[k, 1]
            seen = _distort(lens, x, y)
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
