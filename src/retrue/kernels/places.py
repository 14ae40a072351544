"""Places in the code of a grid: windows looked up, votes counted, neighbours that agree, small faces laid over it.

A place is one number, (row * columns + column) * 4 + rotation: where a block stands, and by how many quarter turns its
own frame is rotated against the code's. `around` and `turn` (N, 9) are the 3x3 window about each block in its own
frame, row by row, and the quarter turns to the frame of each of them; -1 is none.
"""

from __future__ import annotations

import cython
from cython.cimports.libc.math import exp, sqrt

NONE = cython.declare(cython.longlong, -1)
MIDDLE = cython.declare(cython.Py_ssize_t, 4)  # of a window
FAR = cython.declare(cython.double, 0.15)  # nats, for each block that an island lies from where the surface continues
FARTHEST = cython.declare(cython.double, 40.0)  # blocks, beyond which no island is looked for
LEAST_FREE = cython.declare(cython.double, 0.7)  # of the places that an island takes


@cython.cfunc
@cython.nogil
@cython.inline
@cython.exceptval(check=False)
def _beside(
    row: cython.longlong,
    column: cython.longlong,
    rotation: cython.longlong,
    member: cython.Py_ssize_t,
    turn: cython.longlong,
    rows: cython.longlong,
    columns: cython.longlong,
) -> cython.longlong:
    """Place of that `member` of the window about the block at (row, column), or -1 outside."""
    down: cython.longlong = member // 3 - 1
    right: cython.longlong = member % 3 - 1
    if rotation == 0:
        row, column = row + down, column + right
    elif rotation == 1:
        row, column = row + right, column - down
    elif rotation == 2:
        row, column = row - down, column - right
    else:
        row, column = row - right, column + down
    if not (0 <= row < rows and 0 <= column < columns):
        return NONE
    return (row * columns + column) * 4 + (rotation + 4 - turn) % 4


def look_up(
    around: cython.const[cython.longlong][:, ::1],
    label: cython.const[cython.longlong][::1],
    weight: cython.const[cython.longlong][::1],
    keys: cython.const[cython.longlong][::1],
    places: cython.const[cython.longlong][::1],
    place: cython.longlong[::1],
) -> cython.void:
    """`place` (N,) <- that of the key which each window's colours make; -1 where none fits, or one with weight lacks.

    `weight` (9,) makes a key of a window; `keys` are in order, `places` theirs.
    """
    cython.declare(known=cython.bint, n=cython.Py_ssize_t, member=cython.Py_ssize_t)
    with cython.nogil:
        count = keys.shape[0]
        for n in range(around.shape[0]):
            place[n] = NONE
            wanted: cython.longlong = 0
            known = count > 0
            for member in range(9):
                if weight[member] != 0:
                    if around[n, member] < 0:
                        known = False
                        break
                    wanted += weight[member] * label[around[n, member]]
            if not known:
                continue
            first: cython.Py_ssize_t = 0
            end: cython.Py_ssize_t = count
            while first < end:
                middle = (first + end) // 2
                if keys[middle] < wanted:
                    first = middle + 1
                else:
                    end = middle
            if first < count and keys[first] == wanted:
                place[n] = places[first]


def elect(
    colors: cython.const[cython.longlong][::1],
    rows: cython.Py_ssize_t,
    columns: cython.Py_ssize_t,
    around: cython.const[cython.longlong][:, ::1],
    turn: cython.const[cython.longlong][:, ::1],
    label: cython.const[cython.longlong][::1],
    place: cython.const[cython.longlong][::1],
    said: cython.const[cython.longlong][:, ::1],
    votes: cython.const[cython.longlong][::1],
    lead: cython.double,
    by_color: cython.bint,
    count: cython.longlong[:, ::1],
    elected: cython.longlong[::1],
) -> cython.void:
    """`elected` (N,), `place` at first: of blocks without one, <- the place that most windows give them.

    Window n says, `said` (V, N), where its middle stands; all its members are given `votes` (V,) for their places. A
    place needs two votes, and `lead` >= 1 times as many as all others together. `by_color`: one with the block's own
    colour. `count` (3, N), zeros at first, is room to count.

    Boyer and Moore: whoever has more than half of all votes is left, when votes for others cancel them out.
    """
    cython.declare(counting=cython.Py_ssize_t, n=cython.Py_ssize_t, v=cython.Py_ssize_t, member=cython.Py_ssize_t)
    with cython.nogil:
        for counting in range(2):
            for v in range(said.shape[0]):
                for n in range(place.shape[0]):
                    if said[v, n] < 0:
                        continue
                    block = said[v, n] // 4
                    row, column, rotation = block // columns, block % columns, said[v, n] % 4
                    for member in range(9):
                        there = around[n, member]
                        if there < 0 or place[there] >= 0:
                            continue
                        where = _beside(row, column, rotation, member, turn[n, member], rows, columns)
                        if where < 0 or (by_color and colors[where // 4] != label[there]):
                            continue
                        if counting:
                            count[1, there] += votes[v]
                            if where == elected[there]:
                                count[2, there] += votes[v]
                        elif where == elected[there]:
                            count[0, there] += votes[v]
                        else:
                            count[0, there] -= votes[v]
                            if count[0, there] < 0:
                                elected[there], count[0, there] = where, -count[0, there]
        for n in range(place.shape[0]):
            won, cast = count[2, n], count[1, n]
            if place[n] < 0 and not (won >= 2 and won > lead * (cast - won)):
                elected[n] = NONE


def keep_undisputed(
    colors: cython.const[cython.longlong][::1],
    rows: cython.Py_ssize_t,
    columns: cython.Py_ssize_t,
    around: cython.const[cython.longlong][:, ::1],
    turn: cython.const[cython.longlong][:, ::1],
    label: cython.const[cython.longlong][::1],
    place: cython.const[cython.longlong][::1],
    kept: cython.longlong[::1],
) -> cython.void:
    """`kept` (N,) <- the places that stand against a minority of the neighbours, or -1.

    One of a colour that is not the code's stands against half as many.
    """
    cython.declare(n=cython.Py_ssize_t, member=cython.Py_ssize_t)
    with cython.nogil:
        for n in range(place.shape[0]):
            kept[n] = NONE
            if place[n] < 0:
                continue
            block = place[n] // 4
            row, column, rotation = block // columns, block % columns, place[n] % 4
            agree, against = 0, 0
            for member in range(9):
                there = around[n, member]
                if member != MIDDLE and there >= 0 and place[there] >= 0:
                    if place[there] == _beside(row, column, rotation, member, turn[n, member], rows, columns):
                        agree += 1
                    else:
                        against += 1
            if agree > (1 if label[n] == colors[place[n] // 4] else 2) * against:
                kept[n] = place[n]


def count_neighbours(
    colors: cython.const[cython.longlong][::1],
    rows: cython.Py_ssize_t,
    columns: cython.Py_ssize_t,
    around: cython.const[cython.longlong][:, ::1],
    turn: cython.const[cython.longlong][:, ::1],
    label: cython.const[cython.longlong][::1],
    clear: cython.const[cython.uchar][::1],
    place: cython.const[cython.longlong][::1],
    agreeing: cython.longlong[::1],
    contradicting: cython.longlong[::1],
) -> cython.void:
    """How many of the eight neighbours of each block (N,) stand where it says and have the colour that the code has
    there; and how many are `clear`ly of another colour, wherever they stand."""
    cython.declare(n=cython.Py_ssize_t, member=cython.Py_ssize_t)
    with cython.nogil:
        for n in range(place.shape[0]):
            agreeing[n], contradicting[n] = 0, 0
            if place[n] < 0:
                continue
            block = place[n] // 4
            row, column, rotation = block // columns, block % columns, place[n] % 4
            for member in range(9):
                there = around[n, member]
                if member == MIDDLE or there < 0:
                    continue
                expected = _beside(row, column, rotation, member, turn[n, member], rows, columns)
                if expected < 0:
                    continue
                if label[there] != colors[expected // 4]:
                    if clear[there]:
                        contradicting[n] += 1
                elif place[there] == expected:
                    agreeing[n] += 1


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _join(surface: cython.longlong[::1], a: cython.longlong, b: cython.longlong) -> cython.void:
    """Two that are linked; each `surface` leads to the first of all that are."""
    while surface[a] != a:
        surface[a] = surface[surface[a]]
        a = surface[a]
    while surface[b] != b:
        surface[b] = surface[surface[b]]
        b = surface[b]
    surface[max(a, b)] = min(a, b)


def join_agreeing(
    around: cython.const[cython.longlong][:, ::1],
    turn: cython.const[cython.longlong][:, ::1],
    place: cython.const[cython.longlong][::1],
    rows: cython.Py_ssize_t,
    columns: cython.Py_ssize_t,
    surface: cython.longlong[::1],
) -> cython.void:
    """`surface` (N,) <- one number for all blocks that stand where their neighbours say."""
    cython.declare(n=cython.Py_ssize_t, member=cython.Py_ssize_t)
    with cython.nogil:
        for n in range(place.shape[0]):
            surface[n] = n
        for n in range(place.shape[0]):
            if place[n] < 0:
                continue
            block = place[n] // 4
            row, column, rotation = block // columns, block % columns, place[n] % 4
            for member in range(9):
                there = around[n, member]
                if member == MIDDLE or there < 0 or place[there] < 0:
                    continue
                if place[there] == _beside(row, column, rotation, member, turn[n, member], rows, columns):
                    _join(surface, n, there)
        for n in range(place.shape[0]):
            surface[n] = surface[surface[n]]


def link_blocks(
    neighbour: cython.const[cython.longlong][:, ::1],
    place: cython.const[cython.longlong][::1],
    holder: cython.const[cython.longlong][:, ::1],
    right: cython.uchar[:, ::1],
    down: cython.uchar[:, ::1],
) -> cython.void:
    """`right`, `down` <- which blocks of the code hold, `holder` or -1, blobs that are neighbours there, too."""
    cython.declare(r=cython.Py_ssize_t, c=cython.Py_ssize_t)
    rows, columns = holder.shape[0], holder.shape[1]
    with cython.nogil:
        for r in range(rows):
            for c in range(columns):
                blob = holder[r, c]
                if c < columns - 1:
                    right[r, c] = blob >= 0 and _is_neighbour(neighbour, place, blob, 0, holder[r, c + 1])
                if r < rows - 1:
                    down[r, c] = blob >= 0 and _is_neighbour(neighbour, place, blob, 1, holder[r + 1, c])


@cython.cfunc
@cython.nogil
@cython.inline
@cython.exceptval(check=False)
def _is_neighbour(
    neighbour: cython.const[cython.longlong][:, ::1],
    place: cython.const[cython.longlong][::1],
    blob: cython.longlong,
    direction: cython.longlong,
    other: cython.longlong,
) -> cython.bint:
    """Whether `other` is the neighbour of `blob` in that direction of the code."""
    return other >= 0 and neighbour[blob, (direction + 4 - place[blob] % 4) % 4] == other


def join_linked(
    right: cython.const[cython.uchar][:, :], down: cython.const[cython.uchar][:, :], surface: cython.longlong[::1]
) -> cython.void:
    """The same (rows columns,) of all places of the code that joints to the right and down hold together."""
    cython.declare(n=cython.Py_ssize_t, r=cython.Py_ssize_t, c=cython.Py_ssize_t)
    with cython.nogil:
        rows, columns = right.shape[0], down.shape[1]
        for n in range(surface.shape[0]):
            surface[n] = n
        for r in range(rows):
            for c in range(columns):
                if c < columns - 1 and right[r, c]:
                    _join(surface, r * columns + c, r * columns + c + 1)
                if r < rows - 1 and down[r, c]:
                    _join(surface, r * columns + c, (r + 1) * columns + c)
        for n in range(surface.shape[0]):
            surface[n] = surface[surface[n]]


def lay_island(
    free: cython.const[cython.uchar][:, ::1],
    colors: cython.const[cython.longlong][:, ::1],
    match: cython.double,
    offset: cython.const[cython.longlong][:, ::1],
    label: cython.const[cython.longlong][::1],
    misread: cython.const[cython.double][::1],
    continued: cython.const[cython.double][::1],
    where: cython.longlong[::1],
    nats: cython.double[::1],
) -> cython.double:
    """Lay blobs of `offset` (K, 2) and `label` (K,) wherever most of the places are free.

    `nats` (2,), -inf at first, <- of the best way and of the second: `match` for each blob of the code's colour,
    `misread` (K,) for the others; `where` (2,) <- (row, column) to add to the offsets of the best. A way is unlikely
    when it is far from where the surface beside is `continued` to the middle of the blobs; returned is the sum of these
    likelihoods, which is how many ways there are.
    """
    cython.declare(k=cython.Py_ssize_t, r=cython.Py_ssize_t, c=cython.Py_ssize_t)
    with cython.nogil:
        blobs = offset.shape[0]
        top, bottom, left, right, down, along = offset[0, 0], offset[0, 0], offset[0, 1], offset[0, 1], 0.0, 0.0
        for k in range(blobs):
            top, bottom = min(top, offset[k, 0]), max(bottom, offset[k, 0])
            left, right = min(left, offset[k, 1]), max(right, offset[k, 1])
            down, along = (
                down + cython.cast(cython.double, offset[k, 0]) / blobs,
                along + cython.cast(cython.double, offset[k, 1]) / blobs,
            )
        ways = 0.0
        for r in range(-top, free.shape[0] - bottom):
            for c in range(-left, free.shape[1] - right):
                dr, dc = r + down - continued[0], c + along - continued[1]
                distance = sqrt(dr * dr + dc * dc)
                if not distance < FARTHEST:
                    continue
                open_places = 0.0
                for k in range(blobs):
                    open_places += free[r + offset[k, 0], c + offset[k, 1]]
                if not open_places / blobs > LEAST_FREE:
                    continue
                score = -FAR * distance
                for k in range(blobs):
                    i, j = r + offset[k, 0], c + offset[k, 1]
                    score += match if free[i, j] and colors[i, j] == label[k] else misread[k]
                ways += exp(-FAR * distance)
                if score > nats[0]:
                    nats[1], nats[0], where[0], where[1] = nats[0], score, r, c
                elif score > nats[1]:
                    nats[1] = score
    return ways
