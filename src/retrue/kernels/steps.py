"""A step of a two-view fit: its equations from the sums over the points, their solution, and the pose that follows."""

from __future__ import annotations

import cython
from cython.cimports.libc.math import atan2, fabs, sin, sqrt

POSE = cython.declare(cython.Py_ssize_t, 5)
UNKNOWNS = cython.declare(cython.Py_ssize_t, 8)  # of one point: the pose, and n of its plane
SMALLEST = cython.declare(cython.double, 1e-12)
LITTLE = cython.declare(cython.double, 1e-9)
SMALL_ANGLE = cython.declare(cython.double, 1e-4)


def assemble(
    planes: cython.const[cython.double][:, ::1],
    bows: cython.const[cython.double][:, ::1],
    blocks: cython.const[cython.double][:, :, ::1],
    information: cython.double[:, ::1],
    gradient: cython.double[::1],
) -> None:
    """`information` (S, S) and `gradient` (S,) <- of the pose (5), the planes (3 P), the lenses and the bows (B P).

    `blocks` (P + 1, 8 + 1 + L + B, the same) are those of `two_view` with the residuals for its only column, `bows`
    (P, B) where they are. A plane whose points all lost their weight stays where it is: one unit of information,
    relative to its n; and a billionth of what it has, where one or two points are left. Bows have a prior of variance
    1 about zero.
    """
    cython.declare(i=cython.Py_ssize_t, j=cython.Py_ssize_t, k=cython.Py_ssize_t)
    count: cython.Py_ssize_t = planes.shape[0]
    per_plane: cython.Py_ssize_t = bows.shape[1]
    width: cython.Py_ssize_t = blocks.shape[1]
    lenses: cython.Py_ssize_t = width - UNKNOWNS - 1 - per_plane
    place = cython.declare(cython.Py_ssize_t[40])
    with cython.nogil:
        information[:, :] = 0.0
        gradient[:] = 0.0
        for k in range(count + 1):
            for i in range(width):
                if i < POSE:
                    place[i] = i
                elif i < UNKNOWNS:
                    place[i] = i + 3 * k
                else:
                    place[i] = i - 1 - UNKNOWNS + POSE + 3 * count
                    if i > UNKNOWNS + lenses:
                        place[i] += per_plane * k
            for i in range(width):
                if i == UNKNOWNS or (k == count and (POSE <= i < UNKNOWNS or i > UNKNOWNS + lenses)):
                    continue
                gradient[place[i]] += blocks[k, i, UNKNOWNS] if i > UNKNOWNS else blocks[k, UNKNOWNS, i]
                for j in range(i + 1):
                    if j != UNKNOWNS and (k < count or not POSE <= j < UNKNOWNS):
                        information[place[i], place[j]] += blocks[k, i, j]
        for k in range(count):
            square = planes[k, 0] * planes[k, 0] + planes[k, 1] * planes[k, 1] + planes[k, 2] * planes[k, 2]
            for i in range(POSE + 3 * k, POSE + 3 * k + 3):
                information[i, i] += LITTLE * information[i, i] + 1 / max(square, SMALLEST)
            for i in range(per_plane):
                j = POSE + 3 * count + lenses + per_plane * k + i
                information[j, j] += 1.0
                gradient[j] += bows[k, i]
        for i in range(information.shape[0]):
            for j in range(i):
                information[j, i] = information[i, j]


def solve(
    information: cython.const[cython.double][:, ::1],
    right: cython.const[cython.double][:, ::1],
    damping: cython.double,
    room: cython.double[:, ::1],
    solution: cython.double[:, ::1],
) -> bool:
    """`solution` (S, K) of information x = right, the diagonal times 1 + damping; False where nothing determines one.

    By Gaussian elimination of the equations at unit scale, pivots by rows; `room` is (S, S + K).
    """
    cython.declare(i=cython.Py_ssize_t, j=cython.Py_ssize_t, k=cython.Py_ssize_t, pivot=cython.Py_ssize_t)
    size: cython.Py_ssize_t = information.shape[0]
    width: cython.Py_ssize_t = size + right.shape[1]
    for i in range(size):
        if not information[i, i] > 0:
            return False
    for i in range(size):
        for j in range(size):
            room[i, j] = information[i, j] / sqrt(information[i, i] * information[j, j])
        room[i, i] *= 1 + damping
        for j in range(size, width):
            room[i, j] = right[i, j - size] / sqrt(information[i, i])
    for k in range(size):
        pivot = k
        for i in range(k + 1, size):
            if fabs(room[i, k]) > fabs(room[pivot, k]):
                pivot = i
        if not fabs(room[pivot, k]) > 0:
            return False
        if pivot != k:
            for j in range(k, width):
                room[k, j], room[pivot, j] = room[pivot, j], room[k, j]
        for i in range(k + 1, size):
            factor = room[i, k] / room[k, k]
            if factor != 0:
                for j in range(k + 1, width):
                    room[i, j] -= factor * room[k, j]
    for k in range(size, width):
        i = size
        while i > 0:
            i -= 1
            value = room[i, k]
            for j in range(i + 1, size):
                value -= room[i, j] * solution[j, k - size]
            solution[i, k - size] = value / room[i, i]
        for i in range(size):
            solution[i, k - size] /= sqrt(information[i, i])
            if not fabs(solution[i, k - size]) < 1e300:
                return False
    return True


def turned(
    R: cython.const[cython.double][:, ::1],
    axes: cython.const[cython.double][:, ::1],
    step: cython.const[cython.double][::1],
    new_R: cython.double[:, ::1],
    t: cython.double[::1],
) -> None:
    """`new_R` <- exp([w]x) R and `t` <- unit(t + B d) for a step that begins (w, d); `axes` are t and those of B."""
    cython.declare(i=cython.Py_ssize_t, j=cython.Py_ssize_t)
    W = cython.declare(cython.double[9])
    with cython.nogil:
        x, y, z = step[0], step[1], step[2]
        square = x * x + y * y + z * z
        angle = sqrt(square)
        if angle > SMALL_ANGLE:
            sine, half = sin(angle) / angle, sin(angle / 2) / (angle / 2)
        else:
            sine, half = 1 - square / 6, 1 - square / 24
        versine = half * half / 2  # (1 - cos a) / a^2
        W[0], W[4], W[8] = -versine * (y * y + z * z), -versine * (x * x + z * z), -versine * (x * x + y * y)
        W[1], W[3] = versine * x * y - sine * z, versine * x * y + sine * z
        W[2], W[6] = versine * x * z + sine * y, versine * x * z - sine * y
        W[5], W[7] = versine * y * z - sine * x, versine * y * z + sine * x
        for i in range(3):
            for j in range(3):
                new_R[i, j] = R[i, j] + W[3 * i] * R[0, j] + W[3 * i + 1] * R[1, j] + W[3 * i + 2] * R[2, j]
        length = 0.0
        for i in range(3):
            t[i] = axes[0, i] + axes[1, i] * step[3] + axes[2, i] * step[4]
            length += t[i] * t[i]
        length = sqrt(length)
        for i in range(3):
            t[i] /= length


def axes(t: cython.const[cython.double][::1], found: cython.double[:, ::1]) -> None:
    """`found` (3, 3) <- the unit vector t, and two more rows that make an orthonormal basis with it."""
    x, y, z = t[0], t[1], t[2]
    if fabs(x) <= fabs(y) and fabs(x) <= fabs(z):
        u, v, w = 0.0, z, 0.0 - y
    elif fabs(y) <= fabs(z):
        u, v, w = -z, 0.0, x
    else:
        u, v, w = y, -x, 0.0
    length = sqrt(u * u + v * v + w * w)
    u, v, w = u / length, v / length, w / length
    found[0, 0], found[0, 1], found[0, 2] = x, y, z
    found[1, 0], found[1, 1], found[1, 2] = u, v, w
    found[2, 0], found[2, 1], found[2, 2] = y * w - z * v, z * u - x * w, x * v - y * u


def difference(
    R: cython.const[cython.double][:, ::1],
    t: cython.const[cython.double][::1],
    other: cython.const[cython.double][:, ::1],
    axes: cython.const[cython.double][:, ::1],
    step: cython.double[::1],
) -> None:
    """`step` (5,) <- the rotation vector of the other R times R^T, and the angle from t to the other along its axes.

    `axes` (3, 3) are the other t and the two across it. Of the quaternion (x, y, z, w), the row of its outer product
    with itself counts that is longest, and has no cancellation.
    """
    cython.declare(i=cython.Py_ssize_t, j=cython.Py_ssize_t, longest=cython.Py_ssize_t)
    turn = cython.declare(cython.double[9])
    rows = cython.declare(cython.double[16])
    with cython.nogil:
        for i in range(3):
            for j in range(3):
                turn[3 * i + j] = other[i, 0] * R[j, 0] + other[i, 1] * R[j, 1] + other[i, 2] * R[j, 2]
        trace = turn[0] + turn[4] + turn[8]
        for i in range(3):
            rows[5 * i] = 1 - trace + 2 * turn[4 * i]
            for j in range(3):
                if i != j:
                    rows[4 * i + j] = turn[3 * i + j] + turn[3 * j + i]
        rows[15] = 1 + trace
        rows[3], rows[7], rows[11] = turn[7] - turn[5], turn[2] - turn[6], turn[3] - turn[1]
        rows[12], rows[13], rows[14] = rows[3], rows[7], rows[11]
        longest = 0
        for i in range(1, 4):
            if rows[5 * i] > rows[5 * longest]:
                longest = i
        x, y, z, w = rows[4 * longest], rows[4 * longest + 1], rows[4 * longest + 2], rows[4 * longest + 3]
        if w < 0:
            x, y, z, w = -x, -y, -z, -w
        sine = sqrt(x * x + y * y + z * z)
        factor = 2 * atan2(sine, w) / sine if sine > 0 else 0.0
        step[0], step[1], step[2] = factor * x, factor * y, factor * z
        along = axes[0, 0] * t[0] + axes[0, 1] * t[1] + axes[0, 2] * t[2]
        first = axes[1, 0] * t[0] + axes[1, 1] * t[1] + axes[1, 2] * t[2]
        second = axes[2, 0] * t[0] + axes[2, 1] * t[1] + axes[2, 2] * t[2]
        sine = sqrt(first * first + second * second)
        factor = atan2(sine, along) / sine if sine > 0 else 1.0
        step[3], step[4] = -factor * first, -factor * second


def planes_of_pose(
    R: cython.const[cython.double][:, ::1],
    t: cython.const[cython.double][::1],
    homographies: cython.const[cython.double][:, :, ::1],
    planes: cython.double[:, ::1],
) -> None:
    """`planes` (P, 3) <- n of lambda H = R + t n^T, lambda from what t does not touch: [t]x (lambda H - R) = 0."""
    cython.declare(i=cython.Py_ssize_t, j=cython.Py_ssize_t, k=cython.Py_ssize_t)
    with cython.nogil:
        for k in range(homographies.shape[0]):
            both, square = 0.0, 0.0
            for i in range(3):
                u, v = t[(i + 1) % 3], t[(i + 2) % 3]
                for j in range(3):
                    a = u * homographies[k, (i + 2) % 3, j] - v * homographies[k, (i + 1) % 3, j]
                    b = u * R[(i + 2) % 3, j] - v * R[(i + 1) % 3, j]
                    both += a * b
                    square += a * a
            for j in range(3):
                planes[k, j] = 0.0
                for i in range(3):
                    planes[k, j] += t[i] * (homographies[k, i, j] * (both / square) - R[i, j])
