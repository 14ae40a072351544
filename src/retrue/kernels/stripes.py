"""Stripes of a Gray code: lit pixels, codes, edges between stripes, and the sums for planes through these."""

from __future__ import annotations

import cython
from cython.cimports.libc.math import fabs, sqrt

LEAST_NOISE = cython.declare(cython.float, 0.5)  # variance that rounding leaves of a difference
CHUNK = cython.declare(cython.Py_ssize_t, 512)  # pixels of a row that stay in the processor's first cache
TINY = cython.declare(cython.float, 1e-9)

Pixel = cython.fused_type(cython.uchar, cython.ushort)


def light(
    white: cython.const[Pixel][:, ::1],
    black: cython.const[Pixel][:, ::1],
    gain: cython.float,
    sigmas: cython.float,
    contrast: cython.float[:, ::1],
    noise: cython.float[:, ::1],
    lit: cython.uchar[:, ::1],
) -> None:
    """`contrast` <- white - black, at least 1; `noise` <- that of a picture less its inverse; `lit` <- 0 or 1.

    Lit is what is brighter in white by more than twice `sigmas` of that noise, whose variance is `gain` a grey level.
    """
    cython.declare(y=cython.Py_ssize_t, x=cython.Py_ssize_t, w=cython.float, b=cython.float, v=cython.float)
    one: cython.float = 1
    with cython.nogil:
        for y in range(white.shape[0]):
            for x in range(white.shape[1]):
                w, b = white[y, x], black[y, x]
                v = gain * (w + b)
                noise[y, x] = sqrt(v if v > LEAST_NOISE else LEAST_NOISE)
                contrast[y, x] = w - b
            for x in range(white.shape[1]):
                lit[y, x] = contrast[y, x] > 2 * (noise[y, x] * sigmas)
            for x in range(white.shape[1]):
                contrast[y, x] = contrast[y, x] if contrast[y, x] > one else one


def add_bit(
    pattern: cython.const[Pixel][:, ::1],
    inverse: cython.const[Pixel][:, ::1],
    runs: cython.const[cython.int][:, ::1],
    along: cython.Py_ssize_t,
    room: Pixel[:, ::1],
    code: cython.short[:, ::1],
    first: Pixel[:, ::1],
    second: Pixel[:, ::1],
    near: Pixel[:, ::1],
    far: Pixel[:, ::1],
) -> None:
    """The next bit of a Gray code, the most significant first, in those runs of pixels.

    `code` <- twice itself and the bit; `first` and `second` <- the two smallest of |pattern - inverse| so far; `near`
    and `far` <- the largest of it, in a pixel and in its neighbour along the axis, of bits that differ between them.
    `room` is (4, 513).
    """
    cython.declare(k=cython.Py_ssize_t, i=cython.Py_ssize_t, x=cython.Py_ssize_t, y=cython.Py_ssize_t)
    cython.declare(stop=cython.Py_ssize_t, count=cython.Py_ssize_t, beside=cython.Py_ssize_t, below=cython.Py_ssize_t)
    cython.declare(height=cython.Py_ssize_t, width=cython.Py_ssize_t)
    height, width = pattern.shape[0], pattern.shape[1]
    with cython.nogil:
        for k in range(runs.shape[0]):
            y, x, stop = runs[k, 0], runs[k, 1], runs[k, 2]
            below = min(y + 1, height - 1)
            while x < stop:
                count = min(CHUNK, stop - x)
                beside = min(count + 1, width - x)
                for i in range(beside):
                    room[0, i] = max(pattern[y, x + i], inverse[y, x + i]) - min(pattern[y, x + i], inverse[y, x + i])
                for i in range(beside):
                    room[1, i] = pattern[y, x + i] > inverse[y, x + i]
                if along == 1:
                    for i in range(beside - 1):
                        room[2, i] = room[0, i + 1]
                    for i in range(beside - 1):
                        room[3, i] = room[1, i] ^ room[1, i + 1]
                    beside -= 1
                else:
                    for i in range(count):
                        p, q = pattern[below, x + i], inverse[below, x + i]
                        room[2, i] = max(p, q) - min(p, q)
                    for i in range(count):
                        room[3, i] = room[1, i] ^ (pattern[below, x + i] > inverse[below, x + i])
                    beside = count
                for i in range(count):
                    code[y, x + i] = (code[y, x + i] << 1) | ((code[y, x + i] & 1) ^ room[1, i])
                for i in range(count):
                    room[1, i] = max(room[0, i], first[y, x + i])
                for i in range(count):
                    second[y, x + i] = min(room[1, i], second[y, x + i])
                for i in range(count):
                    first[y, x + i] = min(room[0, i], first[y, x + i])
                for i in range(beside):
                    room[0, i] = room[0, i] & -room[3, i]
                for i in range(beside):
                    room[2, i] = room[2, i] & -room[3, i]
                for i in range(beside):
                    near[y, x + i] = max(room[0, i], near[y, x + i])
                for i in range(beside):
                    far[y, x + i] = max(room[2, i], far[y, x + i])
                x += count


def believe(
    second: cython.const[Pixel][:, ::1],
    code: cython.const[cython.short][:, ::1],
    noise: cython.const[cython.float][:, ::1],
    sigmas: cython.float,
    codes: tuple[cython.int, cython.int],
    agreed: cython.uchar[:, ::1],
    within: cython.uchar[:, ::1],
) -> None:
    """`agreed` stays where the margin `second` exceeds so many sigmas of `noise`; `within` <- whether the code is one
    of those from the first to the last of `codes`."""
    cython.declare(y=cython.Py_ssize_t, x=cython.Py_ssize_t, first=cython.int, last=cython.int)
    first, last = codes[0], codes[1]
    with cython.nogil:
        for y in range(second.shape[0]):
            for x in range(second.shape[1]):
                agreed[y, x] &= second[y, x] > noise[y, x] * sigmas
            for x in range(second.shape[1]):
                within[y, x] = (code[y, x] >= first) & (code[y, x] <= last)


@cython.cfunc
@cython.nogil
@cython.inline
@cython.exceptval(check=False)
def _steady(here: cython.float, there: cython.float, noise: cython.float, steepest: cython.float) -> cython.bint:
    """Whether contrast hardly changes from a pixel to the next."""
    return fabs(there - here) <= steepest * (there if there < here else here) + 3 * noise


def find_edges(
    code: cython.const[cython.short][:, ::1],
    near: cython.const[Pixel][:, ::1],
    far: cython.const[Pixel][:, ::1],
    contrast: cython.const[cython.float][:, ::1],
    noise: cython.const[cython.float][:, ::1],
    good: cython.const[cython.uchar][:, ::1],
    rows: tuple[cython.Py_ssize_t, cython.Py_ssize_t],
    along: cython.Py_ssize_t,
    share: cython.float,
    steepest: cython.float,
    spacing: cython.const[cython.float][:, ::1],
    bias: cython.const[cython.float][:, :, ::1],
    per_stripe: cython.float,
    blur: tuple[cython.float, cython.float],
    place: cython.int[::1],
    seen: cython.float[:, ::1],
) -> int:
    """`place` (M,) <- flat index of the first pixel of each edge; `seen` (3, M) <- weight, fraction, value; how many.

    Indices are into the rows from the first to before the second of `rows`. Between good neighbours one stripe apart,
    where contrast is steady between them and beside them. With margins as `add_bit` has them, each relative to its own
    pixel's contrast, they balance at a share f, and the edge is at f - (c + c' (1 - 2 f)^2) f (1 - f) (1 - 2 f). c and
    c' are of `bias` (3, S, 2), the first where bit 0 changes, the second where bit 1 does, else the third, at
    `per_stripe` times the `spacing` there, in stripes a pixel. Where contrast C changes, a pixel sees more of its
    brighter side, on average what lies s^2 C' / C beside it, s^2 the variance of the camera's blur: so far the edge is
    moved. The weight is 1 / (1 + (noise / (`share` of both))^2 + (d C' / (C `share`))^2); `blur`: s^2, its doubt d.
    """
    cython.declare(y=cython.Py_ssize_t, x=cython.Py_ssize_t, v=cython.Py_ssize_t, u=cython.Py_ssize_t)
    cython.declare(count=cython.Py_ssize_t, step=cython.int, a=cython.float, b=cython.float, s=cython.float)
    cython.declare(dy=cython.Py_ssize_t, dx=cython.Py_ssize_t, p=cython.Py_ssize_t, q=cython.Py_ssize_t)
    cython.declare(i=cython.Py_ssize_t, bit=cython.Py_ssize_t, behind=cython.int, c=cython.float, off=cython.float)
    cython.declare(slope=cython.float, slope_there=cython.float, last=cython.Py_ssize_t, start=cython.Py_ssize_t)
    cython.declare(height=cython.Py_ssize_t, width=cython.Py_ssize_t, one=cython.float)
    last, height, width, start, one = bias.shape[1] - 2, code.shape[0], code.shape[1], rows[0], 1
    count, dy, dx = (0, 1, 0) if along == 0 else (0, 0, 1)
    with cython.nogil:
        for y in range(start, min(rows[1], height - dy)):
            for x in range(width - dx):
                v, u = y + dy, x + dx
                step = code[v, u] - code[y, x]
                if not (good[y, x] & good[v, u]) or (step != 1 and step != -1):
                    continue
                if not _steady(contrast[y, x], contrast[v, u], noise[y, x], steepest):
                    continue
                p, q = max(y - dy, 0), max(x - dx, 0)
                if not _steady(contrast[p, q], contrast[y, x], noise[p, q], steepest):
                    continue
                slope = (contrast[v, u] - contrast[p, q]) / (contrast[v, u] + contrast[p, q] + TINY)
                p, q = min(v + dy, height - 1), min(u + dx, width - 1)
                if not _steady(contrast[v, u], contrast[p, q], noise[v, u], steepest):
                    continue
                slope_there = (contrast[p, q] - contrast[y, x]) / (contrast[p, q] + contrast[y, x] + TINY)
                s = (cython.cast(cython.float, near[y, x]) + far[y, x]) * share
                off = noise[y, x] / (s + TINY)
                place[count] = cython.cast(cython.int, (y - start) * width + x)
                a, b = near[y, x] * contrast[v, u], far[y, x] * contrast[y, x]
                a = a / (a + b + TINY)
                slope = slope + (slope_there - slope) * a
                seen[0, count] = one / (one + off * off + (blur[1] * slope / share) * (blur[1] * slope / share))
                behind = max(code[y, x], code[v, u])
                bit = 0 if behind & 1 else (1 if behind & 2 else 2)
                s = min(spacing[y, x] * per_stripe, cython.cast(cython.float, last + 1))
                i = min(cython.cast(cython.Py_ssize_t, s), last)
                s, b = s - i, one - a - a
                c = bias[bit, i, 0] + s * (bias[bit, i + 1, 0] - bias[bit, i, 0])
                c = c + (bias[bit, i, 1] + s * (bias[bit, i + 1, 1] - bias[bit, i, 1])) * b * b
                seen[1, count] = a - c * (a * (one - a) * b) + blur[0] * slope
                seen[2, count] = (code[y, x] + code[v, u]) * cython.cast(cython.float, 0.5)
                count += 1
    return count


def moments(
    place: cython.const[cython.int][::1],
    seen: cython.const[cython.float][:, ::1],
    width: cython.int,
    cell: cython.int,
    along: cython.Py_ssize_t,
    begin: cython.Py_ssize_t,
    row: cython.float[:, ::1],
    sums: cython.float[:, :, ::1],
) -> None:
    """`sums` (9, cell rows, cell columns), zero before, <- means over cells of w, wx, wxx, wy, wyy, wxy, wv, wxv, wyv.

    x runs along the axis, y across, both from the cell's centre; `row` (cell columns, 9) is room, zero before. The band
    begins at row `begin` of the cells.
    """
    cython.declare(k=cython.Py_ssize_t, m=cython.Py_ssize_t, y=cython.int, x=cython.int, c=cython.int)
    cython.declare(w=cython.float, a=cython.float, b=cython.float, wa=cython.float, wb=cython.float, wv=cython.float)
    cython.declare(start=cython.int, left=cython.int, r=cython.int, top=cython.int, count=cython.Py_ssize_t)
    own = cython.declare(cython.float[9])
    middle: cython.float = (cell - 1) / cython.cast(cython.float, 2)
    per_pixel: cython.float = 1 / cython.cast(cython.float, cell * cell)
    with cython.nogil:
        y, r, top, start, left, count = 0, 0, 0, 0, 0, place.shape[0]
        for m in range(9):
            own[m] = 0
        for k in range(count + 1):  # row by row: sums of few numbers each lose least
            x = place[k] - start if k < count else 0
            if k == count or x >= width or x // cell != left:
                for m in range(9):
                    row[left, m] += own[m] * per_pixel
                    own[m] = 0
                if k == count or x >= width:
                    y = place[k] // width if k < count else 0
                    start = y * width
                    if k == count or y // cell != r:
                        for m in range(9):
                            for c in range(row.shape[0]):
                                if row[c, m] != 0:  # most are where there are few edges
                                    sums[m, begin + r, c] = row[c, m]
                                    row[c, m] = 0
                        r = y // cell
                        top = r * cell
                    x = place[k] - start if k < count else 0
                left = x // cell
            if k < count:
                a = (x - left * cell) - middle
                b = (y - top) - middle
                a, b = (a, b) if along == 1 else (b, a)
                w, a = seen[0, k], seen[1, k] + a
                wa, wb, wv = w * a, w * b, w * seen[2, k]
                own[0] += w
                own[1] += wa
                own[2] += wa * a
                own[3] += wb
                own[4] += wb * b
                own[5] += wa * b
                own[6] += wv
                own[7] += wv * a
                own[8] += wv * b


def misses(
    place: cython.const[cython.int][::1],
    seen: cython.const[cython.float][:, ::1],
    planes: cython.const[cython.float][:, :, ::1],
    loose: cython.const[cython.float][:, :, ::1],
    width: cython.int,
    cell: cython.int,
    along: cython.Py_ssize_t,
    begin: cython.Py_ssize_t,
    sums: cython.float[:, :, ::1],
) -> None:
    """`sums` (3, cell rows, cell columns), zero before, <- means of w off^2, of w, and of what w off^2 should be.

    `off` is from the own of `planes` (3, cell rows, cell columns): value in the cell's centre, slopes along the axis
    and across. Of edges that scatter by 1 / w, w off^2 should be 1, less what it follows of them, `loose` as of
    `planes.solve`. The band begins at row `begin` of the cells.
    """
    cython.declare(k=cython.Py_ssize_t, y=cython.int, x=cython.int, r=cython.Py_ssize_t, c=cython.int, left=cython.int)
    cython.declare(a=cython.float, b=cython.float, off=cython.float, start=cython.int, count=cython.Py_ssize_t)
    cython.declare(square=cython.float, weight=cython.float, number=cython.float, followed=cython.float)
    middle: cython.float = (cell - 1) / cython.cast(cython.float, 2)
    per_pixel: cython.float = 1 / cython.cast(cython.float, cell * cell)
    with cython.nogil:
        y, start, left, r, count = 0, 0, 0, begin, place.shape[0]
        square = weight = number = 0
        for k in range(count):
            x = place[k] - start
            c = x // cell
            if x >= width or c != left:
                sums[0, r, left] += square * per_pixel
                sums[1, r, left] += weight * per_pixel
                sums[2, r, left] += number * per_pixel
                square = weight = number = 0
                if x >= width:
                    y = place[k] // width
                    start, r = y * width, begin + y // cell
                    x = place[k] - start
                left = x // cell
            a = (x - left * cell) - middle
            b = (y % cell) - middle
            a, b = (a, b) if along == 1 else (b, a)
            off = seen[2, k] - (planes[0, r, left] + planes[1, r, left] * a + planes[2, r, left] * b)
            off = off - planes[1, r, left] * seen[1, k]
            square += off * off * seen[0, k]
            weight += seen[0, k]
            followed = (2 * loose[0, r, left] - loose[1, r, left]) * per_pixel * seen[0, k]
            number += 1 - followed if followed < 1 else 0
        if count:
            sums[0, r, left] += square * per_pixel
            sums[1, r, left] += weight * per_pixel
            sums[2, r, left] += number * per_pixel


def accept(
    code: cython.const[cython.short][:, ::1],
    planes: cython.const[cython.float][:, :, ::1],
    sure: cython.const[cython.uchar][:, ::1],
    even: cython.const[cython.uchar][:, ::1],
    top: cython.Py_ssize_t,
    cell: cython.int,
    along: cython.Py_ssize_t,
    farthest: cython.float,
    certain: cython.uchar[:, ::1],
    smooth: cython.uchar[:, ::1],
) -> None:
    """`certain`, `smooth` stay where the cell is `sure`, is `even` and holds the pixel's own code within `farthest`.

    The band begins at row `top` of the cells.
    """
    cython.declare(y=cython.Py_ssize_t, r=cython.Py_ssize_t, x=cython.int, c=cython.int, width=cython.int)
    cython.declare(start=cython.int, stop=cython.int, any_one=cython.uchar)
    cython.declare(a=cython.float, b=cython.float, i=cython.float, j=cython.float)
    middle: cython.float = (cell - 1) / cython.cast(cython.float, 2)
    width = cython.cast(cython.int, code.shape[1])
    with cython.nogil:
        for y in range(code.shape[0]):
            r = y // cell
            j = cython.cast(cython.float, y - r * cell) - middle
            for start in range(0, width, 64):
                stop, any_one = min(start + 64, width), 0
                for x in range(start, stop):
                    any_one |= certain[y, x] | smooth[y, x]
                for x in range(start, stop if any_one else start):
                    if certain[y, x] | smooth[y, x]:
                        c = x // cell
                        i = (x - c * cell) - middle
                        a, b = (i, j) if along == 1 else (j, i)
                        a = planes[0, top + r, c] + planes[1, top + r, c] * a + planes[2, top + r, c] * b
                        certain[y, x] &= sure[top + r, c]
                        smooth[y, x] &= even[top + r, c] & (fabs(code[y, x] - a) < farthest)


def coordinates(
    pixels: cython.const[cython.Py_ssize_t][::1],
    planes: cython.const[cython.float][:, :, ::1],
    error: cython.const[cython.float][:, ::1],
    frame: tuple[cython.Py_ssize_t, cython.Py_ssize_t],
    cell: cython.int,
    along: cython.Py_ssize_t,
    centre: cython.double,
    step: cython.double,
    px: cython.double[::1],
    found: cython.float[::1],
) -> None:
    """`px` (N,) <- (n + `centre`) `step` - 1/2, n of the plane at those pixels; `found` <- its mean square error.

    `pixels` are flat indices into a band; `frame`: its width, and which row of the cells' picture it begins at.
    """
    cython.declare(k=cython.Py_ssize_t, y=cython.int, x=cython.int, r=cython.int, c=cython.int, below=cython.int)
    cython.declare(a=cython.float, b=cython.float, i=cython.float, j=cython.float, start=cython.Py_ssize_t)
    middle: cython.float = (cell - 1) / cython.cast(cython.float, 2)
    width: cython.Py_ssize_t = frame[0]
    below = cython.cast(cython.int, frame[1])
    start, y, r, j = 0, below, below // cell, below % cell - middle
    with cython.nogil:
        for k in range(pixels.shape[0]):
            if not 0 <= pixels[k] - start < width:
                y = cython.cast(cython.int, pixels[k] // width)
                start = y * width
                y += below
                r = y // cell
                j = (y - r * cell) - middle
            x = cython.cast(cython.int, pixels[k] - start)
            c = x // cell
            i = (x - c * cell) - middle
            a, b = (i, j) if along == 1 else (j, i)
            a = planes[0, r, c] + planes[1, r, c] * a + planes[2, r, c] * b
            px[k] = (a + centre) * step - 0.5
            found[k] = error[r, c]
