"""Sines in pictures of several shifts: phase, its variance and the modulation, pixel by pixel."""

from __future__ import annotations

import cython
from cython.cimports.libc.math import sqrt

INFINITY = cython.declare(cython.float, float("inf"))
TURN = cython.declare(cython.float, 6.283185307179586)
TINY = cython.declare(cython.float, 1e-30)
BLOCK = cython.declare(cython.Py_ssize_t, 512)  # pixels whose sums stay in the processor's first cache

Pixel = cython.fused_type(cython.uchar, cython.ushort)


@cython.cfunc
@cython.nogil
@cython.inline
@cython.exceptval(check=False)
def _turns(s: cython.float, c: cython.float) -> cython.float:
    """atan2(s, c) in turns, -0.5 to 0.5, to 4e-9, without a branch: many are made at a time.

    Source: Abramowitz and Stegun, "Handbook of Mathematical Functions", 1964, eq. 4.4.49.
    """
    x, y = abs(c), abs(s)
    t = (y if y < x else x) / ((x if y < x else y) + TINY)
    z: cython.float = t * t
    a: cython.float = z * cython.cast(cython.float, 0.0028662257) - cython.cast(cython.float, 0.0161657367)
    a = a * z + cython.cast(cython.float, 0.0429096138)
    a = a * z - cython.cast(cython.float, 0.0752896400)
    a = a * z + cython.cast(cython.float, 0.1065626393)
    a = a * z - cython.cast(cython.float, 0.1420889944)
    a = a * z + cython.cast(cython.float, 0.1999355085)
    a = a * z - cython.cast(cython.float, 0.3333314528)
    a = (a * z * t + t) / TURN
    a = cython.cast(cython.float, 0.25) - a if y > x else a
    a = cython.cast(cython.float, 0.5) - a if c < 0 else a
    return -a if s < 0 else a


def demodulate(
    seen: cython.const[Pixel][:, ::1],
    weights: cython.const[cython.float][:, ::1],
    floor: cython.const[cython.float][::1],
    gain: cython.float,
    start: cython.float,
    full: cython.float,
    smallest: cython.float,
    found: cython.float[:, ::1],
    saturated: cython.uchar[::1],
) -> None:
    """`found` (3, P) <- phase in turns, its variance and the modulation of `seen` (N, P); `saturated` (P,) <- 0 or 1.

    `weights` (N, 2) make cosine and sine of the brightness; a picture's noise has the variance
    floor + gain * brightness, its floor already summed to `floor`: of cosine, both, sine. `start`, 0 to 1, is added to
    the phase. A modulation whose square is below `smallest` tells none; `full` is the end of the scale.
    """
    cython.declare(p=cython.Py_ssize_t, k=cython.Py_ssize_t, i=cython.Py_ssize_t, count=cython.Py_ssize_t)
    cython.declare(value=cython.float, square=cython.float, phase=cython.float, wc=cython.float, ws=cython.float)
    cython.declare(wcc=cython.float, wcs=cython.float, wss=cython.float)
    most = cython.declare(cython.float[512])
    c = cython.declare(cython.float[512])
    s = cython.declare(cython.float[512])
    cc = cython.declare(cython.float[512])
    cs = cython.declare(cython.float[512])
    ss = cython.declare(cython.float[512])
    pictures: cython.Py_ssize_t = seen.shape[0]
    pixels: cython.Py_ssize_t = seen.shape[1]
    with cython.nogil:
        p = 0
        while p < pixels:
            count = min(BLOCK, pixels - p)
            for i in range(count):
                most[i] = c[i] = s[i] = 0.0
                cc[i], cs[i], ss[i] = floor[0], floor[1], floor[2]
            for k in range(pictures):
                wc, ws = weights[k, 0], weights[k, 1]
                wcc, wcs, wss = gain * wc * wc, gain * wc * ws, gain * ws * ws
                for i in range(count):
                    value = seen[k, p + i]
                    most[i] = value if value > most[i] else most[i]
                    c[i] += wc * value
                    s[i] += ws * value
                    cc[i] += wcc * value
                    cs[i] += wcs * value
                    ss[i] += wss * value
            for i in range(count):
                square = c[i] * c[i] + s[i] * s[i]
                phase = _turns(s[i], c[i]) + start
                phase = phase + 1 if phase < 0 else phase
                found[0, p + i] = phase - 1 if phase >= 1 else phase
                value = s[i] * s[i] * cc[i] - 2 * s[i] * c[i] * cs[i] + c[i] * c[i] * ss[i]
                value = value / (square * square * TURN * TURN + TINY)
                found[1, p + i] = INFINITY if square < smallest else value
                found[2, p + i] = sqrt(square if square > smallest else smallest)
                saturated[p + i] = most[i] >= full
            p += BLOCK
