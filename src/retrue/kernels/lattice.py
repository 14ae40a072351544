"""What blocks on one surface say about each other: slopes, lines of three, steps and sides that are alike.

Arrays are (rows, columns, ...) of the code, NaN where no block is. `right` (rows, columns - 1) and `down` (rows - 1,
columns) are the joints: whether a block hangs together with the next one of its row, of its column."""

from __future__ import annotations

import cython
from cython.cimports.libc.math import fabs, hypot, isfinite, sqrt

STEP_CHANGE = cython.declare(cython.double, 0.25)  # of a step, to the most similar one about it, on one surface
SIDE_CHANGE = cython.declare(cython.double, 1.15)  # of a block, from its neighbours on one surface,
PIXELS_CHANGE = cython.declare(cython.double, 1.0)  # and that many px / its side
DIRECTIONS = cython.declare(cython.Py_ssize_t, 4)  # of lines: along rows, columns, and both diagonals
BEND_GAIN = cython.declare(cython.double, 4.375)  # variance of x[-2]/4 - x[-1] + 3/2 x[0] - x[1] + x[2]/4, over x's
END_GAIN = cython.declare(cython.double, 5.0)  # the same of x[-1]/2 - 3/2 x[0] + 3/2 x[1] - x[2]/2
NAN = cython.declare(cython.double, float("nan"))
INFINITY = cython.declare(cython.double, float("inf"))

Vector = cython.struct(x=cython.double, y=cython.double)


@cython.cfunc
@cython.nogil
@cython.inline
@cython.exceptval(check=False)
def _joined(linked: cython.const[cython.uchar][:, :], r: cython.Py_ssize_t, c: cython.Py_ssize_t) -> cython.bint:
    """Whether that joint holds; none does outside."""
    return 0 <= r < linked.shape[0] and 0 <= c < linked.shape[1] and linked[r, c] != 0


@cython.cfunc
@cython.nogil
@cython.inline
@cython.exceptval(check=False)
def _step(
    position: cython.const[cython.double][:, :, ::1],
    linked: cython.const[cython.uchar][:, :],
    r: cython.Py_ssize_t,
    c: cython.Py_ssize_t,
    down: cython.Py_ssize_t,
    right: cython.Py_ssize_t,
) -> Vector:
    """From (r, c) to the block at (down, right) of it; NaN where they are not linked."""
    if not _joined(linked, r, c):
        return Vector(NAN, NAN)
    return Vector(
        position[r + down, c + right, 0] - position[r, c, 0], position[r + down, c + right, 1] - position[r, c, 1]
    )


@cython.cfunc
@cython.nogil
@cython.inline
@cython.exceptval(check=False)
def _mean_step(ahead: Vector, behind: Vector) -> Vector:
    """The mean of both steps, or the one that there is."""
    if not isfinite(ahead.x):
        return behind
    if not isfinite(behind.x):
        return ahead
    return Vector((ahead.x + behind.x) / 2, (ahead.y + behind.y) / 2)


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _borrowed_slope(
    position: cython.const[cython.double][:, :, ::1],
    joints_right: cython.const[cython.uchar][:, :],
    joints_down: cython.const[cython.uchar][:, :],
    r: cython.Py_ssize_t,
    c: cython.Py_ssize_t,
    along_rows: cython.bint,
) -> Vector:
    """The mean of what the linked neighbours of (r, c) have."""
    side: cython.Py_ssize_t
    x, y, count = 0.0, 0.0, 0.0
    for side in range(4):
        i, j = r, c
        if side == 0:
            linked, j = _joined(joints_right, r, c), c + 1
        elif side == 1:
            linked, j = _joined(joints_right, r, c - 1), c - 1
        elif side == 2:
            linked, i = _joined(joints_down, r, c), r + 1
        else:
            linked, i = _joined(joints_down, r - 1, c), r - 1
        if linked:
            if along_rows:
                ahead, behind = _step(position, joints_right, i, j, 0, 1), _step(position, joints_right, i, j - 1, 0, 1)
            else:
                ahead, behind = _step(position, joints_down, i, j, 1, 0), _step(position, joints_down, i - 1, j, 1, 0)
            slope = _mean_step(ahead, behind)
            if isfinite(slope.x):
                x += slope.x
                y += slope.y
                count += 1
    return Vector(x / count, y / count) if count > 0 else Vector(NAN, NAN)


def slopes(
    position: cython.const[cython.double][:, :, ::1],
    right: cython.const[cython.uchar][:, :],
    down: cython.const[cython.uchar][:, :],
    u: cython.double[:, :, ::1],
    v: cython.double[:, :, ::1],
) -> cython.void:
    """`u`, `v` <- d position / d column, d position / d row.

    One-sided at the ends of a surface; where a block has no neighbour in a direction, as its other neighbours have it.
    """
    cython.declare(r=cython.Py_ssize_t, c=cython.Py_ssize_t)
    with cython.nogil:
        for r in range(position.shape[0]):
            for c in range(position.shape[1]):
                here = isfinite(position[r, c, 0])
                slope = _mean_step(_step(position, right, r, c, 0, 1), _step(position, right, r, c - 1, 0, 1))
                if here and not isfinite(slope.x):
                    slope = _borrowed_slope(position, right, down, r, c, True)
                u[r, c, 0], u[r, c, 1] = slope.x, slope.y
                slope = _mean_step(_step(position, down, r, c, 1, 0), _step(position, down, r - 1, c, 1, 0))
                if here and not isfinite(slope.x):
                    slope = _borrowed_slope(position, right, down, r, c, False)
                v[r, c, 0], v[r, c, 1] = slope.x, slope.y


@cython.cfunc
@cython.nogil
@cython.inline
@cython.exceptval(check=False)
def _alike(
    position: cython.const[cython.double][:, :, ::1],
    linked: cython.const[cython.uchar][:, :],
    r: cython.Py_ssize_t,
    c: cython.Py_ssize_t,
    down: cython.Py_ssize_t,
    right: cython.Py_ssize_t,
) -> cython.bint:
    """Whether the step from (r, c) to (down, right) is like the one beside, before or after it."""
    side: cython.Py_ssize_t
    if not _joined(linked, r, c):
        return False
    step = _step(position, linked, r, c, down, right)
    for side in range(4):
        i = r + 1 if side == 2 else r - 1 if side == 3 else r
        j = c + 1 if side == 0 else c - 1 if side == 1 else c
        other = _step(position, linked, i, j, down, right)
        x, y = other.x - step.x, other.y - step.y
        if x * x + y * y < STEP_CHANGE * STEP_CHANGE * (step.x * step.x + step.y * step.y):
            return True
    return False


def alike_steps(
    position: cython.const[cython.double][:, :, ::1],
    right: cython.const[cython.uchar][:, :],
    down: cython.const[cython.uchar][:, :],
    alike_right: cython.uchar[:, ::1],
    alike_down: cython.uchar[:, ::1],
) -> cython.void:
    """The joints whose step is like another one: of the next row or column, or before or after it in its own."""
    cython.declare(r=cython.Py_ssize_t, c=cython.Py_ssize_t)
    with cython.nogil:
        for r in range(right.shape[0]):
            for c in range(right.shape[1]):
                alike_right[r, c] = _alike(position, right, r, c, 0, 1)
        for r in range(down.shape[0]):
            for c in range(down.shape[1]):
                alike_down[r, c] = _alike(position, down, r, c, 1, 0)


def measure_sides(
    shape: cython.const[cython.double][:, :, ::1],
    u: cython.const[cython.double][:, :, ::1],
    v: cython.const[cython.double][:, :, ::1],
    side: cython.double[:, :, ::1],
) -> cython.void:
    """`side` (rows, columns, 2) <- standard deviation of each block along its row and column, in steps of the grid.

    `shape` (rows, columns, 4) are the second moments M of the blocks; in grid units, J^-1 M J^-T with J the steps.
    """
    cython.declare(r=cython.Py_ssize_t, c=cython.Py_ssize_t)
    with cython.nogil:
        for r in range(shape.shape[0]):
            for c in range(shape.shape[1]):
                ux, uy, vx, vy = u[r, c, 0], u[r, c, 1], v[r, c, 0], v[r, c, 1]
                xx, xy, yy = shape[r, c, 0], shape[r, c, 1], shape[r, c, 3]
                size = fabs(ux * vy - uy * vx)
                along = vy * vy * xx - 2 * vx * vy * xy + vx * vx * yy
                across = uy * uy * xx - 2 * ux * uy * xy + ux * ux * yy
                if size > 0 and along >= 0 and across >= 0:
                    side[r, c, 0], side[r, c, 1] = sqrt(along) / size, sqrt(across) / size
                else:
                    side[r, c, 0], side[r, c, 1] = NAN, NAN


def compare_sides(
    side: cython.const[cython.double][:, :, ::1],
    usual: cython.const[cython.double][::1],
    u: cython.const[cython.double][:, :, ::1],
    v: cython.const[cython.double][:, :, ::1],
    right: cython.const[cython.uchar][:, :],
    down: cython.const[cython.uchar][:, :],
    alike: cython.uchar[:, ::1],
) -> cython.void:
    """`alike` is cleared where a block's sides are not those of its linked neighbours, or the `usual` ones for lack."""
    cython.declare(
        total=cython.double, least=cython.double, most=cython.double, other=cython.double, like=cython.double
    )
    cython.declare(change=cython.double, linked=cython.bint)
    cython.declare(r=cython.Py_ssize_t, c=cython.Py_ssize_t, k=cython.Py_ssize_t, beside=cython.Py_ssize_t)
    with cython.nogil:
        rows, columns = alike.shape[0], alike.shape[1]
        for r in range(rows):
            for c in range(columns):
                for k in range(2):
                    if not alike[r, c]:
                        continue
                    total, least, most = 0.0, INFINITY, 0.0
                    for beside in range(4):
                        i = r + 1 if beside == 2 else r - 1 if beside == 3 else r
                        j = c + 1 if beside == 0 else c - 1 if beside == 1 else c
                        linked = _joined(right, r, min(c, j)) if beside < 2 else _joined(down, min(r, i), c)
                        other = side[i, j, k] if linked and isfinite(side[i, j, k]) else usual[k]
                        total, least, most = total + other, min(least, other), max(most, other)
                    like = (total - least - most) / 2  # their median
                    pitch = hypot(u[r, c, 0], u[r, c, 1]) if k == 0 else hypot(v[r, c, 0], v[r, c, 1])
                    change = SIDE_CHANGE + PIXELS_CHANGE / max(sqrt(12.0) * like * pitch, 1.0)
                    if not like / change < side[r, c, k] < change * like:
                        alike[r, c] = 0


@cython.cfunc
@cython.nogil
@cython.inline
@cython.exceptval(check=False)
def _next_in_line(
    right: cython.const[cython.uchar][:, :],
    down: cython.const[cython.uchar][:, :],
    r: cython.Py_ssize_t,
    c: cython.Py_ssize_t,
    direction: cython.Py_ssize_t,
) -> cython.bint:
    """Whether (r, c) is linked to the next block in that direction; a diagonal one over either corner."""
    if direction == 0:
        return _joined(right, r, c)
    if direction == 1:
        return _joined(down, r, c)
    if direction == 2:
        return (_joined(right, r, c) and _joined(down, r, c + 1)) or (_joined(down, r, c) and _joined(right, r + 1, c))
    return (_joined(right, r, c - 1) and _joined(down, r, c - 1)) or (
        _joined(down, r, c) and _joined(right, r + 1, c - 1)
    )


@cython.cfunc
@cython.nogil
@cython.inline
@cython.exceptval(check=False)
def _middle(
    position: cython.const[cython.double][:, :, ::1],
    right: cython.const[cython.uchar][:, :],
    down: cython.const[cython.uchar][:, :],
    r: cython.Py_ssize_t,
    c: cython.Py_ssize_t,
    direction: cython.Py_ssize_t,
) -> Vector:
    """The middle of the two linked neighbours of (r, c) in that direction; NaN where one lacks."""
    dr, dc = (0 if direction == 0 else 1), (0 if direction == 1 else -1 if direction == 3 else 1)
    if not (_next_in_line(right, down, r, c, direction) and _next_in_line(right, down, r - dr, c - dc, direction)):
        return Vector(NAN, NAN)
    return Vector(
        (position[r + dr, c + dc, 0] + position[r - dr, c - dc, 0]) / 2,
        (position[r + dr, c + dc, 1] + position[r - dr, c - dc, 1]) / 2,
    )


@cython.cfunc
@cython.nogil
@cython.inline
@cython.exceptval(check=False)
def _bend(
    position: cython.const[cython.double][:, :, ::1],
    right: cython.const[cython.uchar][:, :],
    down: cython.const[cython.uchar][:, :],
    r: cython.Py_ssize_t,
    c: cython.Py_ssize_t,
    direction: cython.Py_ssize_t,
) -> Vector:
    """By how much (r, c) is off the middle of its neighbours in that direction; NaN where one of the three lacks."""
    if not (0 <= r < position.shape[0] and 0 <= c < position.shape[1]):
        return Vector(NAN, NAN)
    middle = _middle(position, right, down, r, c, direction)
    return Vector(position[r, c, 0] - middle.x, position[r, c, 1] - middle.y)


def line_distances(
    position: cython.const[cython.double][:, :, ::1],
    right: cython.const[cython.uchar][:, :],
    down: cython.const[cython.uchar][:, :],
    least: cython.double[:, ::1],
    off: cython.double[::1],
) -> cython.Py_ssize_t:
    """`least` (rows, columns) <- distance from each block to the nearest middle of two neighbours opposite each other,
    less by as much as these are off their own: a bent surface bends its lines everywhere, an odd block one place.

    `off` <- the offsets of all, x and y, as many as are returned.
    """
    cython.declare(r=cython.Py_ssize_t, c=cython.Py_ssize_t, direction=cython.Py_ssize_t)
    count: cython.Py_ssize_t = 0
    with cython.nogil:
        for r in range(position.shape[0]):
            for c in range(position.shape[1]):
                least[r, c] = INFINITY
                for direction in range(DIRECTIONS):
                    dr, dc = (0 if direction == 0 else 1), (0 if direction == 1 else -1 if direction == 3 else 1)
                    here = _bend(position, right, down, r, c, direction)
                    if isfinite(here.x + here.y):
                        least[r, c] = min(least[r, c], sqrt(here.x * here.x + here.y * here.y))
                        off[count], off[count + 1] = fabs(here.x), fabs(here.y)
                        count += 2
                        after = _bend(position, right, down, r + dr, c + dc, direction)
                        before = _bend(position, right, down, r - dr, c - dc, direction)
                        x, y = here.x - (after.x + before.x) / 2, here.y - (after.y + before.y) / 2
                        if isfinite(x + y):
                            least[r, c] = min(least[r, c], sqrt(x * x + y * y))
    return count


def meet_lines(
    position: cython.const[cython.double][:, :, ::1],
    right: cython.const[cython.uchar][:, :],
    down: cython.const[cython.uchar][:, :],
    expected: cython.double[:, :, ::1],
    spread: cython.double[:, ::1],
) -> cython.void:
    """`expected` (rows, columns, 2) <- mean of two middles or more; `spread` <- how far they are from it at most."""
    cython.declare(r=cython.Py_ssize_t, c=cython.Py_ssize_t, direction=cython.Py_ssize_t)
    with cython.nogil:
        for r in range(position.shape[0]):
            for c in range(position.shape[1]):
                expected[r, c, 0], expected[r, c, 1], spread[r, c] = NAN, NAN, 0.0
                x, y, count = 0.0, 0.0, 0.0
                for direction in range(DIRECTIONS):
                    middle = _middle(position, right, down, r, c, direction)
                    if isfinite(middle.x):
                        x += middle.x
                        y += middle.y
                        count += 1
                if count < 2:
                    continue
                x, y = x / count, y / count
                expected[r, c, 0], expected[r, c, 1] = x, y
                for direction in range(DIRECTIONS):
                    middle = _middle(position, right, down, r, c, direction)
                    if isfinite(middle.x):
                        dx, dy = middle.x - x, middle.y - y
                        spread[r, c] = max(spread[r, c], sqrt(dx * dx + dy * dy))


def bend_changes(
    position: cython.const[cython.double][:, :, ::1],
    right: cython.const[cython.uchar][:, :],
    down: cython.const[cython.uchar][:, :],
    lines: cython.double[:, :, ::1],
) -> cython.void:
    """`lines` (4, rows, columns) <- variance of one coordinate, from the change of the bend along each line; or NaN."""
    cython.declare(direction=cython.Py_ssize_t, r=cython.Py_ssize_t, c=cython.Py_ssize_t)
    with cython.nogil:
        for direction in range(DIRECTIONS):
            dr, dc = (0 if direction == 0 else 1), (0 if direction == 1 else -1 if direction == 3 else 1)
            for r in range(position.shape[0]):
                for c in range(position.shape[1]):
                    here = _bend(position, right, down, r, c, direction)
                    after = _bend(position, right, down, r + dr, c + dc, direction)
                    before = _bend(position, right, down, r - dr, c - dc, direction)
                    usual = _mean_step(after, before)
                    x, y = here.x - usual.x, here.y - usual.y
                    both = isfinite(after.x) and isfinite(before.x)
                    lines[direction, r, c] = (x * x + y * y) / 2 / (BEND_GAIN if both else END_GAIN)
