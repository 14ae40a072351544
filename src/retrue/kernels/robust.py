"""Sums under Tukey's biweight; the statistics are those of `geometry.robust`. NaN has no weight."""

from __future__ import annotations

import cython
from cython.cimports.libc.math import fabs, sqrt

INFINITY = cython.declare(cython.double, float("inf"))
NAN = cython.declare(cython.double, float("nan"))
FEWEST = cython.declare(cython.double, 3.0)  # points of a block that tell what they share
MANY = cython.declare(cython.Py_ssize_t, 150)  # values that it pays to look at a few of
FEW = cython.declare(cython.Py_ssize_t, 32)
WITHIN = cython.declare(cython.Py_ssize_t, 6)  # of the few, beside the one that is sought: two standard errors or more
FEWEST_BLOCKS = cython.declare(cython.Py_ssize_t, 4)


def reweighted_level(
    values: cython.const[cython.double][::1],
    level: cython.double,
    cutoff: cython.double,
    correction: cython.double,
    smallest: cython.double,
    steps: cython.Py_ssize_t,
) -> cython.double:
    """Standard deviation under the weights that it gives, times root `correction`; `steps` from `level` on."""
    for _ in range(steps):
        scale = 1 / (cutoff * level)
        number, squares = 0.0, 0.0
        for k in range(values.shape[0]):
            relative = values[k] * scale
            inside = 1 - relative * relative
            if inside > 0:
                inside *= inside
                number += inside
                squares += inside * values[k] * values[k]
        level = sqrt(squares * correction / number) if number > 0 else 0.0
        if not level > smallest:
            level = smallest
    return level


def count_between(
    values: cython.const[cython.double][::1],
    rows: cython.const[cython.uchar][::1],
    level: cython.double,
    nearest: cython.double,
    near: cython.double,
    far: cython.double,
    counts: cython.longlong[::1],
) -> None:
    """`counts` (2,) <- of those rows of values (N,), how many are less than `nearest`, and how many from near to far.

    In absolute value over the level, the ends left out.
    """
    cython.declare(k=cython.Py_ssize_t)
    less: cython.longlong = 0
    between: cython.longlong = 0
    for k in range(values.shape[0]):
        value = fabs(values[k]) / level
        less += (rows[k] != 0) & (value < nearest)
        between += (rows[k] != 0) & (near < value) & (value < far)
    counts[0], counts[1] = less, between


def silence(
    families: cython.const[cython.double][:, ::1],
    weights: cython.const[cython.double][:, ::1],
    rows: cython.const[cython.uchar][::1],
    values: cython.double[:, ::1],
    left: cython.double[:, ::1],
) -> None:
    """`values`, `left` (K, N) <- families of values and their weights, of those rows (N,) NaN and zero."""
    cython.declare(i=cython.Py_ssize_t, k=cython.Py_ssize_t)
    for i in range(families.shape[0]):
        for k in range(rows.shape[0]):
            values[i, k] = NAN if rows[k] else families[i, k]
            left[i, k] = 0.0 if rows[k] else weights[i, k]


def number_blocks(
    points: cython.const[cython.double][:, ::1],
    group: cython.const[cython.longlong][::1],
    per_side: cython.longlong,
    extent: cython.double[:, ::1],
    blocks: cython.longlong[::1],
) -> None:
    """Number the cells of a grid over the extent of each group of points; -1 in group -1.

    extent : (G, 4) room for the lowest and highest x and y of each group.
    """
    for k in range(extent.shape[0]):
        extent[k, 0], extent[k, 1], extent[k, 2], extent[k, 3] = INFINITY, -INFINITY, INFINITY, -INFINITY
    for k in range(points.shape[0]):
        which: cython.Py_ssize_t = group[k]
        if which >= 0:
            x, y = points[k, 0], points[k, 1]
            extent[which, 0], extent[which, 1] = min(extent[which, 0], x), max(extent[which, 1], x)
            extent[which, 2], extent[which, 3] = min(extent[which, 2], y), max(extent[which, 3], y)
    for k in range(points.shape[0]):
        which = group[k]
        blocks[k] = -1
        if which >= 0:
            width, height = extent[which, 1] - extent[which, 0], extent[which, 3] - extent[which, 2]
            column: cython.longlong = 0
            row: cython.longlong = 0
            if width > 0:
                column = cython.cast(cython.longlong, (points[k, 0] - extent[which, 0]) / width * per_side)
            if height > 0:
                row = cython.cast(cython.longlong, (points[k, 1] - extent[which, 2]) / height * per_side)
            column, row = min(column, per_side - 1), min(row, per_side - 1)
            blocks[k] = (which * per_side + row) * per_side + column


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _selected(values: cython.double[::1], count: cython.Py_ssize_t, place: cython.Py_ssize_t) -> cython.double:
    """The value at that place if the first `count` were sorted: none before it is larger, none after it smaller."""
    cython.declare(i=cython.Py_ssize_t, j=cython.Py_ssize_t)
    low: cython.Py_ssize_t = 0
    high: cython.Py_ssize_t = count - 1
    while low < high:
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
    return values[place]


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _quantile(values: cython.double[::1], count: cython.Py_ssize_t, share: cython.double) -> cython.double:
    """The value that a share of the first `count` stays below, linear in between; zero of nothing.

    It orders them. Of many, those first that a few of them show to be far off are left out, without a branch: one on
    random values is guessed wrongly half the time.
    """
    cython.declare(i=cython.Py_ssize_t, k=cython.Py_ssize_t, before=cython.Py_ssize_t, inside=cython.Py_ssize_t)
    few = cython.declare(cython.double[32])
    if count == 0:
        return 0.0
    place = share * (count - 1)
    low: cython.Py_ssize_t = cython.cast(cython.Py_ssize_t, place)
    part = place - low
    while count > MANY:
        for k in range(FEW):
            value = values[k * count // FEW]
            i = k
            while i > 0 and few[i - 1] > value:
                few[i] = few[i - 1]
                i -= 1
            few[i] = value
        i = low * FEW // count
        least = few[i - WITHIN] if i >= WITHIN else -INFINITY
        most = few[i + WITHIN + 1] if i + WITHIN + 1 < FEW else INFINITY
        before, inside = 0, 0
        for k in range(count):
            before += values[k] < least
            inside += values[k] <= most
        inside -= before
        if not before <= low < before + inside - 1 or 2 * inside > count + before:
            break
        i = 0
        for k in range(count):
            value = values[k]
            values[i] = value
            i += (value >= least) & (value <= most)
        count, low = inside, low - before
    below = _selected(values, count, low)
    if low + 1 >= count:
        return below
    above = values[low + 1]
    for k in range(low + 2, count):
        above = min(above, values[k])
    return below + part * (above - below) if below < above else below


def absolute_quantile(
    values: cython.const[cython.double][::1], every: cython.Py_ssize_t, share: cython.double, room: cython.double[::1]
) -> cython.double:
    """The absolute value that a share of every so many of the finite ones stays below; zero of nothing."""
    cython.declare(k=cython.Py_ssize_t)
    count: cython.Py_ssize_t = 0
    k = 0
    while k < values.shape[0]:  # a range of unknown step would count in Python's numbers
        value = fabs(values[k])
        room[count] = value
        count += value < INFINITY
        k += every
    return _quantile(room, count, share)


def gather_weights(
    both: cython.const[cython.double][:, ::1],
    plane_index: cython.const[cython.longlong][::1],
    planes: cython.Py_ssize_t,
    floor: cython.double,
    reach: cython.double,
    median_to_sigma: cython.double,
    cutoff: cython.double,
    smallest: cython.double,
    room: cython.double[::1],
    levels: cython.double[::1],
    weights: cython.double[:, ::1],
) -> cython.double:
    """`weights` (2, N) of residuals (2, N), each plane at its own level (P,), points on none at the reach returned.

    A level is the median of both residuals. The reach is a third of the last one, or the median of what is on no plane
    where that is less, but not below the floor: the least of the levels, or the one given where there is no plane.
    `room` is (2 N,).
    """
    cython.declare(k=cython.Py_ssize_t, p=cython.Py_ssize_t, family=cython.Py_ssize_t)
    for p in range(-1, planes):
        count: cython.Py_ssize_t = 0
        for family in range(2 if p >= 0 else 1):
            for k in range(plane_index.shape[0]):
                room[count] = fabs(both[family, k]) if both[family, k] == both[family, k] else INFINITY
                count += plane_index[k] == p
        level = max(median_to_sigma * _quantile(room, count, 0.5), smallest)
        levels[p + 1] = level
        if p < 0:
            free: cython.Py_ssize_t = count
        elif p == 0 or level < floor:
            floor = level
    reach = max(floor, min(reach / 3, levels[0])) if free > 0 else floor
    levels[0] = reach
    for k in range(plane_index.shape[0]):
        level = levels[plane_index[k] + 1]
        for family in range(2):
            relative = both[family, k] / (cutoff * level)
            inside = 1 - relative * relative
            weights[family, k] = inside * inside / (level * level) if inside > 0 else 0.0
    return reach


def shared_part(
    values: cython.const[cython.double][::1],
    level: cython.double,
    cutoff: cython.double,
    blocks: cython.const[cython.longlong][::1],
    number: cython.double[::1],
    total: cython.double[::1],
    weights: cython.double[::1],
    variance: cython.double[::1],
) -> cython.double:
    """`weights` (N,) <- (1 - (r / cutoff level)^2)^2, zero beyond; `variance` (N,) <- effective ones, infinite in block
    -1. Returns the shared part, zero where there is none to be seen.

    `number` and `total` are room for the sums of each block.
    """
    cython.declare(k=cython.Py_ssize_t)
    scale = 1 / (cutoff * level)
    for k in range(number.shape[0]):
        number[k], total[k] = 0.0, 0.0
    for k in range(values.shape[0]):
        relative = values[k] * scale
        inside = 1 - relative * relative
        weights[k] = inside * inside if inside > 0 else 0.0
        if weights[k] > 0:
            number[blocks[k]] += weights[k]
            total[blocks[k]] += weights[k] * values[k]
    used, excess, points = 0, 0.0, 0.0
    for k in range(number.shape[0]):
        if number[k] > FEWEST:
            used, points = used + 1, points + number[k]
            excess += total[k] * total[k] / number[k]
    excess = excess / (level * level) - used
    square = 0.0
    if used >= FEWEST_BLOCKS and excess > 4 * sqrt(2.0 * used):
        square = level * level * excess / points
    for k in range(values.shape[0]):
        variance[k] = level * level + square * number[blocks[k]] if blocks[k] >= 0 else INFINITY
    return sqrt(square)


def alikeness(
    number: cython.const[cython.double][::1],
    total: cython.const[cython.double][::1],
    shared: cython.double,
    per_side: cython.Py_ssize_t,
) -> cython.double:
    """By how much the variance of a mean over grids of blocks is larger than if each erred by itself.

    Of a first-order autoregression along each side, with the correlation of neighbouring blocks' means `total` over
    `number` (G per_side^2 and one,), of those that have enough points, over `shared` squared.
    """
    cython.declare(k=cython.Py_ssize_t, lag=cython.Py_ssize_t, pairs=cython.Py_ssize_t)
    products = 0.0
    pairs = 0
    for k in range(number.shape[0] - 1):
        if number[k] > FEWEST:
            mean = total[k] / number[k]
            if (k + 1) % per_side != 0 and number[k + 1] > FEWEST:
                products, pairs = products + mean * total[k + 1] / number[k + 1], pairs + 1
            if (k // per_side + 1) % per_side != 0 and number[k + per_side] > FEWEST:
                products, pairs = products + mean * total[k + per_side] / number[k + per_side], pairs + 1
    if pairs == 0:
        return 1.0
    correlation = min(max(products / pairs / (shared * shared), 0.0), 1.0)
    power, both = 1.0, 0.0
    for lag in range(1, per_side):
        power *= correlation
        both += (1 - cython.cast(cython.double, lag) / per_side) * power
    return (1 + 2 * both) * (1 + 2 * both)


def loss(
    values: cython.const[cython.double][::1],
    level: cython.double,
    variance: cython.const[cython.double][::1],
    cutoff: cython.double,
) -> cython.double:
    """Sum of Tukey's loss, r^2 near zero and saturated from the cutoff on and for NaN, of values over their level.

    Each counts level^2 / variance.
    """
    scale, total = 1 / (cutoff * level), 0.0
    for k in range(values.shape[0]):
        relative = values[k] * scale
        inside = 1 - relative * relative
        total += (1 - inside * inside * inside if inside > 0 else 1.0) / variance[k]
    return total * level * level * cutoff * cutoff / 3


def add_loss(
    values: cython.const[cython.double][:, ::1],
    family: cython.Py_ssize_t,
    level: cython.double,
    louder: cython.double,
    cutoff: cython.double,
    most: cython.double,
    total: cython.double[::1],
) -> None:
    """`total` (N,) += that loss of one family of values (N, K) over their level, and `louder`; together no more than
    the most."""
    cython.declare(k=cython.Py_ssize_t)
    scale, largest = 1 / (cutoff * level), cutoff * cutoff / 3
    for k in range(values.shape[0]):
        relative = values[k, family] * scale
        inside = 1 - relative * relative
        lost = louder + (largest * (1 - inside * inside * inside) if inside > 0 else largest)
        total[k] += lost if lost < most else most
