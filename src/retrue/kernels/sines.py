"""Sines in pictures of several shifts: phase and its variance, whole turns, and steps between neighbours."""

from __future__ import annotations

import cython
from cython.cimports.libc.math import fabs, sqrt

INFINITY = cython.declare(cython.float, float("inf"))
TURN = cython.declare(cython.float, 6.283185307179586)
TINY = cython.declare(cython.float, 1e-30)
QUARTER = cython.declare(cython.float, 0.25)
WHOLE = cython.declare(cython.float, 12582912.0)  # 3 * 2^22: what is added to it and taken away is a whole number
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


def refine(
    phase: cython.const[cython.float][::1],
    variance: cython.const[cython.float][::1],
    reach: cython.const[cython.float][::1],
    period: cython.float,
    limits: tuple[cython.float, cython.float, cython.float],
    known: cython.float[:, ::1],
    missed: cython.float[:, ::1],
    flags: cython.uchar[:, ::1],
    judged: cython.bint,
) -> None:
    """`known` (2, P), a coordinate and its variance, <- those of a finer sine of that phase, in turns, and period.

    x = (m + phase) period, with the whole m that comes nearest to the coarser coordinate; `missed` (2, P) <- by how
    much that missed x, and the variance of it. Where `judged`, `flags` (2, P): trusted stays where the miss is at most
    the first of `limits` sigmas and `reach`, and the next turn is missed by more than the second; risky <- 1 where the
    period is less than the third.
    """
    cython.declare(p=cython.Py_ssize_t, x=cython.float, off=cython.float, both=cython.float, sigma=cython.float)
    cython.declare(own=cython.float, near=cython.float, far=cython.float, r=cython.float, even=cython.bint)
    even = reach.shape[0] == 1
    with cython.nogil:
        for p in range(phase.shape[0]):
            x = known[0, p] / period - phase[p]
            x = ((x + WHOLE) - WHOLE + phase[p]) * period
            own = variance[p] * (period * period)
            off, both = known[0, p] - x, known[1, p] + own
            missed[0, p], missed[1, p] = off, both
            known[0, p], known[1, p] = x, own
        if judged:
            for p in range(phase.shape[0]):
                sigma, r = sqrt(missed[1, p]), reach[0 if even else p]
                near, far = r + limits[0] * sigma, period - r - limits[1] * sigma
                flags[0, p] &= fabs(missed[0, p]) <= (near if near < far else far)
                flags[1, p] |= limits[2] * sigma > period


def keep_within(
    cycle: cython.float,
    side: cython.float,
    sigmas: cython.float,
    known: cython.float[:, ::1],
    trusted: cython.uchar[::1],
) -> None:
    """The coordinate `known` (2, P) <- that of all it stands for, one a `cycle`, which lies in the projector's `side`.

    `trusted` stays where no other may, within so many sigmas.
    """
    cython.declare(p=cython.Py_ssize_t, x=cython.float, margin=cython.float)
    with cython.nogil:
        for p in range(trusted.shape[0]):
            x = known[0, p]
            x = x + cycle if x < -0.5 else x
            x = x - cycle if x > side - cython.cast(cython.float, 0.5) and x - cycle >= -0.5 else x
            margin = sigmas * sqrt(known[1, p])
            known[0, p] = x
            trusted[p] &= (x + cycle > side - cython.cast(cython.float, 0.5) + margin) & (
                x - cycle < -cython.cast(cython.float, 0.5) - margin
            )


def find_steps(
    px: cython.const[cython.float][:, ::1],
    variance: cython.const[cython.float][:, ::1],
    good: cython.const[cython.uchar][:, ::1],
    step: cython.float,
    sigmas: cython.float,
    flat: cython.uchar[:, ::1],
) -> None:
    """`flat` <- 0 where two opposite neighbours, both good, differ by more than `step` and so many sigmas."""
    cython.declare(y=cython.Py_ssize_t, x=cython.Py_ssize_t, limit=cython.float)
    height: cython.Py_ssize_t = px.shape[0]
    width: cython.Py_ssize_t = px.shape[1]
    with cython.nogil:
        for y in range(height):
            for x in range(width):
                if good[y, x]:
                    limit = step + sigmas * sqrt(variance[y, x])
                    if 0 < x < width - 1 and good[y, x - 1] & good[y, x + 1]:
                        flat[y, x] &= not fabs(px[y, x + 1] - px[y, x - 1]) > limit
                    if 0 < y < height - 1 and good[y - 1, x] & good[y + 1, x]:
                        flat[y, x] &= not fabs(px[y + 1, x] - px[y - 1, x]) > limit


def spread(
    pixels: cython.const[cython.Py_ssize_t][::1],
    known: cython.const[cython.float][:, ::1],
    modulation: cython.const[cython.float][::1],
    flags: cython.const[cython.uchar][:, ::1],
    images: cython.float[:, ::1],
    masks: cython.uchar[:, ::1],
) -> None:
    """Into those pixels: `images` (3, ...) coordinate, variance and modulation; `masks`, one for each of `flags`."""
    cython.declare(k=cython.Py_ssize_t, m=cython.Py_ssize_t, p=cython.Py_ssize_t)
    with cython.nogil:
        for k in range(pixels.shape[0]):
            p = pixels[k]
            images[0, p], images[1, p], images[2, p] = known[0, k], known[1, k], modulation[k]
            for m in range(flags.shape[0]):
                masks[m, p] = flags[m, k]


def against_blur(
    px: cython.const[cython.float][:, ::1],
    variance: cython.const[cython.float][:, ::1],
    modulation: cython.const[cython.float][:, ::1],
    whole: cython.const[cython.uchar][:, ::1],
    first: cython.Py_ssize_t,
    pixels: cython.const[cython.Py_ssize_t][::1],
    period: cython.float,
    blur: cython.float,
    doubt: cython.float,
    found: cython.double[::1],
    left: cython.float[::1],
) -> None:
    """`found` <- coordinate of `pixels`, less what blur makes of light that changes; `left` += its variance.

    `pixels` are flat indices from row `first` on, ascending.
    `blur` is the variance of the camera's, px^2, and `doubt` the standard deviation of that. Slopes are those between
    neighbours on the same surface, `whole`; the relative noise of modulation is that of the phase in radians, and what
    it makes of a slope of light shrinks that (Wiener's filter).
    """
    cython.declare(k=cython.Py_ssize_t, y=cython.Py_ssize_t, x=cython.Py_ssize_t, start=cython.Py_ssize_t)
    cython.declare(a=cython.Py_ssize_t, b=cython.Py_ssize_t, slope=cython.float, relative=cython.float)
    cython.declare(moved=cython.float, noise=cython.float, square=cython.float, share=cython.float)
    height: cython.Py_ssize_t = px.shape[0]
    width: cython.Py_ssize_t = px.shape[1]
    with cython.nogil:
        relative = 2 * (TURN / period) * (TURN / period)
        y, start = first, 0
        for k in range(pixels.shape[0]):
            while pixels[k] >= start + width:
                y += 1
                start += width
            x = pixels[k] - start
            moved = noise = 0
            a = x - 1 if x > 0 and whole[y, x - 1] != 0 else x
            b = x + 1 if x + 1 < width and whole[y, x + 1] != 0 else x
            if b > a:
                slope = (px[y, b] - px[y, a]) * (QUARTER if b - a == 2 else 1)
                moved += slope * (modulation[y, b] - modulation[y, a])
                noise += slope * slope
            a = y - 1 if y > 0 and whole[y - 1, x] != 0 else y
            b = y + 1 if y + 1 < height and whole[y + 1, x] != 0 else y
            if b > a:
                slope = (px[b, x] - px[a, x]) * (QUARTER if b - a == 2 else 1)
                moved += slope * (modulation[b, x] - modulation[a, x])
                noise += slope * slope
            moved /= modulation[y, x]
            noise *= relative * variance[y, x]
            square = moved * moved
            share = square / (square + noise + TINY)
            found[k] = px[y, x] - blur * share * moved
            left[k] += variance[y, x] + share * (doubt * doubt * square + blur * blur * noise)
