"""Points that a shift, or a step in space, puts where a plane has others: what each asks for, and what most do."""

from __future__ import annotations

import cython
from cython.cimports.libc.math import atan2, fabs, hypot, log

INFINITY = cython.declare(cython.double, float("inf"))
WIDER = cython.declare(cython.double, 1.001)  # than the reach, a strip is: rounding leaves nothing beyond the next
SMALLEST = cython.declare(cython.double, 1e-300)
NAN = cython.declare(cython.double, float("nan"))
# Rows of what `shifts` finds, behind four of pixels.
FORTH = cython.declare(cython.Py_ssize_t, 4)
WEIGHT = cython.declare(cython.Py_ssize_t, 7)
LENGTH = cython.declare(cython.Py_ssize_t, 9)
ANGLE = cython.declare(cython.Py_ssize_t, 10)
GAP = cython.declare(cython.Py_ssize_t, 12)
ROUGH = cython.declare(cython.double, 0.1)  # of a step, by which perspective makes it differ at first
STEPPED = cython.declare(cython.Py_ssize_t, 8)  # fits of it
MOST_MODES = cython.declare(cython.Py_ssize_t, 3)
PARALLEL = cython.declare(cython.double, 1e-10)  # of the squares: what parallel lines tell of a shift along them


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _within_reach_of_mode(
    xs: cython.const[cython.double][::1],
    ys: cython.const[cython.double][::1],
    places: cython.Py_ssize_t,
    every: cython.Py_ssize_t,
    reach: cython.double,
    starts: cython.longlong[::1],
    sorted_places: cython.double[:, ::1],
    members: cython.uchar[::1],
) -> cython.void:
    """`members` (N,) <- which of the first so many places lie within reach, along both axes, of that with most there.

    One of every so many is asked; of those that have as many, the first is it. Those near each are looked for in three
    of C strips of the first axis, wider than the reach; `starts` (C + 2,) and `sorted_places` (2, N) are room for them.
    """
    cython.declare(i=cython.Py_ssize_t, k=cython.Py_ssize_t, strip=cython.Py_ssize_t, place=cython.Py_ssize_t)
    count: cython.int
    best: cython.Py_ssize_t = 0
    most: cython.int = -1
    strips: cython.Py_ssize_t = starts.shape[0] - 2
    low, high = INFINITY, -INFINITY
    for k in range(places):
        x = xs[k]
        if fabs(x) < INFINITY:
            low, high = min(low, x), max(high, x)
    width = max(WIDER * reach, (high - low) / (strips - 1), SMALLEST)
    for strip in range(strips + 2):
        starts[strip] = 0
    for k in range(places):
        if fabs(xs[k]) < INFINITY:
            starts[cython.cast(cython.Py_ssize_t, (xs[k] - low) / width) + 2] += 1
    for strip in range(2, strips + 2):
        starts[strip] += starts[strip - 1]
    for k in range(places):  # behind each strip's start, that of the next one
        if fabs(xs[k]) < INFINITY:
            strip = cython.cast(cython.Py_ssize_t, (xs[k] - low) / width) + 1
            place = starts[strip]
            sorted_places[0, place], sorted_places[1, place] = xs[k], ys[k]
            starts[strip] += 1
    i = 0
    while i < places:  # a range of unknown step would count in Python's numbers
        x, y, count = xs[i], ys[i], 0
        if fabs(x) < INFINITY:
            strip = cython.cast(cython.Py_ssize_t, (x - low) / width)
            for k in range(starts[max(strip - 1, 0)], starts[min(strip + 2, strips)]):
                count += (fabs(sorted_places[0, k] - x) < reach) & (fabs(sorted_places[1, k] - y) < reach)
        if count > most:
            most, best = count, i
        i += every
    if most >= 0:
        x, y = xs[best], ys[best]
        for k in range(places):
            members[k] = (fabs(xs[k] - x) < reach) & (fabs(ys[k] - y) < reach)


def through_planes(
    rows: cython.const[cython.longlong][::1],
    camera_rays: cython.const[cython.double][:, ::1],
    projector_rays: cython.const[cython.double][:, ::1],
    R: cython.const[cython.double][:, ::1],
    t: cython.const[cython.double][::1],
    planes: cython.const[cython.double][:, ::1],
    bends: cython.const[cython.double][:, ::1],
    forth: cython.double[:, :, ::1],
    back: cython.double[:, :, ::1],
) -> None:
    """`forth`, `back` (P, rows, 3) <- where the projector has what the camera sees on planes (P, 3), and the camera
    what the projector does: H = R + (1 + b) t n^T, and H^-1 = (I - (1 + b) t n^T / (1 + (1 + b) n t)) R^T.

    `bends` (P, 14) tell the share b of its disparity by which each is bowed at a ray of the camera: centre and scale of
    rays, and what each of ten monomials of those counts, in the order of `bows.bend_of`.
    """
    cython.declare(k=cython.Py_ssize_t, p=cython.Py_ssize_t, row=cython.Py_ssize_t, j=cython.Py_ssize_t)
    with cython.nogil:
        tx = R[0, 0] * t[0] + R[1, 0] * t[1] + R[2, 0] * t[2]
        ty = R[0, 1] * t[0] + R[1, 1] * t[1] + R[2, 1] * t[2]
        tz = R[0, 2] * t[0] + R[1, 2] * t[1] + R[2, 2] * t[2]
        for p in range(planes.shape[0]):
            nt = planes[p, 0] * tx + planes[p, 1] * ty + planes[p, 2] * tz
            for k in range(rows.shape[0]):
                row = rows[k]
                x, y = camera_rays[row, 0], camera_rays[row, 1]
                u, v = (x - bends[p, 0]) / bends[p, 2], (y - bends[p, 1]) / bends[p, 3]
                uu, uv, vv = u * u, u * v, v * v
                bend = bends[p, 4] + bends[p, 5] * u + bends[p, 6] * v
                bend += bends[p, 7] * uu + bends[p, 8] * uv + bends[p, 9] * vv
                bend += bends[p, 10] * u * uu + bends[p, 11] * u * uv + bends[p, 12] * u * vv + bends[p, 13] * v * vv
                along = (1 + bend) * (planes[p, 0] * x + planes[p, 1] * y + planes[p, 2])
                for j in range(3):
                    forth[p, k, j] = R[j, 0] * x + R[j, 1] * y + R[j, 2] + along * t[j]
                x, y = projector_rays[row, 0], projector_rays[row, 1]
                rx = R[0, 0] * x + R[1, 0] * y + R[2, 0]
                ry = R[0, 1] * x + R[1, 1] * y + R[2, 1]
                rz = R[0, 2] * x + R[1, 2] * y + R[2, 2]
                along = planes[p, 0] * rx + planes[p, 1] * ry + planes[p, 2] * rz
                along = (1 + bend) * along / (1 + (1 + bend) * nt)
                back[p, k, 0], back[p, k, 1], back[p, k, 2] = rx - along * tx, ry - along * ty, rz - along * tz


def shifts(
    rows: cython.const[cython.longlong][::1],
    camera_rays: cython.const[cython.double][:, ::1],
    projector_rays: cython.const[cython.double][:, ::1],
    camera_px: cython.const[cython.double][:, ::1],
    projector_px: cython.const[cython.double][:, ::1],
    planes: cython.const[cython.double][:, ::1],
    forth: cython.const[cython.double][:, :, ::1],
    seen: cython.const[cython.double][:, :, :, ::1],
    found: cython.double[:, :, ::1],
) -> None:
    """`found` (P, 4 or 13, rows) <- how each point differs from what planes (P, 3) make of it.

    First its pixels less those that the projector and the camera have `seen` (2, P, rows, 2). Where steps are asked
    for, `forth` h (P, rows, 3), as `through_planes` has it, and of the step p across the view that puts a point where
    it is, y ~ h + w p: w for either axis, plus or minus its inverse depth, such that p leads up that axis; the log of
    the length of p, and its angle to either axis; and the larger of both components of y - h.
    """
    cython.declare(k=cython.Py_ssize_t, p=cython.Py_ssize_t, row=cython.Py_ssize_t, axis=cython.Py_ssize_t)
    with cython.nogil:
        for p in range(planes.shape[0]):
            for k in range(rows.shape[0]):
                row = rows[k]
                for axis in range(2):
                    found[p, axis, k] = projector_px[row, axis] - seen[0, p, k, axis]
                    found[p, 2 + axis, k] = camera_px[row, axis] - seen[1, p, k, axis]
                if found.shape[1] == 4:
                    continue
                for axis in range(3):
                    found[p, FORTH + axis, k] = forth[p, k, axis]
                inverse_depth = planes[p, 0] * camera_rays[row, 0] + planes[p, 1] * camera_rays[row, 1] + planes[p, 2]
                depth = forth[p, k, 2]
                x, y = projector_rays[row, 0] - forth[p, k, 0] / depth, projector_rays[row, 1] - forth[p, k, 1] / depth
                found[p, GAP, k] = max(fabs(x), fabs(y)) if x == x and y == y else NAN
                found[p, LENGTH, k] = log(hypot(x, y) * fabs(depth / inverse_depth) + SMALLEST)
                for axis in range(2):
                    along, aside = (x, y) if axis == 0 else (y, x)
                    w = -inverse_depth if along < 0 else inverse_depth
                    scale = depth / w
                    found[p, WEIGHT + axis, k] = w
                    found[p, ANGLE + axis, k] = atan2(aside * scale, along * scale)


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _median(values: cython.double[::1], count: cython.Py_ssize_t) -> cython.double:
    """Of the first `count`, which it orders; zero of nothing."""
    cython.declare(i=cython.Py_ssize_t, j=cython.Py_ssize_t)
    if count == 0:
        return 0.0
    place: cython.Py_ssize_t = (count - 1) // 2
    low: cython.Py_ssize_t = 0
    high: cython.Py_ssize_t = count - 1
    while low < high:  # Hoare's selection
        pivot = values[(low + high) // 2]
        i, j = low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while pivot < values[j]:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i, j = i + 1, j - 1
        if place <= j:
            high = j
        elif place >= i:
            low = i
        else:
            break
    below = values[place]
    if count % 2 == 1:
        return below
    above = values[place + 1]
    for i in range(place + 2, count):
        above = min(above, values[i])
    return below + 0.5 * (above - below) if below < above else below


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _of_one_step(
    places: cython.const[cython.double][:, ::1],
    forth: cython.const[cython.double][:, ::1],
    weights: cython.const[cython.double][::1],
    noise: cython.double,
    members: cython.uchar[::1],
    missed: cython.double[:, ::1],
    room: cython.double[::1],
) -> cython.void:
    """`members` (N,) <- which places (2, N) lie where forth + w p does, (3, N) and (N,), for the p of most of them.

    p is linear least squares of them; those that miss by more than the noise, and than half of them do, leave, fit by
    fit. `missed` (N, 2) <- by how much each does. Fewer than three tell no p, and then no place is one.
    """
    cython.declare(n=cython.Py_ssize_t, count=cython.Py_ssize_t)
    w2: cython.double
    near: cython.bint
    changed: cython.bint
    told: cython.bint = False
    for _ in range(STEPPED):
        count = 0
        ww, wx, wy, wr, bx, by, br = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for n in range(weights.shape[0]):
            if members[n]:
                x, y, w = places[0, n], places[1, n], weights[n]
                right, down = x * forth[2, n] - forth[0, n], y * forth[2, n] - forth[1, n]
                w2, count = w * w, count + 1
                ww, wx, wy, wr = ww + w2, wx - x * w2, wy - y * w2, wr + (x * x + y * y) * w2
                bx, by, br = bx + w * right, by + w * down, br - w * (x * right + y * down)
        told = (count >= 3) & (ww > 0)
        if not told:
            break
        left = wr - (wx * wx + wy * wy) / ww
        ahead = (br - (wx * bx + wy * by) / ww) / left if left > 1e-12 * wr else 0.0
        right, down = (bx - wx * ahead) / ww, (by - wy * ahead) / ww
        count = 0
        for n in range(weights.shape[0]):
            w = weights[n]
            nearness = 1 / (forth[2, n] + w * ahead)
            missed[n, 0] = places[0, n] - (forth[0, n] + w * right) * nearness
            missed[n, 1] = places[1, n] - (forth[1, n] + w * down) * nearness
            if members[n]:
                far = max(fabs(missed[n, 0]), fabs(missed[n, 1]))
                room[count] = far if far < INFINITY else INFINITY
                count += 1
        reach = max(noise, _median(room, count))
        changed = False
        for n in range(weights.shape[0]):
            near = (fabs(missed[n, 0]) < reach) & (fabs(missed[n, 1]) < reach)
            changed |= near != members[n]
            members[n] = near
        if not changed:
            break
    for n in range(weights.shape[0]):
        members[n] = told & (fabs(missed[n, 0]) < noise) & (fabs(missed[n, 1]) < noise)


def of_steps(
    places: cython.const[cython.double][:, ::1],
    seen: cython.const[cython.double][:, :, ::1],
    noise: cython.double,
    centres: cython.Py_ssize_t,
    fewest: cython.Py_ssize_t,
    starts: cython.longlong[::1],
    room: cython.double[:, ::1],
    near: cython.uchar[:, ::1],
    off: cython.double[:, ::1],
    members: cython.uchar[:, :, ::1],
    missed: cython.double[:, :, :, ::1],
    counts: cython.longlong[:, ::1],
) -> None:
    """`members` (P, 2+, N) <- which places (2, N) lie one step p from where each plane has them, y ~ h + w p, up either
    axis, and not within the noise where it has them: the most that do, of three modes that are asked.

    Of P planes and N points as `shifts` has `seen` them. `missed` (P, 2+, N, 2) <- by how much each does, and `counts`
    (P, 2+) how many they are. A mode is found from some `centres`, and fewer than the `fewest` points are none.
    `starts` (C + 2,), `room` (4, N), `near` (3, N) and `off` (N, 2) are room.
    """
    cython.declare(k=cython.Py_ssize_t, p=cython.Py_ssize_t, axis=cython.Py_ssize_t, number=cython.Py_ssize_t)
    cython.declare(count=cython.Py_ssize_t, rough=cython.Py_ssize_t)
    with cython.nogil:
        asked, among, mode = near[0], near[1], near[2]
        for p in range(seen.shape[0]):
            for axis in range(2):
                counts[p, axis] = 0
                for k in range(places.shape[1]):
                    asked[k], members[p, axis, k] = seen[p, GAP, k] > noise, 0
                for _ in range(MOST_MODES):
                    count, rough = 0, 0
                    for k in range(places.shape[1]):
                        room[0, count], room[1, count] = seen[p, LENGTH, k], seen[p, ANGLE + axis, k]
                        count += asked[k]
                    _within_reach_of_mode(
                        room[0], room[1], count, max(1, count // centres), ROUGH, starts, room[2:], among
                    )
                    for k in range(count):
                        rough += among[k]
                    if rough < fewest:
                        break
                    count = 0
                    for k in range(places.shape[1]):
                        mode[k] = 0
                        if asked[k]:
                            mode[k] = among[count]
                            asked[k] = not among[count]
                            count += 1
                    _of_one_step(places, seen[p, FORTH : FORTH + 3], seen[p, WEIGHT + axis], noise, mode, off, room[0])
                    number = 0
                    for k in range(places.shape[1]):
                        mode[k] = mode[k] & (seen[p, GAP, k] > noise)
                        number += mode[k]
                    if number > counts[p, axis]:
                        counts[p, axis] = number
                        for k in range(places.shape[1]):
                            members[p, axis, k] = mode[k]
                            missed[p, axis, k, 0], missed[p, axis, k, 1] = off[k, 0], off[k, 1]


def of_shifts(
    seen: cython.const[cython.double][:, :, ::1],
    noise: cython.double,
    focals: cython.const[cython.double][::1],
    centres: cython.Py_ssize_t,
    starts: cython.longlong[::1],
    room: cython.double[:, ::1],
    members: cython.uchar[:, :, ::1],
    missed: cython.double[:, :, :, ::1],
    counts: cython.longlong[:, ::1],
) -> None:
    """The same of one shift in the pixels of projector or camera, of `focals` (2,): those within the noise of the one
    that has most there, in `members` (P, 4, N) behind those of steps.

    Where they are not shifted by more than the noise, they lie where the plane has them: none is a copy.
    """
    cython.declare(k=cython.Py_ssize_t, p=cython.Py_ssize_t, device=cython.Py_ssize_t, count=cython.Py_ssize_t)
    with cython.nogil:
        for p in range(seen.shape[0]):
            for device in range(2):
                x, y, mode = seen[p, 2 * device], seen[p, 2 * device + 1], members[p, 2 + device]
                focal, points = focals[device], x.shape[0]
                reach = noise * focal
                _within_reach_of_mode(x, y, points, max(1, points // centres), reach, starts, room[2:], mode)
                count = 0
                for k in range(points):
                    room[0, count], room[1, count] = x[k], y[k]
                    count += mode[k]
                right, down = _median(room[0], count), _median(room[1], count)
                counts[p, 2 + device] = count if max(fabs(right), fabs(down)) > reach else 0
                for k in range(points):
                    missed[p, 2 + device, k, 0] = (x[k] - right) / focal
                    missed[p, 2 + device, k, 1] = (y[k] - down) / focal


def shift_of_most(
    gradient: cython.const[cython.double][:, ::1],
    missed: cython.const[cython.double][::1],
    drawn: cython.const[cython.longlong][::1],
    reach: cython.double,
    shift: cython.double[::1],
) -> cython.longlong:
    """`shift` (2,) <- of those that two drawn rows ask for, the first that most agree with; how many do.

    Rows n agree with d where missed (N,) is gradient (2, N) d to within reach. Two ask for the smallest d that is so of
    both: (A^T A + e I)^-1 A^T (r, s), e only where the gradients are parallel.
    """
    cython.declare(i=cython.Py_ssize_t, j=cython.Py_ssize_t, k=cython.Py_ssize_t, count=cython.longlong)
    most: cython.longlong = -1
    shift[0], shift[1] = NAN, NAN
    with cython.nogil:
        for i in range(drawn.shape[0]):
            for j in range(i + 1, drawn.shape[0]):
                ax, ay, r = gradient[0, drawn[i]], gradient[1, drawn[i]], missed[drawn[i]]
                bx, by, s = gradient[0, drawn[j]], gradient[1, drawn[j]], missed[drawn[j]]
                xx, xy, yy = ax * ax + bx * bx, ax * ay + bx * by, ay * ay + by * by
                least = PARALLEL * (xx + yy) + SMALLEST
                right, down = ax * r + bx * s, ay * r + by * s
                xx, yy = xx + least, yy + least
                inverse = xx * yy - xy * xy
                x, y = (yy * right - xy * down) / inverse, (xx * down - xy * right) / inverse
                count = 0
                for k in range(missed.shape[0]):
                    count += fabs(missed[k] - (x * gradient[0, k] + y * gradient[1, k])) < reach
                if count > most:
                    most, shift[0], shift[1] = count, x, y
    return most
