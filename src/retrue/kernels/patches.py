"""Patches of a picture about blocks, and what makes them unlike a whole one."""

from __future__ import annotations

import cython
from cython.cimports.libc.math import fabs, sqrt

PATCH = cython.declare(cython.Py_ssize_t, 15)  # samples along a side of a patch
SIDE_RANGE = cython.declare(cython.double, 0.13)  # pitches within which a side is looked for
NAN = cython.declare(cython.double, float("nan"))
INFINITY = cython.declare(cython.double, float("inf"))

Color = cython.struct(red=cython.double, green=cython.double, blue=cython.double)


@cython.cfunc
@cython.nogil
@cython.inline
@cython.exceptval(check=False)
def _square(color: Color, red: cython.double, green: cython.double, blue: cython.double) -> cython.double:
    """The squared distance from `color`."""
    r, g, b = color.red - red, color.green - green, color.blue - blue
    return r * r + g * g + b * b


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _side(
    change: cython.const[cython.double][::1], sign: cython.Py_ssize_t, spacing: cython.double, half: cython.double
) -> cython.double:
    """Where a profile, from the middle outwards, rises half way to another colour, about `half` from there; or NaN."""
    i: cython.Py_ssize_t
    mid = PATCH // 2
    inside, count, outside = 0.0, 0, 0.0
    for i in range(mid + 1):
        if i * spacing < 0.6 * half:
            inside += change[mid + sign * i]
            count += 1
        elif i * spacing > half:
            outside = max(outside, change[mid + sign * i])
    inside /= count
    if not (outside > 0.5 and outside > 2 * inside):
        return NAN
    level = (inside + outside) / 2
    first: cython.Py_ssize_t = 0
    while change[mid + sign * first] <= level:
        first += 1
    if first == 0:
        return NAN
    nearer, farther = change[mid + sign * (first - 1)], change[mid + sign * first]
    side = spacing * (first - 1 + (level - nearer) / (farther - nearer))
    return side if fabs(side - half) < SIDE_RANGE else NAN


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _middle_value(
    patch: cython.const[cython.double][:, :, ::1],
    channel: cython.Py_ssize_t,
    inner: cython.Py_ssize_t,
    values: cython.double[::1],
) -> cython.double:
    """The median of one channel over the samples within `inner` of the middle, an odd number of them."""
    cython.declare(slot=cython.Py_ssize_t, i=cython.Py_ssize_t, j=cython.Py_ssize_t, value=cython.double)
    mid = PATCH // 2
    half = (2 * inner + 1) * (2 * inner + 1) // 2 + 1
    count: cython.Py_ssize_t = 0
    for i in range(mid - inner, mid + inner + 1):
        for j in range(mid - inner, mid + inner + 1):
            value = patch[i, j, channel]
            if count < half:
                slot = count
                count += 1
            elif value < values[half - 1]:
                slot = half - 1
            else:
                continue
            while slot > 0 and values[slot - 1] > value:  # the lower half is kept, in order
                values[slot] = values[slot - 1]
                slot -= 1
            values[slot] = value
    return values[half - 1]


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _unevenness(
    patch: cython.const[cython.double][:, :, ::1], color: Color, core: cython.Py_ssize_t, largest: cython.double[::1]
) -> cython.double:
    """90th percentile of the distance from `color` over the samples within `core` of the middle."""
    cython.declare(slot=cython.Py_ssize_t, kept=cython.Py_ssize_t, i=cython.Py_ssize_t, j=cython.Py_ssize_t)
    mid = PATCH // 2
    kept = (2 * core + 1) * (2 * core + 1) // 10 + 1
    for i in range(kept):
        largest[i] = 0.0
    for i in range(mid - core, mid + core + 1):
        for j in range(mid - core, mid + core + 1):
            value = _square(color, patch[i, j, 0], patch[i, j, 1], patch[i, j, 2])
            slot = kept - 1
            while slot >= 0 and largest[slot] < value:  # keep the largest tenth, in order
                if slot < kept - 1:
                    largest[slot + 1] = largest[slot]
                slot -= 1
            if slot < kept - 1:
                largest[slot + 1] = value
    return sqrt(largest[kept - 1])


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _changes(
    patch: cython.const[cython.double][:, :, ::1],
    color: Color,
    axis: cython.Py_ssize_t,
    sign: cython.Py_ssize_t,
    across: cython.Py_ssize_t,
    step: cython.double,
    change: cython.double[::1],
) -> cython.void:
    """`change` <- distance from `color`, in steps, of the mean of the `across` lines on one side of the middle."""
    cython.declare(red=cython.double, green=cython.double, blue=cython.double)
    cython.declare(r=cython.Py_ssize_t, c=cython.Py_ssize_t, i=cython.Py_ssize_t, k=cython.Py_ssize_t)
    mid, share = PATCH // 2, 1.0 / across
    for i in range(PATCH):
        red, green, blue = 0.0, 0.0, 0.0
        for k in range(1, across + 1):
            r = mid + sign * k if axis == 0 else i
            c = i if axis == 0 else mid + sign * k
            red += patch[r, c, 0]
            green += patch[r, c, 1]
            blue += patch[r, c, 2]
        change[i] = sqrt(_square(color, red * share, green * share, blue * share)) / step


def look_at_patches(
    patches: cython.const[cython.double][:, :, :, ::1],
    spacing: cython.double,
    duty: cython.double,
    scratch: cython.double[::1],
    found: cython.double[:, ::1],
) -> cython.void:
    """`found` (N, 9) <- light 3, offset 2, stretch 2, skew, uneven of the blocks amid `patches` (N, 15, 15, 3).

    Their samples are `spacing` pitches apart.
    """
    cython.declare(red=cython.double, green=cython.double, blue=cython.double, skew=cython.double)
    cython.declare(n=cython.Py_ssize_t, i=cython.Py_ssize_t, axis=cython.Py_ssize_t, j=cython.Py_ssize_t)
    with cython.nogil:
        half = duty / 2
        inner = cython.cast(cython.Py_ssize_t, 0.55 * half / spacing)
        core = cython.cast(cython.Py_ssize_t, 0.75 * half / spacing)
        across = cython.cast(cython.Py_ssize_t, 0.8 * half / spacing)
        for n in range(patches.shape[0]):
            patch = patches[n]
            red, green, blue = INFINITY, INFINITY, INFINITY
            for i in range(PATCH):
                for j in range(PATCH):
                    red, green, blue = min(red, patch[i, j, 0]), min(green, patch[i, j, 1]), min(blue, patch[i, j, 2])
            color = Color(
                _middle_value(patch, 0, inner, scratch),
                _middle_value(patch, 1, inner, scratch),
                _middle_value(patch, 2, inner, scratch),
            )
            found[n, 0], found[n, 1], found[n, 2] = color.red - red, color.green - green, color.blue - blue
            step = sqrt(1e-6 + found[n, 0] * found[n, 0] + found[n, 1] * found[n, 1] + found[n, 2] * found[n, 2])
            found[n, 8] = _unevenness(patch, color, core, scratch) / step
            skew = 0.0
            for axis in range(2):
                _changes(patch, color, axis, -1, across, step, scratch)
                before1, after1 = _side(scratch, -1, spacing, half), _side(scratch, 1, spacing, half)
                _changes(patch, color, axis, 1, across, step, scratch)
                before2, after2 = _side(scratch, -1, spacing, half), _side(scratch, 1, spacing, half)
                before, after = (before1 + before2) / 2, (after1 + after2) / 2
                found[n, 3 + axis] = (after - before) / 2
                found[n, 5 + axis] = (after + before) / duty - 1
                skew = max(skew, fabs(before1 - before2), fabs(after1 - after2))
            found[n, 7] = skew
