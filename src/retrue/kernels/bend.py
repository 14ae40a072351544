"""How planes' slopes change from cell to cell, and what that says of each plane."""

from __future__ import annotations

import cython
from cython.cimports.libc.math import fabs

CHUNK = cython.declare(cython.Py_ssize_t, 64)  # cells of a row that are left out where nothing is known


def changes(
    slopes: cython.const[cython.float][:, :, ::1],
    whole: cython.const[cython.uchar][:, ::1],
    apart: cython.Py_ssize_t,
    length: cython.float,
    along: cython.Py_ssize_t,
    terms: cython.float[:, :, ::1],
) -> None:
    """`terms` (6, R, C) <- 1 where the cells `apart` before and behind tell, along the axis and across it; and how both
    `slopes` (2, R, C) change there, over `length`: the first along, the second along, the same across. 0 elsewhere.
    """
    cython.declare(k=cython.Py_ssize_t, r=cython.Py_ssize_t, c=cython.Py_ssize_t, dr=cython.Py_ssize_t)
    cython.declare(dc=cython.Py_ssize_t, known=cython.float)
    rows: cython.Py_ssize_t = whole.shape[0]
    columns: cython.Py_ssize_t = whole.shape[1]
    with cython.nogil:
        terms[:, :, :] = 0
        for k in range(2):
            dr = apart if (k == 0) == (along == 0) else 0
            dc = apart - dr
            for r in range(dr, rows - dr):
                for c in range(dc, columns - dc):
                    known = whole[r, c] & whole[r - dr, c - dc] & whole[r + dr, c + dc]
                    terms[k, r, c] = known
                    known = known / length
                    terms[2 + 2 * k, r, c] = (slopes[0, r + dr, c + dc] - slopes[0, r - dr, c - dc]) * known
                    terms[3 + 2 * k, r, c] = (slopes[1, r + dr, c + dc] - slopes[1, r - dr, c - dc]) * known


def bias(
    terms: cython.const[cython.float][:, :, ::1],
    shape: cython.const[cython.float][:, :, ::1],
    sigma: cython.const[cython.float][:, ::1],
    reach: cython.Py_ssize_t,
    alike: cython.float,
    doubt: cython.float,
    room: cython.float[:, ::1],
    found: cython.float[:, ::1],
    bent: cython.uchar[:, ::1],
) -> int:
    """`found` (R, C) <- by how much each plane errs, by the mean changes of slope, `terms` as `changes` has them, of the
    cells within `reach`; `bent` <- where that exceeds `sigma`, and by `doubt` its own standard error; how many do.

    `shape` (5, R, C): mean x and y of each window, and its moments xx, yy, xy about them. Of each mean `alike`
    neighbours count as one. `room` is (20, C + 2 `reach`), zero before.
    """
    cython.declare(q=cython.Py_ssize_t, r=cython.Py_ssize_t, c=cython.Py_ssize_t, k=cython.Py_ssize_t)
    cython.declare(count=cython.Py_ssize_t, x=cython.float, y=cython.float, n=cython.float, m=cython.float)
    cython.declare(mean=cython.float, square=cython.float, total=cython.float, variance=cython.float)
    cython.declare(lever=cython.float)
    cython.declare(start=cython.Py_ssize_t, stop=cython.Py_ssize_t, seen=cython.float)
    rows: cython.Py_ssize_t = found.shape[0]
    columns: cython.Py_ssize_t = found.shape[1]
    count = 0
    with cython.nogil:
        for r in range(rows):
            for q in range(2):
                for c in range(columns):
                    room[q, reach + c] = 0
                for k in range(max(r - reach, 0), min(r + reach + 1, rows)):
                    for c in range(columns):
                        room[q, reach + c] += terms[q, k, c]
            start = 0
            while start < columns:
                stop = min(start + CHUNK, columns)
                seen = 0
                for c in range(start, stop + 2 * reach):
                    seen += room[0, c] + room[1, c]
                if not seen > 0:
                    for c in range(start, stop):
                        found[r, c] = 0
                        bent[r, c] = 0
                    start = stop
                    continue
                for q in range(2, 10):
                    for c in range(max(start - reach, 0), min(stop + reach, columns)):
                        room[q, reach + c] = 0
                for k in range(max(r - reach, 0), min(r + reach + 1, rows)):
                    for q in range(2, 6):
                        for c in range(max(start - reach, 0), min(stop + reach, columns)):
                            room[q, reach + c] += terms[q, k, c]
                        for c in range(max(start - reach, 0), min(stop + reach, columns)):
                            room[4 + q, reach + c] += terms[q, k, c] * terms[q, k, c]
                for q in range(10):
                    for c in range(start, stop):
                        room[10 + q, c] = 0
                    for k in range(2 * reach + 1):
                        for c in range(start, stop):
                            room[10 + q, c] += room[q, c + k]
                for q in range(4):  # along x: xx of the first slope, xy of the second; across, y: xy, yy
                    for c in range(start, stop):
                        n = room[10 + q // 2, c]
                        n = n if n > 1 else 1
                        m = n / alike if n > alike else 1
                        x, y = shape[0 if q < 2 else 1, r, c], shape[0 if q == 0 or q == 2 else 1, r, c]
                        lever = (shape[2 if q == 0 else 3 if q == 3 else 4, r, c] - x * y) / 2
                        mean = room[12 + q, c] / n
                        square = room[16 + q, c] / n - mean * mean
                        square = lever * lever * (square if square > 0 else 0) / m
                        room[12 + q, c] = lever * mean
                        room[16 + q, c] = square
                for c in range(start, stop):
                    total = room[12, c] + room[13, c] + room[14, c] + room[15, c]
                    variance = room[16, c] + room[17, c] + room[18, c] + room[19, c]
                    found[r, c] = total
                    bent[r, c] = (fabs(total) > sigma[r, c]) & (total * total > doubt * doubt * variance)
                for c in range(start, stop):
                    count += bent[r, c]
                start = stop
    return count
