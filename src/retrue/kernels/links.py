"""Blobs near each other: which four are neighbours of each, and which hang together."""

from __future__ import annotations

import cython
from cython.cimports.libc.math import atan2, cos, fabs, isfinite, sin, sqrt

SIZE_RATIO = cython.declare(cython.double, 2.2)  # between the areas of neighbours
SHAPE_RATIO = cython.declare(cython.double, 2.5)  # between the spacings that neighbours measure, each in its own shape
SINE_OFF_AXIS = cython.declare(cython.double, 0.4067366430758002)  # 24 degrees
EVEN = cython.declare(cython.double, 1.25)  # of the shortest spacing: up to there, a neighbour tells the frame
FARTHEST = cython.declare(cython.double, 1.6)  # of the shortest spacing, of a neighbour
NONE = cython.declare(cython.Py_ssize_t, -1)
NAN = cython.declare(cython.double, float("nan"))
INFINITY = cython.declare(cython.double, float("inf"))


def nearest(
    places: cython.const[cython.double][:, ::1],
    points: cython.const[cython.double][:, ::1],
    start: cython.longlong[::1],
    room: cython.longlong[:, ::1],
    square: cython.double[:, ::1],
    index: cython.longlong[:, ::1],
) -> cython.void:
    """`square` (M, K) and `index` <- squared distances from each of `points` to the K nearest of `places` (N, 2).

    From inside outwards by square buckets for half a place each. `start` (4 N + 4), zeros at first, and `room` (2, N)
    are room to work in: there are no more buckets than that.
    """
    cython.declare(n=cython.Py_ssize_t, m=cython.Py_ssize_t, k=cython.Py_ssize_t, r=cython.Py_ssize_t)
    cython.declare(slot=cython.Py_ssize_t, ring=cython.Py_ssize_t, row=cython.Py_ssize_t, column=cython.Py_ssize_t)
    cython.declare(stride=cython.Py_ssize_t)
    left: cython.double = places[0, 0]
    right: cython.double = places[0, 0]
    top: cython.double = places[0, 1]
    bottom: cython.double = places[0, 1]
    cython.declare(x=cython.double, y=cython.double, margin=cython.double, reached=cython.double)
    count, wanted = places.shape[0], square.shape[1]
    with cython.nogil:
        for n in range(count):
            left, right = min(left, places[n, 0]), max(right, places[n, 0])
            top, bottom = min(top, places[n, 1]), max(bottom, places[n, 1])
        x, y = right - left, bottom - top
        side = max(sqrt(x * y / (2 * count)), max(x, y) / count, 1e-9)
        columns = cython.cast(cython.Py_ssize_t, x / side) + 1
        rows = cython.cast(cython.Py_ssize_t, y / side) + 1
        for n in range(count):
            row = cython.cast(cython.Py_ssize_t, (places[n, 1] - top) / side)
            column = cython.cast(cython.Py_ssize_t, (places[n, 0] - left) / side)
            room[0, n] = row * columns + column
            start[room[0, n] + 2] += 1
        for n in range(1, rows * columns + 2):
            start[n] += start[n - 1]
        for n in range(count):  # moves each start to where the next one was
            k = room[0, n] + 1
            room[1, start[k]] = n
            start[k] += 1
        for m in range(points.shape[0]):
            for slot in range(wanted):
                square[m, slot], index[m, slot] = INFINITY, 0
            # No place is nearer to a point outside the buckets than to where that enters them.
            x, y = min(max(points[m, 0] - left, 0.0), columns * side), min(max(points[m, 1] - top, 0.0), rows * side)
            column = min(cython.cast(cython.Py_ssize_t, x / side), columns - 1)
            row = min(cython.cast(cython.Py_ssize_t, y / side), rows - 1)
            margin = min(x - column * side, (column + 1) * side - x, y - row * side, (row + 1) * side - y)
            for ring in range(max(columns, rows)):
                reached = max(margin + (ring - 1) * side, 0.0)
                if square[m, wanted - 1] <= reached * reached:
                    break
                for r in range(max(row - ring, 0), min(row + ring + 1, rows)):
                    stride = 1 if r == row - ring or r == row + ring else max(2 * ring, 1)
                    c: cython.Py_ssize_t = column - ring
                    while c <= column + ring:
                        if 0 <= c < columns:
                            for k in range(start[r * columns + c], start[r * columns + c + 1]):
                                n = room[1, k]
                                dx, dy = places[n, 0] - points[m, 0], places[n, 1] - points[m, 1]
                                _insert(square, index, m, wanted, dx * dx + dy * dy, n)
                        c += stride


@cython.cfunc
@cython.nogil
@cython.inline
@cython.exceptval(check=False)
def _insert(
    square: cython.double[:, ::1],
    index: cython.longlong[:, ::1],
    m: cython.Py_ssize_t,
    wanted: cython.Py_ssize_t,
    far: cython.double,
    n: cython.Py_ssize_t,
) -> cython.void:
    """Place n into the row m of `wanted` nearest ones, which are in order."""
    if not far < square[m, wanted - 1]:
        return
    slot: cython.Py_ssize_t = wanted - 1
    while slot > 0 and square[m, slot - 1] > far:
        square[m, slot], index[m, slot] = square[m, slot - 1], index[m, slot - 1]
        slot -= 1
    square[m, slot], index[m, slot] = far, n


def whiten(shape: cython.const[cython.double][:, :, ::1], root: cython.double[:, ::1]) -> cython.void:
    """`root` (N, 3) <- xx, xy, yy of M^-1/2, of symmetric positive M (N, 2, 2), in closed form."""
    n: cython.Py_ssize_t
    with cython.nogil:
        for n in range(shape.shape[0]):
            a, b, c = shape[n, 0, 0], shape[n, 0, 1], shape[n, 1, 1]
            area = sqrt(max(a * c - b * b, 1e-9))
            scale = 1 / (area * sqrt(a + c + 2 * area))
            root[n, 0], root[n, 1], root[n, 2] = (c + area) * scale, -b * scale, (a + area) * scale


@cython.cfunc
@cython.nogil
@cython.inline
@cython.exceptval(check=False)
def _norm(x: cython.double, y: cython.double) -> cython.double:
    return sqrt(x * x + y * y)


def choose_neighbours(
    centre: cython.const[cython.double][:, ::1],
    root: cython.const[cython.double][:, ::1],
    area: cython.const[cython.double][::1],
    near: cython.const[cython.longlong][:, ::1],
    step: cython.double[:, ::1],
    chosen: cython.longlong[:, ::1],
) -> cython.void:
    """`chosen` (N, 4) <- the nearest blob of `near` (N, M) in each direction of the block's own frame, or -1.

    `step` (M, 3) is room for length, cosine and sine of the way to each of them, in that frame.
    """
    cython.declare(shortest=cython.double, cosine=cython.double, sine=cython.double)
    best = cython.declare(cython.double[4])
    cython.declare(off=cython.double, c=cython.double, s=cython.double)
    cython.declare(n=cython.Py_ssize_t, m=cython.Py_ssize_t, direction=cython.Py_ssize_t)
    with cython.nogil:
        candidates = near.shape[1]
        for n in range(centre.shape[0]):
            shortest = INFINITY
            for m in range(candidates):
                other = near[n, m]
                x, y = centre[other, 0] - centre[n, 0], centre[other, 1] - centre[n, 1]
                sx, sy = root[n, 0] * x + root[n, 1] * y, root[n, 1] * x + root[n, 2] * y
                ox, oy = root[other, 0] * x + root[other, 1] * y, root[other, 1] * x + root[other, 2] * y
                # The same step as the other end sees it: where the two disagree, they are not blocks of one surface.
                here, there, ratio = _norm(sx, sy), _norm(ox, oy), area[other] / area[n]
                similar: cython.bint = 1 / SIZE_RATIO < ratio < SIZE_RATIO
                if similar and there < SHAPE_RATIO * here and here < SHAPE_RATIO * there:
                    step[m, 0], step[m, 1], step[m, 2] = here, sx / here, sy / here
                    shortest = min(shortest, here)
                else:
                    step[m, 0], step[m, 1], step[m, 2] = INFINITY, 0.0, 0.0
            cosine, sine = 0.0, 0.0
            for m in range(candidates):
                if step[m, 0] < EVEN * shortest:
                    c, s = step[m, 1] * step[m, 1] - step[m, 2] * step[m, 2], 2 * step[m, 1] * step[m, 2]  # of twice
                    cosine += c * c - s * s  # of four times the angle
                    sine += 2 * c * s
            frame = atan2(sine, cosine) / 4  # direction 0, in [-45, 45) degrees
            cosine, sine = cos(frame), sin(frame)
            for direction in range(4):
                best[direction], chosen[n, direction] = FARTHEST * shortest, NONE
            for m in range(candidates):
                x, y = cosine * step[m, 1] + sine * step[m, 2], cosine * step[m, 2] - sine * step[m, 1]
                if fabs(x) > fabs(y):
                    direction, off = 0 if x > 0 else 2, fabs(y)
                else:
                    direction, off = 1 if y > 0 else 3, fabs(x)
                if off < SINE_OFF_AXIS and step[m, 0] < best[direction]:
                    best[direction], chosen[n, direction] = step[m, 0], near[n, m]


def keep_mutual(
    chosen: cython.const[cython.longlong][:, ::1], neighbour: cython.longlong[:, ::1], turn: cython.longlong[:, ::1]
) -> cython.void:
    """`neighbour` (N, 4) <- those of `chosen` that both ends see, or -1; `turn` between the frames of the ends."""
    cython.declare(n=cython.Py_ssize_t, k=cython.Py_ssize_t, back=cython.Py_ssize_t)
    with cython.nogil:
        for n in range(chosen.shape[0]):
            for k in range(4):
                neighbour[n, k], turn[n, k] = NONE, 0
                other = chosen[n, k]
                if other < 0:
                    continue
                for back in range(4):
                    if chosen[other, back] == n:
                        neighbour[n, k], turn[n, k] = other, (back + 6 - k) % 4
                        break


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _fill_corner(
    neighbour: cython.const[cython.longlong][:, ::1],
    turn: cython.const[cython.longlong][:, ::1],
    n: cython.Py_ssize_t,
    first: cython.Py_ssize_t,
    then: cython.Py_ssize_t,
    corner: cython.Py_ssize_t,
    around: cython.longlong[:, ::1],
    turns: cython.longlong[:, ::1],
) -> cython.void:
    """The diagonal block that is reached by going `first`, `then`; if the other way leads elsewhere, it is neither."""
    side, side_turn = neighbour[n, first], turn[n, first]
    if side < 0:
        return
    direction = (then + side_turn) % 4
    there, there_turn = neighbour[side, direction], (side_turn + turn[side, direction]) % 4
    if there < 0:
        return
    if around[n, corner] >= 0 and (around[n, corner] != there or turns[n, corner] != there_turn):
        around[n, corner] = NONE
    else:
        around[n, corner], turns[n, corner] = there, there_turn


def fill_windows(
    neighbour: cython.const[cython.longlong][:, ::1],
    turn: cython.const[cython.longlong][:, ::1],
    around: cython.longlong[:, ::1],
    turns: cython.longlong[:, ::1],
) -> cython.void:
    """(N, 9) the blocks about each block and their turns, row by row; directions 0 1 2 3 are right, down, left, up.

    -1 and 0 at first. A diagonal block is reached over either side neighbour; where both ways exist they must agree.
    """
    cython.declare(n=cython.Py_ssize_t, k=cython.Py_ssize_t)
    with cython.nogil:
        for n in range(neighbour.shape[0]):
            around[n, 4] = n
            around[n, 5], around[n, 7], around[n, 3], around[n, 1] = (
                neighbour[n, 0], neighbour[n, 1], neighbour[n, 2], neighbour[n, 3]
            )  # fmt: skip
            turns[n, 5], turns[n, 7], turns[n, 3], turns[n, 1] = turn[n, 0], turn[n, 1], turn[n, 2], turn[n, 3]
            for k in range(4):
                corner = 8 if k == 0 else 6 if k == 1 else 0 if k == 2 else 2
                _fill_corner(neighbour, turn, n, k, (k + 1) % 4, corner, around, turns)
                _fill_corner(neighbour, turn, n, (k + 1) % 4, k, corner, around, turns)


def measure_links(
    centre: cython.const[cython.double][:, ::1],
    root: cython.const[cython.double][:, ::1],
    neighbour: cython.const[cython.longlong][:, ::1],
    turn: cython.const[cython.longlong][:, ::1],
    length: cython.double[:, ::1],
    bend: cython.double[:, ::1],
) -> cython.void:
    """Of each link (N, 4): `length` in standard deviations of the block it starts from, and `bend`, the lesser change
    to the link before or after it, over its length; NaN where there is none."""
    cython.declare(change=cython.double, far=cython.double, n=cython.Py_ssize_t, k=cython.Py_ssize_t)
    with cython.nogil:
        for n in range(centre.shape[0]):
            for k in range(4):
                length[n, k], bend[n, k] = NAN, NAN
                other = neighbour[n, k]
                if other < 0:
                    continue
                x, y = centre[other, 0] - centre[n, 0], centre[other, 1] - centre[n, 1]
                length[n, k] = _norm(root[n, 0] * x + root[n, 1] * y, root[n, 1] * x + root[n, 2] * y)
                change = INFINITY
                before, after = neighbour[n, (k + 2) % 4], neighbour[other, (k + turn[n, k]) % 4]
                if before >= 0:
                    change = _norm(x - centre[n, 0] + centre[before, 0], y - centre[n, 1] + centre[before, 1])
                if after >= 0:
                    far = _norm(x - centre[after, 0] + centre[other, 0], y - centre[after, 1] + centre[other, 1])
                    change = min(change, far)
                if isfinite(change):
                    bend[n, k] = change / _norm(x, y)


def gather_islands(
    neighbour: cython.const[cython.longlong][:, ::1],
    turn: cython.const[cython.longlong][:, ::1],
    at: cython.longlong[:, ::1],
    turned: cython.longlong[::1],
    member: cython.longlong[::1],
    first: cython.longlong[::1],
) -> cython.Py_ssize_t:
    """Linked blobs, with their `at` (N, 2), (row, column), and `turned` (N,), quarter turns, in their island's frame.

    -1 in `turned` at first, and of those that are linked to none. `member` <- them, one island after the other, of
    which k starts at `first` (N + 1,) k; returns how many islands there are.
    """
    cython.declare(root=cython.Py_ssize_t, k=cython.Py_ssize_t)
    islands: cython.Py_ssize_t = 0
    count: cython.Py_ssize_t = 0
    with cython.nogil:
        for root in range(neighbour.shape[0]):
            if turned[root] >= 0:
                continue
            if neighbour[root, 0] < 0 and neighbour[root, 1] < 0 and neighbour[root, 2] < 0 and neighbour[root, 3] < 0:
                continue
            at[root, 0], at[root, 1], turned[root] = 0, 0, 0
            first[islands], member[count] = count, root
            islands += 1
            taken: cython.Py_ssize_t = count
            count += 1
            while taken < count:
                blob = member[taken]
                taken += 1
                for k in range(4):
                    other = neighbour[blob, k]
                    if other < 0 or turned[other] >= 0:
                        continue
                    direction = (k + 4 - turned[blob]) % 4
                    at[other, 0] = at[blob, 0] + (1 if direction == 1 else -1 if direction == 3 else 0)
                    at[other, 1] = at[blob, 1] + (1 if direction == 0 else -1 if direction == 2 else 0)
                    turned[other] = (turned[blob] + turn[blob, k]) % 4
                    member[count] = other
                    count += 1
        first[islands] = count
    return islands
