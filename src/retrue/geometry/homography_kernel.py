"""`fit_homography`, compiled by Numba: the same maximum-likelihood fit, block by block of points.

A pair of points adds (D^T C^-1 D) kron (x x^T) to the normal equations, D (2, 3) the derivative of its transfer error
by H x, C its covariance: six numbers times six. Only `compiled` imports this module.
"""

from __future__ import annotations

import numpy as np

from retrue.geometry.arrays import FloatArray
from retrue.geometry.compiling import MATRIX, OUT_MATRIX, OUT_VECTOR, VECTOR, compiled, numba

BLOCK = 128  # points at a time: their terms stay in the first cache
SMALLEST_PIVOT = 1e-10  # of the largest; a second one below it, and NumPy decides whether the points determine H
INVERSE_ITERATIONS = 4
REORDERED = {"reassoc", "contract", "arcp"}  # sums in any order; NaN and infinity as they are


@compiled(numba.int64(OUT_MATRIX))
def _factorise(N: FloatArray) -> int:
    """Lower triangle of N (9, 9) <- its Cholesky factor; returns how many pivots are small. -1 where not definite."""
    largest, small = 0.0, 0
    for j in range(9):
        largest = max(largest, N[j, j])
    for j in range(9):
        for k in range(j):
            N[j, j] -= N[j, k] * N[j, k]
        if not N[j, j] > 0:
            return -1
        if N[j, j] < SMALLEST_PIVOT * largest:
            small += 1
        N[j, j] = np.sqrt(N[j, j])
        inverse = 1 / N[j, j]
        for i in range(j + 1, 9):
            total = N[i, j]
            for k in range(j):
                total -= N[i, k] * N[j, k]
            N[i, j] = total * inverse
    return small


@compiled(numba.void(MATRIX, OUT_VECTOR))
def _substitute(L: FloatArray, b: FloatArray) -> None:
    """b (9,) <- (L L^T)^-1 b."""
    for i in range(9):
        for k in range(i):
            b[i] -= L[i, k] * b[k]
        b[i] /= L[i, i]
    for i in range(8, -1, -1):
        for k in range(i + 1, 9):
            b[i] -= L[k, i] * b[k]
        b[i] /= L[i, i]


@compiled(numba.boolean(MATRIX, OUT_MATRIX, OUT_VECTOR), fastmath=REORDERED)
def _normalise(points: FloatArray, out: FloatArray, frame: FloatArray) -> bool:
    """`out` (2, N) with centroid 0 and mean distance sqrt 2; `frame` = scale, centroid. False where all are one."""
    count = len(points)
    cx, cy, spread = 0.0, 0.0, 0.0
    for i in range(count):
        cx += points[i, 0]
        cy += points[i, 1]
    cx, cy = cx / count, cy / count
    for i in range(count):
        spread += np.sqrt((points[i, 0] - cx) ** 2 + (points[i, 1] - cy) ** 2)
    spread /= count
    if not spread > 1e-12 * max(1.0, abs(cx), abs(cy)):
        return False
    scale = np.sqrt(2.0) / spread
    for i in range(count):
        out[0, i] = scale * (points[i, 0] - cx)
        out[1, i] = scale * (points[i, 1] - cy)
    frame[0], frame[1], frame[2] = scale, cx, cy
    return True


@compiled(
    numba.void(OUT_MATRIX, OUT_MATRIX, OUT_MATRIX, numba.int64, OUT_MATRIX, OUT_VECTOR),
    fastmath=REORDERED,
)
def _accumulate(A: FloatArray, X: FloatArray, E: FloatArray, size: int, M: FloatArray, g: FloatArray) -> None:
    """M (6, 6) += A X^T and g (9,) += E (x, 1)^T over the first `size` columns."""
    for a in range(6):
        for b in range(6):
            total = 0.0
            for i in range(size):
                total += A[a, i] * X[b, i]
            M[a, b] += total
    for a in range(3):
        first, second, third = 0.0, 0.0, 0.0
        for i in range(size):
            first += E[a, i] * X[2, i]
            second += E[a, i] * X[4, i]
            third += E[a, i]
        g[3 * a] += first
        g[3 * a + 1] += second
        g[3 * a + 2] += third


@compiled(numba.void(MATRIX, OUT_MATRIX))
def _unfold(M: FloatArray, N: FloatArray) -> None:
    """N (9, 9) of the six by six different products."""
    index = ((0, 1, 2), (1, 3, 4), (2, 4, 5))
    for a in range(3):
        for b in range(3):
            for i in range(3):
                for j in range(3):
                    N[3 * a + i, 3 * b + j] = M[index[a][b], index[i][j]]


@compiled(numba.void(MATRIX, MATRIX, VECTOR, OUT_MATRIX), fastmath=REORDERED)
def _linear(s: FloatArray, y: FloatArray, weights: FloatArray, N: FloatArray) -> None:
    """Normal equations N (9, 9) of eq. (13)."""
    A, X, E = np.empty((6, BLOCK)), np.empty((6, BLOCK)), np.zeros((3, BLOCK))
    M = np.zeros((6, 6))
    unused = np.zeros(9)
    X[5] = 1.0
    for start in range(0, s.shape[1], BLOCK):
        size = min(BLOCK, s.shape[1] - start)
        for i in range(size):
            k = start + i
            x0, x1, u, v, weight = s[0, k], s[1, k], y[0, k], y[1, k], weights[k]
            A[0, i], A[1, i], A[2, i] = weight, 0.0, -u * weight
            A[3, i], A[4, i], A[5, i] = weight, -v * weight, (u * u + v * v) * weight
            X[0, i], X[1, i], X[2, i], X[3, i], X[4, i] = x0 * x0, x0 * x1, x0, x1 * x1, x1
        _accumulate(A, X, E, size, M, unused)
    _unfold(M, N)


@compiled(
    numba.void(MATRIX, MATRIX, OUT_MATRIX, MATRIX, VECTOR, numba.float64, numba.float64, OUT_MATRIX, OUT_VECTOR),
    fastmath=REORDERED,
)
def _gauss_newton(
    s: FloatArray,
    y: FloatArray,
    corrected: FloatArray,
    H: FloatArray,
    weights: FloatArray,
    vs: float,
    vt: float,
    N: FloatArray,
    g: FloatArray,
) -> None:
    """Normal equations N (9, 9), g (9,) at H; moves the corrected source points on. `_refine` of `homography`."""
    A, X, E = np.empty((6, BLOCK)), np.empty((6, BLOCK)), np.empty((3, BLOCK))
    M = np.zeros((6, 6))
    g[:] = 0.0
    h00, h01, h02, h10, h11, h12 = H[0, 0], H[0, 1], H[0, 2], H[1, 0], H[1, 1], H[1, 2]
    h20, h21, h22 = H[2, 0], H[2, 1], H[2, 2]
    X[5] = 1.0
    for start in range(0, s.shape[1], BLOCK):
        size = min(BLOCK, s.shape[1] - start)
        for i in range(size):
            k = start + i
            x0, x1 = corrected[0, k], corrected[1, k]
            inverse = 1 / (h20 * x0 + h21 * x1 + h22)
            u, v = (h00 * x0 + h01 * x1 + h02) * inverse, (h10 * x0 + h11 * x1 + h12) * inverse
            p, q = (h00 - u * h20) * inverse, (h01 - u * h21) * inverse
            r, t = (h10 - v * h20) * inverse, (h11 - v * h21) * inverse
            ox, oy = s[0, k] - x0, s[1, k] - x1
            dx, dy = y[0, k] - u - p * ox - q * oy, y[1, k] - v - r * ox - t * oy
            a, b, c = vt + vs * (p * p + q * q), vs * (p * r + q * t), vt + vs * (r * r + t * t)
            determinant = 1 / (a * c - b * b)
            ex, ey = (c * dx - b * dy) * determinant, (a * dy - b * dx) * determinant
            x0, x1 = s[0, k] + vs * (p * ex + r * ey), s[1, k] + vs * (q * ex + t * ey)
            corrected[0, k], corrected[1, k] = x0, x1
            weight = weights[k] * inverse
            E[0, i], E[1, i] = ex * weight, ey * weight
            E[2, i] = -(u * ex + v * ey) * weight
            weight *= inverse * determinant
            A[0, i], A[1, i], A[3, i] = c * weight, -b * weight, a * weight
            A[2, i], A[4, i] = (b * v - c * u) * weight, (b * u - a * v) * weight
            A[5, i] = -(A[2, i] * u + A[4, i] * v)
            X[0, i], X[1, i], X[2, i], X[3, i], X[4, i] = x0 * x0, x0 * x1, x0, x1 * x1, x1
        _accumulate(A, X, E, size, M, g)
    _unfold(M, N)


@compiled(numba.boolean(OUT_VECTOR))
def _to_unit_length(h: FloatArray) -> bool:
    length = np.sqrt(np.sum(h * h))
    h /= length
    return length > 0


@compiled(numba.boolean(MATRIX, MATRIX, VECTOR, numba.float64, numba.float64, numba.int64, numba.float64, OUT_MATRIX))
def fit_homography(
    source: FloatArray,
    target: FloatArray,
    weights: FloatArray,
    source_sigma: float,
    target_sigma: float,
    iterations: int,
    settled: float,
    out: FloatArray,
) -> bool:
    """Fill `out` (3, 3); False where it should not be trusted. No weights stand for equal ones."""
    count = len(source)
    if count < 4 or source.shape != target.shape or source.shape[1] != 2 or len(weights) not in (0, count):
        return False
    if len(weights) == 0:
        weights = np.ones(count)
    elif not np.min(weights) >= 0:
        return False
    s, y, corrected = np.empty((2, count)), np.empty((2, count)), np.empty((2, count))
    source_frame, target_frame = np.empty(3), np.empty(3)
    if not (_normalise(source, s, source_frame) and _normalise(target, y, target_frame)):
        return False
    N, g = np.empty((9, 9)), np.empty(9)
    _linear(s, y, weights, N)
    trace = np.trace(N)
    for j in range(9):
        N[j, j] += 1e-14 * trace  # exact points leave a pivot of zero
    if not 0 <= _factorise(N) <= 1:
        return False
    h = np.zeros(9)
    h[0], h[4], h[8] = 1.0, 1.0, 1.0
    for _ in range(INVERSE_ITERATIONS):
        _substitute(N, h)
        _to_unit_length(h)
    vs, vt = (source_sigma * source_frame[0]) ** 2, (target_sigma * target_frame[0]) ** 2
    vs, vt = vs / (vs + vt), vt / (vs + vt)
    corrected[:] = s
    for _ in range(iterations):
        _gauss_newton(s, y, corrected, h.reshape(3, 3), weights, vs, vt, N, g)
        trace = np.trace(N)
        for i in range(9):
            for j in range(9):
                N[i, j] += trace * h[i] * h[j]  # the scale of H is free: hold it
        if _factorise(N) != 0:
            return False
        _substitute(N, g)
        h += g
        if not _to_unit_length(h):
            return False
        if np.max(np.abs(g)) < settled:
            break
    # T^-1 H S, with T and S the frames.
    H = h.reshape(3, 3)
    for i in range(3):
        for j in range(2):
            H[i, j] *= source_frame[0]
        H[i, 2] -= H[i, 0] * source_frame[1] + H[i, 1] * source_frame[2]
    for j in range(3):
        for i in range(2):
            H[i, j] = H[i, j] / target_frame[0] + target_frame[i + 1] * H[2, j]
    in_front = 0
    for k in range(count):
        if H[2, 0] * source[k, 0] + H[2, 1] * source[k, 1] + H[2, 2] > 0:
            in_front += 1
    sign = -1.0 if 2 * in_front < count else 1.0
    norm = np.sqrt(np.sum(h * h))
    for i in range(3):
        for j in range(3):
            out[i, j] = sign * H[i, j] / norm
    return norm > 0
