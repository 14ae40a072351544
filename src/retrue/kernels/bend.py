"""How planes' slopes change from cell to cell, and what that says of each plane."""

from __future__ import annotations

import cython

REACH = cython.declare(cython.Py_ssize_t, 3)  # cells about each, over which changes are averaged
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
    alike: cython.float,
    doubt: cython.float,
    found: cython.float[:, ::1],
    bent: cython.uchar[:, ::1],
) -> int:
    """`found` (R, C) <- by how much each plane errs, by the mean changes of slope, `terms` as `changes` has them, of
    the cells within REACH; `bent` <- where that exceeds `sigma`, and by `doubt` its own standard error; how many do.

    `shape` (5, R, C): mean x and y of each window, and its moments xx, yy, xy about them. Of each mean `alike`
    neighbours count as one.
    """
    cython.declare(q=cython.Py_ssize_t, r=cython.Py_ssize_t, i=cython.Py_ssize_t, k=cython.Py_ssize_t)
    cython.declare(start=cython.Py_ssize_t, width=cython.Py_ssize_t, left=cython.Py_ssize_t, stop=cython.Py_ssize_t)
    cython.declare(count=cython.Py_ssize_t, a=cython.Py_ssize_t, b=cython.Py_ssize_t, c=cython.Py_ssize_t)
    cython.declare(n=cython.float, m=cython.float, x=cython.float, y=cython.float, seen=cython.float)
    rows: cython.Py_ssize_t = found.shape[0]
    columns: cython.Py_ssize_t = found.shape[1]
    one: cython.float = 1
    none: cython.float = 0
    half: cython.float = 0.5
    down = cython.declare(cython.float[70])  # sums over rows of a term, REACH more at both ends than are asked
    squares = cython.declare(cython.float[70])
    along = cython.declare(cython.float[64])  # how many tell
    across = cython.declare(cython.float[64])
    lever = cython.declare(cython.float[64])
    total = cython.declare(cython.float[64])
    variance = cython.declare(cython.float[64])
    count = 0
    with cython.nogil:
        for r in range(rows):
            start = 0
            while start < columns:
                width = min(CHUNK, columns - start)
                left, stop = max(start - REACH, 0), min(start + width + REACH, columns)
                seen = 0
                for q in range(2):
                    for i in range(CHUNK + 2 * REACH):
                        down[i] = 0
                    for k in range(max(r - REACH, 0), min(r + REACH + 1, rows)):
                        for i in range(left, stop):
                            down[i - start + REACH] += terms[q, k, i]
                    for i in range(CHUNK):
                        n = down[i] + down[i + 1] + down[i + 2] + down[i + 3] + down[i + 4] + down[i + 5] + down[i + 6]
                        across[i] = n
                        seen += n
                    if q == 0:
                        for i in range(CHUNK):
                            along[i] = across[i]
                for i in range(CHUNK):
                    total[i] = variance[i] = 0
                for q in range(4 if seen > 0 else 0):
                    for i in range(CHUNK + 2 * REACH):
                        down[i] = squares[i] = 0
                    for k in range(max(r - REACH, 0), min(r + REACH + 1, rows)):
                        for i in range(left, stop):
                            m = terms[2 + q, k, i]
                            down[i - start + REACH] += m
                            squares[i - start + REACH] += m * m
                    # along x: xx of the first slope, xy of the second; across, y: xy, yy
                    a, b, c = (0 if q < 2 else 1), (0 if q == 0 or q == 2 else 1), (2 if q == 0 else 3 if q == 3 else 4)
                    for i in range(width):
                        lever[i] = half * (shape[c, r, start + i] - shape[a, r, start + i] * shape[b, r, start + i])
                    if q == 2:
                        for i in range(CHUNK):
                            along[i] = across[i]
                    for i in range(CHUNK):
                        n = along[i] if along[i] > one else one
                        m = n / alike
                        m = m if m > one else one
                        x = down[i] + down[i + 1] + down[i + 2] + down[i + 3] + down[i + 4] + down[i + 5] + down[i + 6]
                        y = squares[i] + squares[i + 1] + squares[i + 2] + squares[i + 3] + squares[i + 4]
                        x, y = x / n, (y + squares[i + 5] + squares[i + 6]) / n
                        y = y - x * x
                        total[i] += lever[i] * x
                        variance[i] += lever[i] * lever[i] * (y if y > none else none) / m
                for i in range(width):
                    found[r, start + i] = total[i]
                for i in range(width):
                    m, n = total[i] * total[i], sigma[r, start + i]
                    bent[r, start + i] = (m > n * n) & (m > doubt * doubt * variance[i])
                for i in range(width):
                    count = count + 1 if bent[r, start + i] else count
                start += CHUNK
    return count
