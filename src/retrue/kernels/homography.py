"""The maximum-likelihood homography, block by block of points; `geometry.homography` says what it minimises.

A pair of points adds (D^T C^-1 D) kron (x x^T) to the normal equations, D (2, 3) the derivative of its transfer error
by H x, C its covariance: six numbers times six. Where it is not plain that the points determine H, the kernel says so,
and singular values decide.
"""

from __future__ import annotations

import cython
import numpy as np
from cython.cimports.libc.math import fabs, sqrt

BLOCK = cython.declare(cython.Py_ssize_t, 128)  # points at a time: their terms stay in the first cache
SMALLEST_PIVOT = cython.declare(cython.double, 1e-10)  # of the largest; where a second one is below it, H is not plain
INVERSE_ITERATIONS = cython.declare(cython.int, 4)
TINY = cython.declare(cython.double, 1e-14)  # of the trace: exact points leave a pivot of zero


def fit_homography(
    source: cython.const[cython.double][:, ::1],
    target: cython.const[cython.double][:, ::1],
    weights: cython.const[cython.double][::1],
    start: cython.const[cython.double][::1],
    source_sigma: cython.double,
    target_sigma: cython.double,
    iterations: cython.int,
    settled: cython.double,
    out: cython.double[:, ::1],
) -> bool:
    """Fill `out` (3, 3); False where it should not be trusted. No weights stand for equal ones.

    A `start` of nine numbers maps the normalised points, and is refined even where the points hardly determine it; with
    an empty one, the linear fit is the start.
    """
    cython.declare(i=cython.Py_ssize_t)
    work: cython.double[:, ::1] = np.empty((7, source.shape[0]))
    block: cython.double[:, ::1] = np.empty((15, BLOCK))  # the terms of a block of points
    h = cython.declare(cython.double[9])
    for i in range(BLOCK):
        block[11, i] = 1.0  # the last of x0^2, x0 x1, x0, x1^2, x1, 1
    frames = cython.declare(cython.double[6])
    if not _prepare(source, target, weights, work, frames):
        return False
    small_pivots: cython.int = 0
    if start.shape[0] == 9:
        small_pivots = 9
        for i in range(9):
            h[i] = start[i]
    elif not _fit_linear(work, block, h):
        return False
    vs, vt = source_sigma * frames[0], target_sigma * frames[3]
    refined = _refine(work, block, h, vs * vs, vt * vt, iterations, settled, small_pivots)
    return refined and _write(h, frames, source, out)


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _prepare(
    source: cython.const[cython.double][:, ::1],
    target: cython.const[cython.double][:, ::1],
    weights: cython.const[cython.double][::1],
    work: cython.double[:, ::1],
    frames: cython.p_double,
) -> cython.bint:
    """Rows of `work`: x, y of the normalised source, target, corrected source; weights. False where they are no use."""
    cython.declare(k=cython.Py_ssize_t)
    count = source.shape[0]
    if count < 4 or target.shape[0] != count or source.shape[1] != 2 or target.shape[1] != 2:
        return False
    if not (weights.shape[0] == 0 or weights.shape[0] == count):
        return False
    for k in range(count):
        work[6, k] = weights[k] if weights.shape[0] != 0 else 1.0
        if not work[6, k] >= 0:
            return False
    if not (_normalise(source, work, 0, frames) and _normalise(target, work, 2, frames)):
        return False
    for k in range(count):
        work[4, k], work[5, k] = work[0, k], work[1, k]
    return True


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _normalise(
    points: cython.const[cython.double][:, ::1],
    work: cython.double[:, ::1],
    row: cython.Py_ssize_t,
    frames: cython.p_double,
) -> cython.bint:
    """Two rows of `work` with centroid 0, mean distance sqrt 2; `frames`: scale, centroid. False where all are one."""
    cython.declare(k=cython.Py_ssize_t)
    count = points.shape[0]
    cx, cy, spread = 0.0, 0.0, 0.0
    for k in range(count):
        cx += points[k, 0]
        cy += points[k, 1]
    cx, cy = cx / count, cy / count
    for k in range(count):
        x, y = points[k, 0] - cx, points[k, 1] - cy
        work[row, k], work[row + 1, k] = x, y
        spread += sqrt(x * x + y * y)
    spread /= count
    if not spread > 1e-12 * max(1.0, fabs(cx), fabs(cy)):
        return False
    scale = sqrt(2.0) / spread
    for k in range(count):
        work[row, k] *= scale
        work[row + 1, k] *= scale
    at = 0 if row == 0 else 3
    frames[at], frames[at + 1], frames[at + 2] = scale, cx, cy
    return True


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _fit_linear(work: cython.double[:, ::1], block: cython.double[:, ::1], h: cython.p_double) -> cython.bint:
    """h <- the H of eq. (13), by inverse iteration; False where it is not plainly determined."""
    cython.declare(i=cython.Py_ssize_t, j=cython.Py_ssize_t, k=cython.Py_ssize_t)
    N = cython.declare(cython.double[81])
    M = cython.declare(cython.double[36])
    for i in range(36):
        M[i] = 0.0
    count = work.shape[1]
    for j in range((count + BLOCK - 1) // BLOCK):
        start = BLOCK * j
        size = min(BLOCK, count - start)
        for i in range(size):
            k = start + i
            x0, x1, u, v, weight = work[0, k], work[1, k], work[2, k], work[3, k], work[6, k]
            block[0, i], block[1, i], block[2, i] = weight, 0.0, -u * weight
            block[3, i], block[4, i], block[5, i] = weight, -v * weight, (u * u + v * v) * weight
            block[6, i], block[7, i], block[8, i], block[9, i], block[10, i] = x0 * x0, x0 * x1, x0, x1 * x1, x1
        _accumulate(block, size, M)
    _unfold(M, N)
    tiny = TINY * _trace(N)
    for i in range(9):
        N[10 * i] += tiny
        h[i] = 1.0 if i % 4 == 0 else 0.0
    if not 0 <= _factorise(N) <= 1:
        return False
    for _ in range(INVERSE_ITERATIONS):
        _substitute(N, h)
        _to_unit_length(h)
    return True


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _refine(
    work: cython.double[:, ::1],
    block: cython.double[:, ::1],
    h: cython.p_double,
    source_variance: cython.double,
    target_variance: cython.double,
    iterations: cython.int,
    settled: cython.double,
    small_pivots: cython.int,
) -> cython.bint:
    """Gauss-Newton steps of h; False where the normal equations have more small pivots than that."""
    cython.declare(i=cython.Py_ssize_t, j=cython.Py_ssize_t)
    N = cython.declare(cython.double[81])
    g = cython.declare(cython.double[9])
    vs = source_variance / (source_variance + target_variance)
    vt = target_variance / (source_variance + target_variance)
    for _ in range(iterations):
        _gauss_newton(work, block, h, N, g, vs, vt)
        trace = _trace(N)
        for i in range(9):
            for j in range(9):
                N[9 * i + j] += trace * h[i] * h[j]  # the scale of H is free: hold it
        if not 0 <= _factorise(N) <= small_pivots:
            return False
        _substitute(N, g)
        largest = 0.0
        for i in range(9):
            h[i] += g[i]
            largest = max(largest, fabs(g[i]))
        if not _to_unit_length(h):
            return False
        if largest < settled:
            break
    return True


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _gauss_newton(
    work: cython.double[:, ::1],
    block: cython.double[:, ::1],
    h: cython.p_double,
    N: cython.p_double,
    g: cython.p_double,
    vs: cython.double,
    vt: cython.double,
) -> cython.void:
    """Normal equations N, g at h; moves the corrected source points on."""
    cython.declare(i=cython.Py_ssize_t, j=cython.Py_ssize_t, k=cython.Py_ssize_t, row=cython.Py_ssize_t)
    M = cython.declare(cython.double[36])
    for i in range(36):
        M[i] = 0.0
    for i in range(9):
        g[i] = 0.0
    h00, h01, h02, h10, h11, h12 = h[0], h[1], h[2], h[3], h[4], h[5]
    h20, h21, h22 = h[6], h[7], h[8]
    count = work.shape[1]
    for j in range((count + BLOCK - 1) // BLOCK):
        start = BLOCK * j
        size = min(BLOCK, count - start)
        for i in range(size):
            k = start + i
            x0, x1 = work[4, k], work[5, k]
            inverse = 1 / (h20 * x0 + h21 * x1 + h22)
            u, v = (h00 * x0 + h01 * x1 + h02) * inverse, (h10 * x0 + h11 * x1 + h12) * inverse
            p, q = (h00 - u * h20) * inverse, (h01 - u * h21) * inverse
            r, t = (h10 - v * h20) * inverse, (h11 - v * h21) * inverse
            ox, oy = work[0, k] - x0, work[1, k] - x1
            dx, dy = work[2, k] - u - p * ox - q * oy, work[3, k] - v - r * ox - t * oy
            a, b, c = vt + vs * (p * p + q * q), vs * (p * r + q * t), vt + vs * (r * r + t * t)
            determinant = 1 / (a * c - b * b)
            ex, ey = (c * dx - b * dy) * determinant, (a * dy - b * dx) * determinant
            x0, x1 = work[0, k] + vs * (p * ex + r * ey), work[1, k] + vs * (q * ex + t * ey)
            work[4, k], work[5, k] = x0, x1
            weight = work[6, k] * inverse
            block[12, i], block[13, i], block[14, i] = ex * weight, ey * weight, -(u * ex + v * ey) * weight
            weight *= inverse * determinant
            first, second = (b * v - c * u) * weight, (b * u - a * v) * weight
            block[0, i], block[1, i], block[3, i] = c * weight, -b * weight, a * weight
            block[2, i], block[4, i], block[5, i] = first, second, -(first * u + second * v)
            block[6, i], block[7, i], block[8, i], block[9, i], block[10, i] = x0 * x0, x0 * x1, x0, x1 * x1, x1
        _accumulate(block, size, M)
        for row in range(3):
            g0, g1, g2 = 0.0, 0.0, 0.0
            for i in range(size):
                g0 += block[12 + row, i] * block[8, i]
                g1 += block[12 + row, i] * block[10, i]
                g2 += block[12 + row, i]
            g[3 * row] += g0
            g[3 * row + 1] += g1
            g[3 * row + 2] += g2
    _unfold(M, N)


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _accumulate(block: cython.double[:, ::1], size: cython.Py_ssize_t, M: cython.p_double) -> cython.void:
    """M (6, 6) += A X^T over the first `size` columns: A the first six rows, X the next six."""
    cython.declare(b=cython.Py_ssize_t, i=cython.Py_ssize_t)
    for b in range(6):
        m0, m1, m2, m3, m4, m5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(size):
            x = block[6 + b, i]
            m0 += block[0, i] * x
            m1 += block[1, i] * x
            m2 += block[2, i] * x
            m3 += block[3, i] * x
            m4 += block[4, i] * x
            m5 += block[5, i] * x
        M[b] += m0
        M[6 + b] += m1
        M[12 + b] += m2
        M[18 + b] += m3
        M[24 + b] += m4
        M[30 + b] += m5


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _unfold(M: cython.p_double, N: cython.p_double) -> cython.void:
    """The nine by nine of the six by six different products."""
    cython.declare(a=cython.Py_ssize_t, b=cython.Py_ssize_t, i=cython.Py_ssize_t, j=cython.Py_ssize_t)
    for a in range(3):
        for b in range(3):
            row = _index(a, b)
            for i in range(3):
                for j in range(3):
                    N[9 * (3 * a + i) + 3 * b + j] = M[6 * row + _index(i, j)]


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _index(i: cython.Py_ssize_t, j: cython.Py_ssize_t) -> cython.Py_ssize_t:
    """Place of (i, j) in a symmetric 3 by 3 of which the upper triangle is kept, row by row."""
    low, high = min(i, j), max(i, j)
    return 2 * low + high - (1 if low == 2 else 0)


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _factorise(N: cython.p_double) -> cython.int:
    """Lower triangle of the 9 by 9 <- its Cholesky factor, one over it on the diagonal.

    Returns how many pivots are small; -1 where the matrix is not definite.
    """
    cython.declare(i=cython.Py_ssize_t, j=cython.Py_ssize_t, k=cython.Py_ssize_t)
    largest, small = 0.0, 0
    for j in range(9):
        largest = max(largest, N[10 * j])
    for j in range(9):
        pivot = N[10 * j]
        for k in range(j):
            pivot -= N[9 * j + k] * N[9 * j + k]
        if not pivot > 0:
            return -1
        if pivot < SMALLEST_PIVOT * largest:
            small += 1
        inverse = 1 / sqrt(pivot)
        N[10 * j] = inverse
        for i in range(j + 1, 9):
            total = N[9 * i + j]
            for k in range(j):
                total -= N[9 * i + k] * N[9 * j + k]
            N[9 * i + j] = total * inverse
    return small


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _substitute(N: cython.p_double, g: cython.p_double) -> cython.void:
    """g <- (L L^T)^-1 g, L the factor that N holds."""
    cython.declare(i=cython.Py_ssize_t, k=cython.Py_ssize_t)
    for i in range(9):
        total = g[i]
        for k in range(i):
            total -= N[9 * i + k] * g[k]
        g[i] = total * N[10 * i]
    for i in range(8, -1, -1):
        total = g[i]
        for k in range(i + 1, 9):
            total -= N[9 * k + i] * g[k]
        g[i] = total * N[10 * i]


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _to_unit_length(h: cython.p_double) -> cython.bint:
    cython.declare(i=cython.Py_ssize_t)
    square = 0.0
    for i in range(9):
        square += h[i] * h[i]
    if not square > 0:
        return False
    inverse = 1 / sqrt(square)
    for i in range(9):
        h[i] *= inverse
    return True


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _trace(N: cython.p_double) -> cython.double:
    cython.declare(i=cython.Py_ssize_t)
    total = 0.0
    for i in range(9):
        total += N[10 * i]
    return total


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _write(
    h: cython.p_double,
    frames: cython.p_double,
    source: cython.const[cython.double][:, ::1],
    out: cython.double[:, ::1],
) -> cython.bint:
    """`out` <- T^-1 H S, T and S the frames, of norm 1, with most points in front."""
    cython.declare(i=cython.Py_ssize_t, j=cython.Py_ssize_t, k=cython.Py_ssize_t)
    for i in range(3):
        h[3 * i] *= frames[0]
        h[3 * i + 1] *= frames[0]
        h[3 * i + 2] -= h[3 * i] * frames[1] + h[3 * i + 1] * frames[2]
    for j in range(3):
        for i in range(2):
            h[3 * i + j] = h[3 * i + j] / frames[3] + frames[4 + i] * h[6 + j]
    if not _to_unit_length(h):
        return False
    in_front = 0
    for k in range(source.shape[0]):
        if h[6] * source[k, 0] + h[7] * source[k, 1] + h[8] > 0:
            in_front += 1
    sign = -1.0 if 2 * in_front < source.shape[0] else 1.0
    for i in range(9):
        out[i // 3, i % 3] = sign * h[i]
    return True
