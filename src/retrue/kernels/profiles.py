"""A picture read between its pixels: profiles through blocks, and whole patches of them."""

from __future__ import annotations

import cython
from cython.cimports.libc.math import isfinite, sqrt

FARTHEST_FIT = cython.declare(cython.double, 0.15)  # pitches that one fit may move a centre

Pixel = cython.fused_type(cython.uchar, cython.ushort)
Color = cython.struct(red=cython.double, green=cython.double, blue=cython.double)


@cython.cfunc
@cython.nogil
@cython.inline
@cython.exceptval(check=False)
def _bilinear(
    pixels: cython.const[Pixel][::1],
    height: cython.Py_ssize_t,
    width: cython.Py_ssize_t,
    levels: cython.const[cython.double][::1],
    x: cython.double,
    y: cython.double,
) -> Color:
    """The colour at (x, y) of `pixels` (height width 3,), two rows and columns or more; outside as at its border.

    `levels` is the number that each value of a pixel is: quicker looked up than converted."""
    cython.declare(column=cython.Py_ssize_t, row=cython.Py_ssize_t, i=cython.Py_ssize_t, j=cython.Py_ssize_t)
    if 0 <= x < width - 1 and 0 <= y < height - 1:
        column, row = cython.cast(cython.Py_ssize_t, x), cython.cast(cython.Py_ssize_t, y)
    else:
        x = min(x, width - 1.0) if x > 0 else 0.0  # NaN, too, stays inside
        y = min(y, height - 1.0) if y > 0 else 0.0
        column, row = cython.cast(cython.Py_ssize_t, x), cython.cast(cython.Py_ssize_t, y)
        column, row = min(column, width - 2), min(row, height - 2)
    fx, fy = x - column, y - row
    d = fx * fy
    a, b, c = 1 - fx - fy + d, fx - d, fy - d
    i = 3 * (row * width + column)
    j = i + 3 * width
    return Color(
        a * levels[pixels[i]] + b * levels[pixels[i + 3]] + c * levels[pixels[j]] + d * levels[pixels[j + 3]],
        a * levels[pixels[i + 1]] + b * levels[pixels[i + 4]] + c * levels[pixels[j + 1]] + d * levels[pixels[j + 4]],
        a * levels[pixels[i + 2]] + b * levels[pixels[i + 5]] + c * levels[pixels[j + 2]] + d * levels[pixels[j + 5]],
    )


def read_patches(
    pixels: cython.const[Pixel][::1],
    height: cython.Py_ssize_t,
    width: cython.Py_ssize_t,
    levels: cython.const[cython.double][::1],
    position: cython.const[cython.double][:, ::1],
    u: cython.const[cython.double][:, ::1],
    v: cython.const[cython.double][:, ::1],
    spacing: cython.double,
    patches: cython.double[:, :, :, ::1],
) -> cython.void:
    """`patches` (N, S, S, 3) <- colours about the blocks at `position`, `spacing` of their pitches u and v apart."""
    cython.declare(x=cython.double, y=cython.double, a=cython.double, b=cython.double)
    cython.declare(n=cython.Py_ssize_t, i=cython.Py_ssize_t, j=cython.Py_ssize_t)
    samples: cython.Py_ssize_t = patches.shape[1]
    with cython.nogil:
        mid = samples // 2
        for n in range(position.shape[0]):
            for i in range(samples):
                b = (i - mid) * spacing
                x, y = position[n, 0] + b * v[n, 0], position[n, 1] + b * v[n, 1]
                for j in range(samples):
                    a = (j - mid) * spacing
                    color = _bilinear(pixels, height, width, levels, x + a * u[n, 0], y + a * u[n, 1])
                    patches[n, i, j, 0], patches[n, i, j, 1], patches[n, i, j, 2] = color.red, color.green, color.blue


def weigh_channels(
    pixels: cython.const[Pixel][::1],
    height: cython.Py_ssize_t,
    width: cython.Py_ssize_t,
    levels: cython.const[cython.double][::1],
    position: cython.const[cython.double][:, ::1],
    right: cython.const[cython.double][:, ::1],
    down: cython.const[cython.double][:, ::1],
    trust: cython.const[cython.double][::1],
    weights: cython.double[:, ::1],
) -> cython.void:
    """`weights` (N, 3) <- what makes one number of a colour, most where block and gaps differ most.

    Of blocks at `position` (N, 2), with pitches `right` and `down`; left as they are where those are not finite."""
    n: cython.Py_ssize_t
    with cython.nogil:
        for n in range(position.shape[0]):
            x, y = position[n, 0], position[n, 1]
            ux, uy, vx, vy = 0.5 * right[n, 0], 0.5 * right[n, 1], 0.5 * down[n, 0], 0.5 * down[n, 1]
            if not isfinite(x + ux + vx):
                continue
            after = _bilinear(pixels, height, width, levels, x + ux, y + uy)
            before = _bilinear(pixels, height, width, levels, x - ux, y - uy)
            below = _bilinear(pixels, height, width, levels, x + vx, y + vy)
            above = _bilinear(pixels, height, width, levels, x - vx, y - vy)
            here = _bilinear(pixels, height, width, levels, x, y)
            red = here.red - min(after.red, before.red, below.red, above.red)
            green = here.green - min(after.green, before.green, below.green, above.green)
            blue = here.blue - min(after.blue, before.blue, below.blue, above.blue)
            red, green, blue = max(red, 0.0) * trust[0], max(green, 0.0) * trust[1], max(blue, 0.0) * trust[2]
            total = max(red + green + blue, 1e-6)
            weights[n, 0], weights[n, 1], weights[n, 2] = red / total, green / total, blue / total


@cython.cfunc
@cython.nogil
@cython.inline
@cython.exceptval(check=False)
def _read_profile(
    pixels: cython.const[Pixel][::1],
    height: cython.Py_ssize_t,
    width: cython.Py_ssize_t,
    levels: cython.const[cython.double][::1],
    weights: cython.const[cython.double][:, ::1],
    n: cython.Py_ssize_t,
    x: cython.double,
    y: cython.double,
    ux: cython.double,
    uy: cython.double,
    vx: cython.double,
    vy: cython.double,
    t: cython.const[cython.double][::1],
    s: cython.const[cython.double][::1],
    profile: cython.double[::1],
) -> cython.void:
    """`profile` (T,) <- weights (3,) of block n times the colour at (x, y) + t u + s v, mean over s."""
    cython.declare(i=cython.Py_ssize_t, k=cython.Py_ssize_t)
    lines = s.shape[0]
    for i in range(t.shape[0]):
        red, green, blue = 0.0, 0.0, 0.0
        along_x, along_y = x + t[i] * ux, y + t[i] * uy
        for k in range(lines):
            color = _bilinear(pixels, height, width, levels, along_x + s[k] * vx, along_y + s[k] * vy)
            red += color.red
            green += color.green
            blue += color.blue
        profile[i] = (weights[n, 0] * red + weights[n, 1] * green + weights[n, 2] * blue) / lines


def fit_profiles(
    pixels: cython.const[Pixel][::1],
    height: cython.Py_ssize_t,
    width: cython.Py_ssize_t,
    levels: cython.const[cython.double][::1],
    blur_px: cython.double,
    t: cython.const[cython.double][::1],
    s: cython.const[cython.double][::1],
    filters: cython.const[cython.double][:, :, ::1],
    borders: cython.const[cython.double][::1],
    weights: cython.const[cython.double][:, ::1],
    blocks: cython.const[cython.Py_ssize_t][::1],
    right: cython.const[cython.double][:, ::1],
    down: cython.const[cython.double][:, ::1],
    shift: cython.const[cython.double][:, ::1],
    profile: cython.double[::1],
    position: cython.double[:, ::1],
) -> cython.void:
    """Move each of `blocks` to where two filters of its profiles, one along each axis, have its middle.

    The middle along either axis lies `shift` (N, 4) off the centre at `position` (N, 2); `borders` (K - 1,) are the
    blurs, in pitches, between which each of the K pairs of `filters` (K, 2, T) is used."""
    cython.declare(k=cython.Py_ssize_t, axis=cython.Py_ssize_t, i=cython.Py_ssize_t)
    with cython.nogil:
        samples = t.shape[0]
        for k in range(blocks.shape[0]):
            n = blocks[k]
            if not isfinite(position[n, 0] + right[n, 0] + down[n, 0]):
                continue
            px, py = position[n, 0], position[n, 1]
            ux, uy, vx, vy = right[n, 0], right[n, 1], down[n, 0], down[n, 1]
            for axis in range(2):
                x, y = px + shift[n, 2 * axis], py + shift[n, 2 * axis + 1]
                ax, ay, bx, by = (ux, uy, vx, vy) if axis == 0 else (vx, vy, ux, uy)
                _read_profile(pixels, height, width, levels, weights, n, x, y, ax, ay, bx, by, t, s, profile)
                blur = blur_px / max(sqrt(ax * ax + ay * ay), 1e-6)
                kind: cython.Py_ssize_t = 0
                while kind < borders.shape[0] and borders[kind] < blur:
                    kind += 1
                lit, moved = 0.0, 0.0
                for i in range(samples):
                    lit += filters[kind, 0, i] * profile[i]
                    moved += filters[kind, 1, i] * profile[i]
                off = min(max(moved / max(lit, 1e-6), -FARTHEST_FIT), FARTHEST_FIT)
                position[n, 0], position[n, 1] = position[n, 0] + off * ax, position[n, 1] + off * ay


def fit_sides(
    pixels: cython.const[Pixel][::1],
    height: cython.Py_ssize_t,
    width: cython.Py_ssize_t,
    levels: cython.const[cython.double][::1],
    t: cython.const[cython.double][::1],
    s: cython.const[cython.double][::1],
    weights: cython.const[cython.double][:, ::1],
    blocks: cython.const[cython.Py_ssize_t][::1],
    right: cython.const[cython.double][:, ::1],
    down: cython.const[cython.double][:, ::1],
    shift: cython.const[cython.double][:, ::1],
    profile: cython.double[::1],
    position: cython.double[:, ::1],
) -> cython.void:
    """The same by their two sides alone, each where the area under its profile, over the window `t`, says.

    Light that falls off across the block, as the inner ends of both windows show, goes on to the side as it does there:
    the lit half of a window of length 2 h, where the light rises by s a pitch, is s h / 2 brighter than its inner end.
    """
    cython.declare(k=cython.Py_ssize_t, axis=cython.Py_ssize_t, side=cython.Py_ssize_t, i=cython.Py_ssize_t)
    with cython.nogil:
        samples = t.shape[0]
        half = (t[samples - 1] - t[0]) / 2
        for k in range(blocks.shape[0]):
            n = blocks[k]
            if not isfinite(position[n, 0] + right[n, 0] + down[n, 0]):
                continue
            px, py = position[n, 0], position[n, 1]
            ux, uy, vx, vy = right[n, 0], right[n, 1], down[n, 0], down[n, 1]
            for axis in range(2):
                x, y = px + shift[n, 2 * axis], py + shift[n, 2 * axis + 1]
                ax, ay, bx, by = (ux, uy, vx, vy) if axis == 0 else (vx, vy, ux, uy)
                along, inner, rise = 0.0, 0.0, 0.0
                for side in range(2):
                    sign = 1.0 if side == 0 else -1.0
                    _read_profile(
                        pixels, height, width, levels, weights, n, x, y, sign * ax, sign * ay, bx, by, t, s, profile
                    )
                    total, last = 0.0, profile[samples - 1]
                    for i in range(samples):
                        total += profile[i]
                    step = max(profile[0] - last, 1e-6)
                    share = (total / samples - last) / step
                    along += sign * (min(max(share, 0.0), 1.0) - 0.5) * half
                    rise += 1 / step
                    inner += sign * profile[0]
                along -= 0.25 * half * half * rise * inner / (2 * t[0])
                position[n, 0] += along * ax
                position[n, 1] += along * ay


def fit_single_sides(
    pixels: cython.const[Pixel][::1],
    height: cython.Py_ssize_t,
    width: cython.Py_ssize_t,
    levels: cython.const[cython.double][::1],
    t: cython.const[cython.double][::1],
    s: cython.const[cython.double][::1],
    half_s: cython.const[cython.double][::1],
    weights: cython.const[cython.double][:, ::1],
    blocks: cython.const[cython.Py_ssize_t][::1],
    right: cython.const[cython.double][:, ::1],
    down: cython.const[cython.double][:, ::1],
    shift: cython.const[cython.double][:, ::1],
    outward: cython.const[cython.double][:, ::1],
    profile: cython.double[::1],
    position: cython.const[cython.double][:, ::1],
    apart: cython.double[:, ::1],
) -> cython.void:
    """`apart` (N, 4) <- pitches along either axis to where each of `blocks` is by its side before, and by that after.

    Read on the lines `s`; on `half_s`, of the half that is away from it, where the surface ends along the other axis,
    `outward` (N, 2), 1 after the block or -1 before it. `t` begins with the middle of a block, then comes the window
    about its side: light that falls off across the block shows between the first two.
    """
    cython.declare(k=cython.Py_ssize_t, axis=cython.Py_ssize_t, side=cython.Py_ssize_t, i=cython.Py_ssize_t)
    with cython.nogil:
        samples = t.shape[0]
        half = (t[samples - 1] - t[1]) / 2
        for k in range(blocks.shape[0]):
            n = blocks[k]
            ux, uy, vx, vy = right[n, 0], right[n, 1], down[n, 0], down[n, 1]
            for axis in range(2):
                x, y = position[n, 0] + shift[n, 2 * axis], position[n, 1] + shift[n, 2 * axis + 1]
                ax, ay, bx, by = (ux, uy, vx, vy) if axis == 0 else (vx, vy, ux, uy)
                away = outward[n, 1 - axis]
                for side in range(2):
                    sign = -1.0 if side == 0 else 1.0
                    cx, cy = sign * ax, sign * ay
                    if away == 0:
                        _read_profile(pixels, height, width, levels, weights, n, x, y, cx, cy, bx, by, t, s, profile)
                    else:
                        dx, dy = -away * bx, -away * by
                        _read_profile(
                            pixels, height, width, levels, weights, n, x, y, cx, cy, dx, dy, t, half_s, profile
                        )
                    total, last = 0.0, profile[samples - 1]
                    for i in range(1, samples):
                        total += profile[i]
                    step = max(profile[1] - last, 1e-6)
                    share = (total / (samples - 1) - last) / step
                    off = 2 * half * (min(max(share, 0.0), 1.0) - 0.5)
                    off -= 0.5 * half * half * (profile[1] - profile[0]) / (t[1] - t[0]) / step
                    apart[n, 2 * axis + side] = sign * off
