"""The inner loops of `geometry.robust_homography`: minimal samples and their score, a reweighted step, local scatter.

A homography is nine numbers, row by row; points are centred, so that its last number is not near zero. The samples
come from a counter-based generator (SplitMix64): the same state gives the same samples.
"""

from __future__ import annotations

import cython
from cython.cimports.libc.math import fabs, sqrt

INFINITY, NAN = cython.declare(cython.double, float("inf")), cython.declare(cython.double, float("nan"))
WORD = cython.declare(cython.ulonglong, 0xFFFFFFFFFFFFFFFF)
GAMMA = cython.declare(cython.ulonglong, 0x9E3779B97F4A7C15)
FIRST_MIX = cython.declare(cython.ulonglong, 0xBF58476D1CE4E5B9)
SECOND_MIX = cython.declare(cython.ulonglong, 0x94D049BB133111EB)
NEIGHBOURS = cython.declare(cython.Py_ssize_t, 12)
FLAT = cython.declare(cython.double, 1e-3)  # triangles flatter than this, in their size squared, map nothing
THIN = cython.declare(cython.double, 1e-12)  # twice the area of three points that count as on one line
SMALLEST_SHARE, LARGEST_SHARE = cython.declare(cython.double, 0.02), cython.declare(cython.double, 0.3)
PIVOT = cython.declare(cython.double, 1e-13)  # relative, below which the points do not determine a homography
REACH = cython.declare(cython.double, 2.0)  # of the first step, in cutoffs
SETTLED = cython.declare(cython.double, 1e-9)  # of the cutoff, that a step changes H by

Vector = cython.struct(x=cython.double, y=cython.double, z=cython.double)


@cython.cfunc
@cython.inline
@cython.exceptval(check=False)
def _cross(a: Vector, b: Vector) -> Vector:
    return Vector(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


@cython.cfunc
@cython.inline
@cython.exceptval(check=False)
def _dot(a: Vector, b: Vector) -> cython.double:
    return a.x * b.x + a.y * b.y + a.z * b.z


@cython.cfunc
@cython.inline
@cython.exceptval(check=False)
def _random(state: cython.ulonglong) -> cython.ulonglong:
    """SplitMix64 of a counter (Steele, Lea, Flood 2014)."""
    z: cython.ulonglong = (state * GAMMA) & WORD
    z = ((z ^ (z >> 30)) * FIRST_MIX) & WORD
    z = ((z ^ (z >> 27)) * SECOND_MIX) & WORD
    return z ^ (z >> 31)


@cython.cfunc
@cython.inline
@cython.exceptval(check=False)
def _random_row(state: cython.ulonglong, count: cython.ulonglong) -> cython.Py_ssize_t:
    """Evenly over `count` rows, count < 2^32."""
    return cython.cast(cython.Py_ssize_t, ((_random(state) >> 32) * count) >> 32)


@cython.cfunc
@cython.inline
@cython.exceptval(check=False)
def _minimal(
    x: cython.const[cython.double][:, ::1],
    y: cython.const[cython.double][:, ::1],
    rows: cython.pointer(cython.Py_ssize_t),
    H: cython.p_double,
) -> cython.bint:
    """The homography of four points; False where three lie on one line, or where it would turn some of them over.

    With a frame of three points, p4 = sum l_i p_i and q4 = sum m_i q_i: H = sum q_i (m_i / l_i) p_i*, p* the dual.
    """
    p1, p2 = Vector(x[rows[0], 0], x[rows[0], 1], 1.0), Vector(x[rows[1], 0], x[rows[1], 1], 1.0)
    p3, p4 = Vector(x[rows[2], 0], x[rows[2], 1], 1.0), Vector(x[rows[3], 0], x[rows[3], 1], 1.0)
    q1, q2 = Vector(y[rows[0], 0], y[rows[0], 1], 1.0), Vector(y[rows[1], 0], y[rows[1], 1], 1.0)
    q3, q4 = Vector(y[rows[2], 0], y[rows[2], 1], 1.0), Vector(y[rows[3], 0], y[rows[3], 1], 1.0)
    d1, d2, d3 = _cross(p2, p3), _cross(p3, p1), _cross(p1, p2)
    e1, e2, e3 = _cross(q2, q3), _cross(q3, q1), _cross(q1, q2)
    l0, l1, l2, l3 = _dot(d1, p1), _dot(d1, p4), _dot(d2, p4), _dot(d3, p4)
    m0, m1, m2, m3 = _dot(e1, q1), _dot(e1, q4), _dot(e2, q4), _dot(e3, q4)
    if not (fabs(l0) > THIN and fabs(l1) > THIN and fabs(l2) > THIN and fabs(l3) > THIN):
        return False
    side = l0 * m0
    if not (fabs(side) > 0 and side * l1 * m1 > 0 and side * l2 * m2 > 0 and side * l3 * m3 > 0):
        return False
    c1, c2, c3 = m1 / l1, m2 / l2, m3 / l3
    H[0] = c1 * q1.x * d1.x + c2 * q2.x * d2.x + c3 * q3.x * d3.x
    H[1] = c1 * q1.x * d1.y + c2 * q2.x * d2.y + c3 * q3.x * d3.y
    H[2] = c1 * q1.x * d1.z + c2 * q2.x * d2.z + c3 * q3.x * d3.z
    H[3] = c1 * q1.y * d1.x + c2 * q2.y * d2.x + c3 * q3.y * d3.x
    H[4] = c1 * q1.y * d1.y + c2 * q2.y * d2.y + c3 * q3.y * d3.y
    H[5] = c1 * q1.y * d1.z + c2 * q2.y * d2.z + c3 * q3.y * d3.z
    H[6] = c1 * d1.x + c2 * d2.x + c3 * d3.x
    H[7] = c1 * d1.y + c2 * d2.y + c3 * d3.y
    H[8] = c1 * d1.z + c2 * d2.z + c3 * d3.z
    return True


@cython.cfunc
@cython.inline
@cython.exceptval(check=False)
def _support(
    H: cython.p_double,
    x: cython.const[cython.double][:, ::1],
    y: cython.const[cython.double][:, ::1],
    count: cython.Py_ssize_t,
    cutoff: cython.double,
    least: cython.double,
) -> cython.double:
    """Sum over the first `count` points of 1 - (distance / cutoff)^2, none below zero (MSAC); -1 below `least`."""
    scale = 1 / (cutoff * cutoff)
    support: cython.double = count
    for k in range(count):
        depth = H[6] * x[k, 0] + H[7] * x[k, 1] + H[8]
        inverse = 1 / depth if depth != 0 else INFINITY
        dx = (H[0] * x[k, 0] + H[1] * x[k, 1] + H[2]) * inverse - y[k, 0]
        dy = (H[3] * x[k, 0] + H[4] * x[k, 1] + H[5]) * inverse - y[k, 1]
        lost = (dx * dx + dy * dy) * scale
        support -= lost if lost < 1 else 1.0  # NaN too
        if not support > least:
            return -1.0
    return support


def search(
    x: cython.const[cython.double][:, ::1],
    y: cython.const[cython.double][:, ::1],
    scored: cython.Py_ssize_t,
    cutoff: cython.double,
    state: cython.ulonglong,
    tries: cython.Py_ssize_t,
    best: cython.double[:, ::1],
) -> None:
    """Homographies of four points, and how many of the first `scored` points support each.

    Every other sample is local: of some random points, the four nearest to one of all; the more there are, the smaller
    its neighbourhood.

    Parameters
    ----------
    x, y : (N, 2) in random order.
    state : counter that the samples come from; each try takes 256.
    best : (K, 10) support and H of the best so far, best first; to start with, zeros.
    """
    count: cython.Py_ssize_t = x.shape[0]
    last: cython.Py_ssize_t = best.shape[0] - 1
    rows = cython.declare(cython.Py_ssize_t[4])
    near = cython.declare(cython.double[4])
    H = cython.declare(cython.double[9])
    for attempt in range(tries):
        draw: cython.ulonglong = state + 256 * attempt
        if attempt % 2 == 0:
            for i in range(4):
                rows[i] = _random_row(draw + i, count)
        else:
            seed = _random_row(draw, count)
            share = SMALLEST_SHARE + (LARGEST_SHARE - SMALLEST_SHARE) * (_random(draw + 1) >> 11) * 2.0**-53
            for i in range(4):
                rows[i], near[i] = seed, INFINITY
            for j in range(cython.cast(cython.Py_ssize_t, 4 / share)):
                row = _random_row(draw + 2 + j, count)
                dx, dy = x[row, 0] - x[seed, 0], x[row, 1] - x[seed, 1]
                square = dx * dx + dy * dy
                if square < near[3] and row != rows[0] and row != rows[1] and row != rows[2]:
                    i = 3
                    while i > 0 and square < near[i - 1]:
                        rows[i], near[i] = rows[i - 1], near[i - 1]
                        i -= 1
                    rows[i], near[i] = row, square
        if not _minimal(x, y, rows, H):
            continue
        support = _support(H, x, y, scored, cutoff, best[last, 0])
        if support > best[last, 0]:
            i = last
            while i > 0 and support > best[i - 1, 0]:
                for j in range(10):
                    best[i, j] = best[i - 1, j]
                i -= 1
            best[i, 0] = support
            for j in range(9):
                best[i, 1 + j] = H[j]


@cython.cfunc
@cython.exceptval(check=False)
def _solve(A: cython.p_double, b: cython.p_double) -> cython.bint:
    """A b' = b in place by Cholesky, A (8, 8) symmetric by its lower triangle; False where it is singular."""
    for i in range(8):
        diagonal = A[9 * i]
        for j in range(i + 1):
            value = A[8 * i + j]
            for k in range(j):
                value -= A[8 * i + k] * A[8 * j + k]
            if j < i:
                A[8 * i + j] = value / A[9 * j]
            elif value > PIVOT * diagonal:
                A[9 * i] = sqrt(value)
            else:
                return False
    for i in range(8):
        for k in range(i):
            b[i] -= A[8 * i + k] * b[k]
        b[i] /= A[9 * i]
    for back in range(8):
        i = 7 - back
        for k in range(i + 1, 8):
            b[i] -= A[8 * k + i] * b[k]
        b[i] /= A[9 * i]
    return True


@cython.cfunc
@cython.exceptval(check=False)
def _step(
    H: cython.p_double,
    x: cython.const[cython.double][:, ::1],
    y: cython.const[cython.double][:, ::1],
    count: cython.Py_ssize_t,
    reach: cython.double,
    fewest: cython.double,
) -> cython.bint:
    """One Gauss-Newton step on the points within `reach` under Tukey's biweight; False where they are too few.

    With q = (x, 1) / depth, d (u, v) = (q . dH1 - u q . dH3, q . dH2 - v q . dH3), dH33 = 0: all blocks of the normal
    equations are sums of q q^T, times 1, u, v and u^2 + v^2.
    """
    A = cython.declare(cython.double[64])
    b = cython.declare(cython.double[8])
    S = cython.declare(cython.double[24])
    for i in range(24):
        S[i] = 0.0
    for i in range(8):
        b[i] = 0.0
    found: cython.Py_ssize_t = 0
    scale = 1 / (reach * reach)
    for k in range(count):
        depth = H[6] * x[k, 0] + H[7] * x[k, 1] + H[8]
        if depth == 0:
            continue
        q3 = 1 / depth
        q1, q2 = x[k, 0] * q3, x[k, 1] * q3
        u, v = H[0] * q1 + H[1] * q2 + H[2] * q3, H[3] * q1 + H[4] * q2 + H[5] * q3
        dx, dy = y[k, 0] - u, y[k, 1] - v
        inside = 1 - (dx * dx + dy * dy) * scale
        if not inside > 0:
            continue
        found += 1
        weight = inside * inside
        w1, w2, w3 = weight * q1, weight * q2, weight * q3
        p11, p12, p22, p13, p23, p33 = w1 * q1, w1 * q2, w2 * q2, w1 * q3, w2 * q3, w3 * q3
        S[0], S[1], S[2], S[3], S[4], S[5] = S[0] + p11, S[1] + p12, S[2] + p22, S[3] + p13, S[4] + p23, S[5] + p33
        S[6], S[7], S[8], S[9], S[10] = S[6] + u * p11, S[7] + u * p12, S[8] + u * p22, S[9] + u * p13, S[10] + u * p23
        S[11], S[12], S[13] = S[11] + v * p11, S[12] + v * p12, S[13] + v * p22
        S[14], S[15] = S[14] + v * p13, S[15] + v * p23
        square, error = u * u + v * v, u * dx + v * dy
        S[16], S[17], S[18] = S[16] + square * p11, S[17] + square * p12, S[18] + square * p22
        b[0], b[1], b[2] = b[0] + w1 * dx, b[1] + w2 * dx, b[2] + w3 * dx
        b[3], b[4], b[5] = b[3] + w1 * dy, b[4] + w2 * dy, b[5] + w3 * dy
        b[6], b[7] = b[6] - w1 * error, b[7] - w2 * error
    if not found >= fewest:
        return False
    for i in range(64):
        A[i] = 0.0
    for i in range(2):
        corner: cython.Py_ssize_t = 27 * i  # of the block of H's row i
        A[corner], A[corner + 8], A[corner + 9] = S[0], S[1], S[2]
        A[corner + 16], A[corner + 17], A[corner + 18] = S[3], S[4], S[5]
        left, sums = 48 + 3 * i, 6 + 5 * i
        A[left], A[left + 1], A[left + 2] = -S[sums], -S[sums + 1], -S[sums + 3]
        A[left + 8], A[left + 9], A[left + 10] = -S[sums + 1], -S[sums + 2], -S[sums + 4]
    A[54], A[62], A[63] = S[16], S[17], S[18]
    if not _solve(A, b):
        return False
    for i in range(8):
        H[i] += b[i]
    return True


def refine(
    x: cython.const[cython.double][:, ::1],
    y: cython.const[cython.double][:, ::1],
    count: cython.Py_ssize_t,
    cutoff: cython.double,
    fewest: cython.double,
    steps: cython.Py_ssize_t,
    homography: cython.double[::1],
) -> cython.double:
    """Refine H on what lies near of the first `count` points, the reach shrinking to the cutoff.

    Returns its support there, -1 where fewer than `fewest` are near or do not determine it.
    """
    H, before = cython.declare(cython.double[9]), cython.declare(cython.double[9])
    if homography[8] == 0:
        return -1.0
    for i in range(9):
        H[i] = homography[i] / homography[8]
    for step in range(steps):
        moved = 0.0
        for i in range(9):
            before[i] = H[i]
        if not _step(H, x, y, count, REACH * cutoff if step == 0 else cutoff, fewest):
            return -1.0
        for i in range(9):
            moved = max(moved, fabs(H[i] - before[i]))
        if step > 0 and moved < SETTLED * cutoff:
            break
    for i in range(9):
        homography[i] = H[i]
    return _support(H, x, y, count, cutoff, -1.0)


def transfer_distances(
    x: cython.const[cython.double][:, ::1],
    y: cython.const[cython.double][:, ::1],
    H: cython.const[cython.double][::1],
    distances: cython.double[::1],
) -> None:
    """From each y to H x; NaN where that is at infinity."""
    for k in range(x.shape[0]):
        depth = H[6] * x[k, 0] + H[7] * x[k, 1] + H[8]
        inverse = 1 / depth if depth != 0 else NAN
        dx = (H[0] * x[k, 0] + H[1] * x[k, 1] + H[2]) * inverse - y[k, 0]
        dy = (H[3] * x[k, 0] + H[4] * x[k, 1] + H[5]) * inverse - y[k, 1]
        distances[k] = sqrt(dx * dx + dy * dy)


def local_scatter(
    x: cython.const[cython.double][:, ::1],
    y: cython.const[cython.double][:, ::1],
    seeds: cython.const[cython.longlong][::1],
    triplets: cython.const[cython.longlong][:, ::1],
    scatter: cython.double[::1],
) -> None:
    """Of the seed's neighbourhood of 12, the third smallest squared error of the others under the affine map of three.

    Of all the triplets (T, 3), numbers of neighbours, the one that makes it smallest; infinity where all are flat.
    """
    rows = cython.declare(cython.Py_ssize_t[12])
    near = cython.declare(cython.double[12])
    for s in range(seeds.shape[0]):
        seed: cython.Py_ssize_t = seeds[s]
        for i in range(NEIGHBOURS):
            near[i] = INFINITY
        for row in range(x.shape[0]):
            dx, dy = x[row, 0] - x[seed, 0], x[row, 1] - x[seed, 1]
            square = dx * dx + dy * dy
            if square < near[NEIGHBOURS - 1]:
                i = NEIGHBOURS - 1
                while i > 0 and square < near[i - 1]:
                    rows[i], near[i] = rows[i - 1], near[i - 1]
                    i -= 1
                rows[i], near[i] = row, square
        best: cython.double = INFINITY
        for t in range(triplets.shape[0]):
            a: cython.Py_ssize_t = rows[triplets[t, 0]]
            b: cython.Py_ssize_t = rows[triplets[t, 1]]
            c: cython.Py_ssize_t = rows[triplets[t, 2]]
            bx, by, cx, cy = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1], x[c, 0] - x[a, 0], x[c, 1] - x[a, 1]
            area = bx * cy - by * cx
            size: cython.double = 0.0
            for i in range(3):
                row = rows[triplets[t, i]]
                size = max(size, fabs(x[row, 0] - x[seed, 0]), fabs(x[row, 1] - x[seed, 1]))
            if not fabs(area) > FLAT * size * size:
                continue
            bx, by, cx, cy = bx / area, by / area, cx / area, cy / area
            first: cython.double = INFINITY
            second: cython.double = INFINITY
            third: cython.double = INFINITY
            for i in range(NEIGHBOURS):
                row = rows[i]
                if row in (a, b, c):
                    continue
                px, py = x[row, 0] - x[a, 0], x[row, 1] - x[a, 1]
                u, v = px * cy - py * cx, bx * py - by * px
                dx = y[row, 0] - y[a, 0] - u * (y[b, 0] - y[a, 0]) - v * (y[c, 0] - y[a, 0])
                dy = y[row, 1] - y[a, 1] - u * (y[b, 1] - y[a, 1]) - v * (y[c, 1] - y[a, 1])
                square = dx * dx + dy * dy
                if square < first:
                    first, second, third = square, first, second
                elif square < second:
                    second, third = square, second
                elif square < third:
                    third = square
            best = min(best, third)
        scatter[s] = best
