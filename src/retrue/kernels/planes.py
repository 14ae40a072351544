"""Planes through the stripe edges of windows: from their moments, and how well they fit."""

from __future__ import annotations

import cython

TINY = cython.declare(cython.float, 1e-6)
CHUNK = cython.declare(cython.Py_ssize_t, 64)  # cells of a row that are taken at a time, and left out without edges
REACH = cython.declare(cython.Py_ssize_t, 3)  # cells that a window goes to either side
SIDE = cython.declare(cython.Py_ssize_t, 70)  # CHUNK + 2 REACH


def solve(
    sums: cython.const[cython.float][:, :, ::1],
    window: cython.const[cython.float][:, ::1],
    along: cython.Py_ssize_t,
    rows: tuple[cython.Py_ssize_t, cython.Py_ssize_t],
    planes: cython.float[:, :, ::1],
    shape: cython.float[:, :, ::1],
    loose: cython.float[:, :, ::1],
) -> None:
    """Of each cell's window the plane v = a + b x + c y, from the cells' own `sums` (9, R, C) of w, wx, wxx, wy, wyy,
    wxy, wv, wxv, wyv; from the first to before the second of `rows`, where any edge is near.

    x runs along the array axis `along`, y across, both from the cell's centre. `window` (3, 7): its weights along
    either axis, times powers 0, 1, 2 of the distance; a moment about another centre takes the lower ones along.
    `planes` (3, R, C) <- a, b, c; `shape` (5, R, C) <- mean x, mean y, and the second moments xx, yy, xy about these;
    `loose` (2, R, C) <- 1 over the sum of weights, and by how much a's variance exceeds that of a mean.
    """
    cython.declare(r=cython.Py_ssize_t, c=cython.Py_ssize_t, i=cython.Py_ssize_t, j=cython.Py_ssize_t)
    cython.declare(count=cython.Py_ssize_t, left=cython.Py_ssize_t, stop=cython.Py_ssize_t, q=cython.Py_ssize_t)
    cython.declare(h=cython.Py_ssize_t, g=cython.Py_ssize_t, x=cython.Py_ssize_t, y=cython.Py_ssize_t)
    cython.declare(seen=cython.float)
    cython.declare(k0=cython.float, k1=cython.float, k2=cython.float, s=cython.float, t=cython.float, u=cython.float)
    cython.declare(p=cython.float, a=cython.float, b=cython.float, d=cython.float, e=cython.float, f=cython.float)
    # Sums over the rows of a window, REACH more at both ends than are asked, then over its columns too: of w, and of w
    # times hh, gg, hg, v, hv, gv, h, g, where h runs along a row of the picture and g down.
    down = cython.declare(cython.float[630])
    both = cython.declare(cython.float[576])
    height: cython.Py_ssize_t = sums.shape[1]
    width: cython.Py_ssize_t = sums.shape[2]
    one: cython.float = 1
    h, g = (1, 3) if along == 1 else (3, 1)
    x, y = (0, 1) if along == 1 else (1, 0)
    with cython.nogil:
        for r in range(rows[0], rows[1]):
            for c in range(0, width, 64):
                count = min(CHUNK, width - c)
                left, stop = max(c - REACH, 0), min(c + count + REACH, width)
                seen = 0
                for j in range(max(r - REACH, 0), min(r + REACH + 1, height)):
                    for i in range(left, stop):
                        seen += sums[0, j, i]
                if not seen > 0:
                    continue
                for i in range(9 * SIDE):
                    down[i] = 0
                for j in range(max(r - REACH, 0), min(r + REACH + 1, height)):
                    q = j - r + REACH
                    k0, k1, k2 = window[0, q], window[1, q], window[2, q]
                    q = REACH - c
                    for i in range(left, stop):
                        s, t, u = sums[0, j, i], sums[g, j, i], sums[h, j, i]
                        down[q + i] += k0 * s
                        down[SIDE + q + i] += k0 * t + k1 * s
                        down[2 * SIDE + q + i] += k0 * sums[g + 1, j, i] + (k1 + k1) * t + k2 * s
                        down[3 * SIDE + q + i] += k0 * u
                        down[4 * SIDE + q + i] += k0 * sums[5, j, i] + k1 * u
                        down[5 * SIDE + q + i] += k0 * sums[h + 1, j, i]
                    for i in range(left, stop):
                        s = sums[6, j, i]
                        down[6 * SIDE + q + i] += k0 * s
                        down[7 * SIDE + q + i] += k0 * sums[7 + y, j, i] + k1 * s
                        down[8 * SIDE + q + i] += k0 * sums[7 + x, j, i]
                for i in range(9 * CHUNK):
                    both[i] = 0
                for q in range(7):
                    k0, k1, k2 = window[0, q], window[1, q], window[2, q]
                    for i in range(CHUNK):
                        s, t, u = down[q + i], down[SIDE + q + i], down[3 * SIDE + q + i]
                        both[i] += k0 * s
                        both[CHUNK + i] += k0 * t
                        both[2 * CHUNK + i] += k0 * down[2 * SIDE + q + i]
                        both[3 * CHUNK + i] += k0 * u + k1 * s
                        both[4 * CHUNK + i] += k0 * down[4 * SIDE + q + i] + k1 * t
                        both[5 * CHUNK + i] += k0 * down[5 * SIDE + q + i] + (k1 + k1) * u + k2 * s
                    for i in range(CHUNK):
                        s = down[6 * SIDE + q + i]
                        both[6 * CHUNK + i] += k0 * s
                        both[7 * CHUNK + i] += k0 * down[7 * SIDE + q + i]
                        both[8 * CHUNK + i] += k0 * down[8 * SIDE + q + i] + k1 * s
                for i in range(CHUNK):  # which nobody else can write to: many are made at a time
                    p = both[i]
                    p = one / (p if p > TINY else TINY)
                    b, a, d = both[CHUNK + i] * p, both[3 * CHUNK + i] * p, both[6 * CHUNK + i] * p
                    e, f = both[5 * CHUNK + i] * p - a * a, both[2 * CHUNK + i] * p - b * b
                    s = both[4 * CHUNK + i] * p - a * b
                    t, u = both[8 * CHUNK + i] * p - a * d, both[7 * CHUNK + i] * p - b * d
                    both[i], both[CHUNK + i], both[2 * CHUNK + i], both[3 * CHUNK + i] = p, b, f, a
                    both[5 * CHUNK + i], both[4 * CHUNK + i] = e, s
                    p = e * f - s * s
                    p = p if p > TINY else TINY
                    t, u = (f * t - s * u) / p, (e * u - s * t) / p
                    p = (f * (a * a) - (s + s) * (a * b) + e * (b * b)) / p
                    both[6 * CHUNK + i], both[7 * CHUNK + i] = d - (t * a + u * b), t
                    both[8 * CHUNK + i] = u
                    down[i] = one + (p if p > 0 else p - p)
                for i in range(count):
                    planes[0, r, c + i] = both[6 * CHUNK + i]
                    planes[1 + x, r, c + i] = both[7 * CHUNK + i]
                    planes[1 + y, r, c + i] = both[8 * CHUNK + i]
                    shape[x, r, c + i] = both[3 * CHUNK + i]
                    shape[y, r, c + i] = both[CHUNK + i]
                    shape[2 + x, r, c + i] = both[5 * CHUNK + i]
                    shape[2 + y, r, c + i] = both[2 * CHUNK + i]
                    shape[4, r, c + i] = both[4 * CHUNK + i]
                    loose[0, r, c + i] = both[i]
                    loose[1, r, c + i] = down[i]


def judge(
    misses: cython.const[cython.float][:, :, ::1],
    window: cython.const[cython.float][::1],
    rows: tuple[cython.Py_ssize_t, cython.Py_ssize_t],
    loose: cython.const[cython.float][:, :, ::1],
    noise: tuple[cython.float, cython.float],
    limits: tuple[cython.float, cython.float],
    variance: cython.float[:, ::1],
    even: cython.uchar[:, ::1],
    sure: cython.uchar[:, ::1],
    whole: cython.uchar[:, ::1],
) -> None:
    """How well those planes fit, of the cells' own `misses` (3, R, C): sums of w off^2, of w and of 1.

    `variance` <- that of the plane's a, `loose` as `solve` has it; `even` <- whether the mean of off^2 is below the
    first of `limits`, `sure` <- the variance below the second; `whole` <- even, and by any edge at all. `noise`: by how
    much an edge of weight 1 scatters at least, and what makes sums of weights of what `solve` divided by. `window` (7,)
    and `rows` as there.
    """
    cython.declare(r=cython.Py_ssize_t, c=cython.Py_ssize_t, i=cython.Py_ssize_t, j=cython.Py_ssize_t)
    cython.declare(count=cython.Py_ssize_t, left=cython.Py_ssize_t, stop=cython.Py_ssize_t, q=cython.Py_ssize_t)
    cython.declare(own=cython.float, floor=cython.float, scale=cython.float, rough=cython.float, most=cython.float)
    down = cython.declare(cython.float[210])
    both = cython.declare(cython.float[192])
    height: cython.Py_ssize_t = misses.shape[1]
    width: cython.Py_ssize_t = misses.shape[2]
    floor, scale = noise[0], noise[1]
    rough, most = limits[0], limits[1]
    with cython.nogil:
        for r in range(rows[0], rows[1]):
            for c in range(0, width, 64):
                if not loose[0, r, c] > 0:  # nor in the others: without edges
                    continue
                count = min(CHUNK, width - c)
                left, stop = max(c - REACH, 0), min(c + count + REACH, width)
                for i in range(3 * SIDE):
                    down[i] = 0
                for j in range(max(r - REACH, 0), min(r + REACH + 1, height)):
                    own, q = window[j - r + REACH], REACH - c
                    for i in range(left, stop):
                        down[q + i] += own * misses[0, j, i]
                        down[SIDE + q + i] += own * misses[1, j, i]
                        down[2 * SIDE + q + i] += own * misses[2, j, i]
                for i in range(3 * CHUNK):
                    both[i] = 0
                for q in range(7):
                    own = window[q]
                    for i in range(CHUNK):
                        both[i] += own * down[q + i]
                        both[CHUNK + i] += own * down[SIDE + q + i]
                        both[2 * CHUNK + i] += own * down[2 * SIDE + q + i]
                for i in range(count):
                    own = both[i] / (both[2 * CHUNK + i] + TINY) + floor
                    variance[r, c + i] = own * loose[0, r, c + i] * loose[1, r, c + i] * scale
                for i in range(count):
                    even[r, c + i] = both[i] / (both[CHUNK + i] + TINY) < rough
                    sure[r, c + i] = variance[r, c + i] < most
                    whole[r, c + i] = even[r, c + i] & (both[CHUNK + i] > TINY)
