"""`planar_pose_candidates`, compiled by Numba: the same poses, from the eigenvectors of H H^T in closed form.

Only `compiled` imports this module. It answers where the problem is plainly well posed; elsewhere it says that it does
not, and the NumPy form decides.
"""

from __future__ import annotations

import numpy as np

from retrue.geometry.arrays import FloatArray
from retrue.geometry.compiling import MATRIX, OUT_MATRIX, OUT_STACK, STACK, VECTOR, compiled, inlined, numba

WELL_POSED = 1e-10  # mu3 / mu1, and squared parallax, above which it answers
WELL_CONDITIONED = 1e-4  # mu2 / mu1: forming H H^T then costs four digits at most

_Triple = tuple[float, float, float]


@inlined
def _dot(a: _Triple, b: _Triple) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def _cross(a: _Triple, b: _Triple) -> _Triple:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def _combined(p: float, a: _Triple, q: float, b: _Triple) -> _Triple:
    """p a + q b."""
    return p * a[0] + q * b[0], p * a[1] + q * b[1], p * a[2] + q * b[2]


@inlined
def _times(rows: tuple[_Triple, _Triple, _Triple], v: _Triple) -> _Triple:
    return _dot(rows[0], v), _dot(rows[1], v), _dot(rows[2], v)


@inlined
def _far_eigenvector(M: tuple[_Triple, _Triple, _Triple]) -> _Triple:
    """Unit eigenvector of symmetric M whose eigenvalue lies farthest from the other two; zero where all are equal.

    M = q I + p B with B of trace 0 and |B|^2 = 6 has eigenvalues q + p x, x^3 - 3 x = det B. The root beyond
    +-sqrt 3 is always simple: Newton from a parabola settles in three steps.
    """
    q = (M[0][0] + M[1][1] + M[2][2]) / 3
    d0, d1, d2 = M[0][0] - q, M[1][1] - q, M[2][2] - q
    e0, e1, e2 = M[0][1], M[0][2], M[1][2]
    p = np.sqrt((d0 * d0 + d1 * d1 + d2 * d2 + 2 * (e0 * e0 + e1 * e1 + e2 * e2)) / 6)
    determinant = d0 * (d1 * d2 - e2 * e2) - e0 * (e0 * d2 - e1 * e2) + e1 * (e0 * e2 - d1 * e1)
    cosine = determinant / (2 * p * p * p)
    size = min(abs(cosine), 1.0)
    x = 1.7320508075688772 + size * (1 / 3 - 0.06538414090221052 * size)
    for _ in range(3):
        x -= (x * x * x - 3 * x - 2 * size) / (3 * x * x - 3)
    shift = p * x if cosine >= 0 else -p * x
    r0, r1, r2 = (d0 - shift, e0, e1), (e0, d1 - shift, e2), (e1, e2, d2 - shift)
    v, best = _cross(r0, r1), 0.0
    best = _dot(v, v)
    other = _cross(r0, r2)
    square = _dot(other, other)
    if square > best:
        v, best = other, square
    other = _cross(r1, r2)
    square = _dot(other, other)
    if square > best:
        v, best = other, square
    scale = 1 / np.sqrt(best)
    return v[0] * scale, v[1] * scale, v[2] * scale


@inlined
def _perpendicular(v: _Triple) -> _Triple:
    """A unit vector normal to the unit vector v."""
    if abs(v[0]) > abs(v[1]):
        scale = 1 / np.sqrt(v[0] * v[0] + v[2] * v[2])
        return -v[2] * scale, 0.0, v[0] * scale
    scale = 1 / np.sqrt(v[1] * v[1] + v[2] * v[2])
    return 0.0, v[2] * scale, -v[1] * scale


@inlined
def _solve(H: FloatArray, x: FloatArray, out: FloatArray) -> bool:
    """Rows of `out` (10, 3): R, t / d, normal of each pose. NaN, False where H is near singular or a rotation."""
    ray = (x[0], x[1], x[2])
    rows = ((H[0, 0], H[0, 1], H[0, 2]), (H[1, 0], H[1, 1], H[1, 2]), (H[2, 0], H[2, 1], H[2, 2]))
    sign = 1.0 if _dot(rows[2], ray) >= 0 else -1.0
    columns = ((H[0, 0], H[1, 0], H[2, 0]), (H[0, 1], H[1, 1], H[2, 1]), (H[0, 2], H[1, 2], H[2, 2]))
    M01, M02, M12 = _dot(rows[0], rows[1]), _dot(rows[0], rows[2]), _dot(rows[1], rows[2])
    M = ((_dot(rows[0], rows[0]), M01, M02), (M01, _dot(rows[1], rows[1]), M12), (M02, M12, _dot(rows[2], rows[2])))
    far = _far_eigenvector(M)
    # The other two, in the plane normal to it: one Jacobi rotation.
    f = _perpendicular(far)
    g = _cross(far, f)
    Mf, Mg, Mfar = _times(M, f), _times(M, g), _dot(far, _times(M, far))
    ff, fg, gg = _dot(f, Mf), _dot(f, Mg), _dot(g, Mg)
    half = 0.5 * (ff - gg)
    length = np.sqrt(half * half + fg * fg)
    c, s = (half + length, fg) if half >= 0 else (fg, length - half)
    scale = 1 / np.sqrt(c * c + s * s)
    large, small = _combined(c * scale, f, s * scale, g), _combined(-s * scale, f, c * scale, g)
    mu_large, mu_small = 0.5 * (ff + gg) + length, 0.5 * (ff + gg) - length
    if Mfar > 0.5 * (ff + gg):
        v1, v2, v3 = far, large, small
        mu1, mu2, mu3 = Mfar, mu_large, mu_small
    else:
        v1, v2, v3 = large, small, far
        mu1, mu2, mu3 = mu_large, mu_small, Mfar
    a, b = max(mu1 / mu2 - 1, 0.0), max(1 - mu3 / mu2, 0.0)
    if not (mu3 > WELL_POSED * mu1 and mu2 > WELL_CONDITIONED * mu1 and a + b > WELL_POSED):
        out[:] = np.nan
        return False
    p, q = np.sqrt(a / (a + b)), np.sqrt(b / (a + b))
    r2 = _times(columns, v2)  # Q = sign H / sqrt(mu2)
    inverse = sign / np.sqrt(_dot(r2, r2))
    r2 = (r2[0] * inverse, r2[1] * inverse, r2[2] * inverse)
    for which in range(2):
        u = _combined(p, v1, q if which == 0 else -q, v3)
        e3 = _cross(u, v2)
        r3 = _times(columns, e3)
        r3 = (r3[0] * inverse, r3[1] * inverse, r3[2] * inverse)
        r1 = _cross(r2, r3)
        m = _combined(inverse, _times(columns, u), -1.0, r1)
        length = np.sqrt(_dot(m, m))
        if _dot(m, ray) < 0:
            length = -length
        row = 5 * which
        for j in range(3):
            for i in range(3):
                out[row + i, j] = u[i] * r1[j] + v2[i] * r2[j] + e3[i] * r3[j]
            out[row + 3, j] = length * u[j]
            out[row + 4, j] = m[j] / length
    if _dot((out[4, 0], out[4, 1], out[4, 2]), ray) < _dot((out[9, 0], out[9, 1], out[9, 2]), ray):
        for i in range(5):
            for j in range(3):
                out[i, j], out[i + 5, j] = out[i + 5, j], out[i, j]
    return True


@compiled(numba.boolean(MATRIX, VECTOR, OUT_MATRIX))
def planar_poses(H: FloatArray, x: FloatArray, out: FloatArray) -> bool:
    """Fill `out` (10, 3) with R, t / d and normal of both poses; False where it should not be trusted."""
    return H.shape == (3, 3) and x.shape == (3,) and _solve(H, x, out)


@compiled(numba.boolean(STACK, VECTOR, OUT_STACK))
def planar_poses_of_stack(stack: FloatArray, x: FloatArray, out: FloatArray) -> bool:
    """The same for H (N, 3, 3) into `out` (N, 10, 3); NaN in those rows, and False, where any is not trusted."""
    good = True
    for k in range(len(stack)):
        good = _solve(stack[k], x, out[k]) and good
    return good
