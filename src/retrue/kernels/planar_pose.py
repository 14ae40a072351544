"""Both poses of a plane homography, from the eigenvectors of H H^T in closed form.

It answers where the problem is plainly well posed; elsewhere it says that it does not, and `geometry.planar_pose`
decides by singular values.
"""

from __future__ import annotations

import cython
from cython.cimports.libc.math import fabs, sqrt

WELL_POSED = cython.declare(cython.double, 1e-10)  # mu3 / mu1, and squared parallax, above which it answers
WELL_CONDITIONED = cython.declare(cython.double, 1e-4)  # mu2 / mu1: forming H H^T then costs four digits at most
NAN = cython.declare(cython.double, float("nan"))
ROWS = cython.declare(cython.Py_ssize_t, 10)  # R, t / d, normal of both poses, one below the other

Vector = cython.struct(x=cython.double, y=cython.double, z=cython.double)


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def _dot(a: Vector, b: Vector) -> cython.double:
    return a.x * b.x + a.y * b.y + a.z * b.z


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def _cross(a: Vector, b: Vector) -> Vector:
    return Vector(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def _combined(p: cython.double, a: Vector, q: cython.double, b: Vector) -> Vector:
    """p a + q b."""
    return Vector(p * a.x + q * b.x, p * a.y + q * b.y, p * a.z + q * b.z)


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def _scaled(p: cython.double, a: Vector) -> Vector:
    return Vector(p * a.x, p * a.y, p * a.z)


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def _times(r1: Vector, r2: Vector, r3: Vector, v: Vector) -> Vector:
    """The matrix of these rows, times v."""
    return Vector(_dot(r1, v), _dot(r2, v), _dot(r3, v))


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def _far_eigenvector(m1: Vector, m2: Vector, m3: Vector) -> Vector:
    """Unit eigenvector of symmetric M whose eigenvalue lies farthest from the other two; zero where all are equal.

    M = q I + p B with B of trace 0 and |B|^2 = 6 has eigenvalues q + p x, x^3 - 3 x = det B. The root beyond
    +-sqrt 3 is always simple: Newton from a parabola settles in three steps.
    """
    q = (m1.x + m2.y + m3.z) / 3
    d0, d1, d2 = m1.x - q, m2.y - q, m3.z - q
    e0, e1, e2 = m1.y, m1.z, m2.z
    p = sqrt((d0 * d0 + d1 * d1 + d2 * d2 + 2 * (e0 * e0 + e1 * e1 + e2 * e2)) / 6)
    if not p > 0:
        return Vector(0.0, 0.0, 0.0)
    determinant = d0 * (d1 * d2 - e2 * e2) - e0 * (e0 * d2 - e1 * e2) + e1 * (e0 * e2 - d1 * e1)
    cosine = determinant / (2 * p * p * p)
    size = min(fabs(cosine), 1.0)
    x = 1.7320508075688772 + size * (1.0 / 3.0 - 0.06538414090221052 * size)
    for _ in range(3):
        x -= (x * x * x - 3 * x - 2 * size) / (3 * x * x - 3)
    shift = p * x if cosine >= 0 else -p * x
    r1, r2, r3 = Vector(d0 - shift, e0, e1), Vector(e0, d1 - shift, e2), Vector(e1, e2, d2 - shift)
    v = _cross(r1, r2)
    best = _dot(v, v)
    other = _cross(r1, r3)
    square = _dot(other, other)
    if square > best:
        v, best = other, square
    other = _cross(r2, r3)
    square = _dot(other, other)
    if square > best:
        v, best = other, square
    return _scaled(1 / sqrt(best), v) if best > 0 else Vector(0.0, 0.0, 0.0)


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def _perpendicular(v: Vector) -> Vector:
    """A unit vector normal to the unit vector v."""
    if fabs(v.x) > fabs(v.y):
        return _scaled(1 / sqrt(v.x * v.x + v.z * v.z), Vector(-v.z, 0.0, v.x))
    return _scaled(1 / sqrt(v.y * v.y + v.z * v.z), Vector(0.0, v.z, -v.y))


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _solve(
    h1: Vector, h2: Vector, h3: Vector, ray: Vector, out: cython.double[:, ::1], row: cython.Py_ssize_t
) -> cython.bint:
    """Ten rows of `out` from `row` on: R, t / d, normal of each pose of H, of rows h1, h2, h3.

    NaN, and False, where H is near singular or near a rotation.
    """
    cython.declare(i=cython.Py_ssize_t, j=cython.Py_ssize_t)
    sign = 1.0 if _dot(h3, ray) >= 0 else -1.0
    c1, c2, c3 = Vector(h1.x, h2.x, h3.x), Vector(h1.y, h2.y, h3.y), Vector(h1.z, h2.z, h3.z)
    m12, m13, m23 = _dot(h1, h2), _dot(h1, h3), _dot(h2, h3)
    m1, m2, m3 = Vector(_dot(h1, h1), m12, m13), Vector(m12, _dot(h2, h2), m23), Vector(m13, m23, _dot(h3, h3))
    far = _far_eigenvector(m1, m2, m3)
    if not _dot(far, far) > 0:
        return _no_pose(out, row)
    # The other two, in the plane normal to it: one Jacobi rotation.
    f = _perpendicular(far)
    g = _cross(far, f)
    Mf, Mg, Mfar = _times(m1, m2, m3, f), _times(m1, m2, m3, g), _dot(far, _times(m1, m2, m3, far))
    ff, fg, gg = _dot(f, Mf), _dot(f, Mg), _dot(g, Mg)
    half = 0.5 * (ff - gg)
    length = sqrt(half * half + fg * fg)
    c, s = 1.0, 0.0
    if length > 0:
        if half >= 0:
            c, s = half + length, fg
        else:
            c, s = fg, length - half
        scale = 1 / sqrt(c * c + s * s)
        c, s = c * scale, s * scale
    large, small = _combined(c, f, s, g), _combined(-s, f, c, g)
    mu_large, mu_small = 0.5 * (ff + gg) + length, 0.5 * (ff + gg) - length
    if Mfar > 0.5 * (ff + gg):
        v1, v2, v3 = far, large, small
        mu1, mu2, mu3 = Mfar, mu_large, mu_small
    else:
        v1, v2, v3 = large, small, far
        mu1, mu2, mu3 = mu_large, mu_small, Mfar
    if not (mu3 > WELL_POSED * mu1 and mu2 > WELL_CONDITIONED * mu1):
        return _no_pose(out, row)
    a, b = max(mu1 / mu2 - 1, 0.0), max(1 - mu3 / mu2, 0.0)
    if not a + b > WELL_POSED:
        return _no_pose(out, row)
    p, q = sqrt(a / (a + b)), sqrt(b / (a + b))
    r2 = _times(c1, c2, c3, v2)  # Q = sign H / sqrt(mu2)
    inverse = sign / sqrt(_dot(r2, r2))
    r2 = _scaled(inverse, r2)
    first = _write_pose(_combined(p, v1, q, v3), v2, r2, c1, c2, c3, inverse, ray, out, row)
    second = _write_pose(_combined(p, v1, -q, v3), v2, r2, c1, c2, c3, inverse, ray, out, row + 5)
    if first < second:
        for i in range(row, row + 5):
            for j in range(3):
                out[i, j], out[i + 5, j] = out[i + 5, j], out[i, j]
    return True


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def _write_pose(
    u: Vector,
    e2: Vector,
    r2: Vector,
    c1: Vector,
    c2: Vector,
    c3: Vector,
    inverse: cython.double,
    ray: Vector,
    out: cython.double[:, ::1],
    row: cython.Py_ssize_t,
) -> cython.double:
    """The pose of t along u: R takes r2 to e2 and Q^T (u x e2) to u x e2. Returns how squarely its plane faces."""
    e3 = _cross(u, e2)
    r3 = _scaled(inverse, _times(c1, c2, c3, e3))
    r1 = _cross(r2, r3)
    m = _combined(inverse, _times(c1, c2, c3, u), -1.0, r1)  # |t| n
    length = sqrt(_dot(m, m))
    if _dot(m, ray) < 0:
        length = -length
    _write(_combined3(u.x, r1, e2.x, r2, e3.x, r3), out, row)
    _write(_combined3(u.y, r1, e2.y, r2, e3.y, r3), out, row + 1)
    _write(_combined3(u.z, r1, e2.z, r2, e3.z, r3), out, row + 2)
    _write(_scaled(length, u), out, row + 3)
    normal = _scaled(1 / length, m)
    _write(normal, out, row + 4)
    return _dot(normal, ray)


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def _combined3(p: cython.double, a: Vector, q: cython.double, b: Vector, r: cython.double, c: Vector) -> Vector:
    """p a + q b + r c."""
    return _combined(1.0, _combined(p, a, q, b), r, c)


@cython.cfunc
@cython.inline
@cython.nogil
@cython.exceptval(check=False)
def _write(v: Vector, out: cython.double[:, ::1], row: cython.Py_ssize_t) -> cython.void:
    out[row, 0], out[row, 1], out[row, 2] = v.x, v.y, v.z


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _no_pose(out: cython.double[:, ::1], row: cython.Py_ssize_t) -> cython.bint:
    cython.declare(i=cython.Py_ssize_t, j=cython.Py_ssize_t)
    for i in range(row, row + ROWS):
        for j in range(3):
            out[i, j] = NAN
    return False


def planar_poses(
    H: cython.const[cython.double][:, ::1],
    x: cython.double,
    y: cython.double,
    z: cython.double,
    out: cython.double[:, ::1],
) -> bool:
    """Fill `out` (10, 3) with R, t / d and normal of both poses; False where it should not be trusted.

    The plane is in front along the ray (x, y, z) of the camera.
    """
    if H.shape[0] != 3 or H.shape[1] != 3:
        return False
    h1, h2, h3 = Vector(H[0, 0], H[0, 1], H[0, 2]), Vector(H[1, 0], H[1, 1], H[1, 2]), Vector(H[2, 0], H[2, 1], H[2, 2])
    return _solve(h1, h2, h3, Vector(x, y, z), out, 0)


def planar_poses_of_stack(
    stack: cython.const[cython.double][:, :, ::1],
    x: cython.double,
    y: cython.double,
    z: cython.double,
    out: cython.double[:, ::1],
) -> bool:
    """The same for H (N, 3, 3) into `out` (10 N, 3); NaN in those rows, and False, where any is not trusted."""
    cython.declare(k=cython.Py_ssize_t)
    ray = Vector(x, y, z)
    trusted: cython.bint = True
    with cython.nogil:
        for k in range(stack.shape[0]):
            h1 = Vector(stack[k, 0, 0], stack[k, 0, 1], stack[k, 0, 2])
            h2 = Vector(stack[k, 1, 0], stack[k, 1, 1], stack[k, 1, 2])
            h3 = Vector(stack[k, 2, 0], stack[k, 2, 1], stack[k, 2, 2])
            if not _solve(h1, h2, h3, ray, out, ROWS * k):
                trusted = False
    return trusted
