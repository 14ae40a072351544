"""How planes' slopes change from cell to cell, and what that says of each plane."""

from __future__ import annotations

import cython

REACH = cython.declare(cython.Py_ssize_t, 3)  # cells about each, over which changes are averaged
ROWS = cython.declare(cython.Py_ssize_t, 7)  # 2 REACH + 1
CHUNK = cython.declare(cython.Py_ssize_t, 64)  # cells of a row that are left out where nothing is known


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _add_changes(
    first: cython.const[cython.float][:, :],
    second: cython.const[cython.float][:, :],
    told: cython.const[cython.uchar][:, ::1],
    apart: cython.Py_ssize_t,
    length: cython.float,
    along: cython.Py_ssize_t,
    r: cython.Py_ssize_t,
    terms: cython.float[:, :, ::1],
) -> cython.void:
    """Row r of the changes, at its place in `terms` (6, ROWS, C): 1 where the cells `apart` before and behind tell,
    along the axis and across it; and how both slopes change there, over `length`: the first along, the second along,
    the same across. 0 elsewhere."""
    cython.declare(k=cython.Py_ssize_t, c=cython.Py_ssize_t, dr=cython.Py_ssize_t, dc=cython.Py_ssize_t)
    cython.declare(known=cython.float, q=cython.Py_ssize_t)
    rows: cython.Py_ssize_t = told.shape[0]
    columns: cython.Py_ssize_t = told.shape[1]
    at: cython.Py_ssize_t = r % ROWS
    for q in range(6):
        for c in range(columns):
            terms[q, at, c] = 0
    for k in range(2):
        dr = apart if (k == 0) == (along == 0) else 0
        dc = apart - dr
        if not dr <= r < rows - dr:
            continue
        for c in range(dc, columns - dc):
            known = told[r, c] & told[r - dr, c - dc] & told[r + dr, c + dc]
            terms[k, at, c] = known
            known = known / length
            terms[2 + 2 * k, at, c] = (first[r + dr, c + dc] - first[r - dr, c - dc]) * known
            terms[3 + 2 * k, at, c] = (second[r + dr, c + dc] - second[r - dr, c - dc]) * known


def bias(
    first: cython.const[cython.float][:, :],
    second: cython.const[cython.float][:, :],
    whole: cython.const[cython.uchar][:, ::1],
    apart: cython.Py_ssize_t,
    length: cython.float,
    along: cython.Py_ssize_t,
    x: cython.const[cython.float][:, :],
    y: cython.const[cython.float][:, :],
    xx: cython.const[cython.float][:, :],
    yy: cython.const[cython.float][:, :],
    xy: cython.const[cython.float][:, :],
    centred: cython.float,
    sigma: cython.const[cython.float][:, ::1],
    alike: cython.float,
    doubt: cython.float,
    terms: cython.float[:, :, ::1],
    told: cython.uchar[:, ::1],
    found: cython.float[:, ::1],
    bent: cython.uchar[:, ::1],
) -> int:
    """`found` (R, C) <- by how much each plane errs, by the mean changes of its slopes, `first` along the axis and
    `second` across it, in the cells within REACH; `bent` <- where that exceeds `sigma`, and by `doubt` its own standard
    error; how many do.

    A slope changes over `length` between the cells `apart` before and behind, where all three are `whole`, their mean
    place nearer to their centre than root `centred`: `told` <- which are. x, y, xx, yy, xy: mean place of each window,
    and its moments about that. Of each mean `alike` neighbours count as one. `terms` (6, ROWS, C) is room for the
    changes of the rows that are looked at: a picture of them would be as large as all else.
    """
    cython.declare(q=cython.Py_ssize_t, r=cython.Py_ssize_t, i=cython.Py_ssize_t, k=cython.Py_ssize_t)
    cython.declare(start=cython.Py_ssize_t, width=cython.Py_ssize_t, left=cython.Py_ssize_t, stop=cython.Py_ssize_t)
    cython.declare(count=cython.Py_ssize_t, at=cython.Py_ssize_t)
    cython.declare(n=cython.float, m=cython.float, u=cython.float, v=cython.float, seen=cython.float)
    rows: cython.Py_ssize_t = found.shape[0]
    columns: cython.Py_ssize_t = found.shape[1]
    one: cython.float = 1
    none: cython.float = 0
    half: cython.float = 0.5
    down = cython.declare(cython.float[70])  # sums over rows of a term, REACH more at both ends than are asked
    squares = cython.declare(cython.float[70])
    before = cython.declare(cython.float[64])  # how many tell
    across = cython.declare(cython.float[64])
    lever = cython.declare(cython.float[64])
    total = cython.declare(cython.float[64])
    variance = cython.declare(cython.float[64])
    count = 0
    with cython.nogil:
        for r in range(rows):
            for i in range(columns):
                u, v = x[r, i], y[r, i]
                told[r, i] = whole[r, i] & (u * u + v * v < centred)
        for r in range(min(REACH, rows)):
            _add_changes(first, second, told, apart, length, along, r, terms)
        for r in range(rows):
            if r + REACH < rows:
                _add_changes(first, second, told, apart, length, along, r + REACH, terms)
            start = 0
            while start < columns:
                width = min(CHUNK, columns - start)
                left, stop = max(start - REACH, 0), min(start + width + REACH, columns)
                seen = 0
                for q in range(2):
                    for i in range(CHUNK + 2 * REACH):
                        down[i] = 0
                    for k in range(max(r - REACH, 0), min(r + REACH + 1, rows)):
                        at = k % ROWS
                        for i in range(left, stop):
                            down[i - start + REACH] += terms[q, at, i]
                    for i in range(CHUNK):
                        n = down[i] + down[i + 1] + down[i + 2] + down[i + 3] + down[i + 4] + down[i + 5] + down[i + 6]
                        across[i] = n
                        seen += n
                    if q == 0:
                        for i in range(CHUNK):
                            before[i] = across[i]
                for i in range(CHUNK):
                    total[i] = variance[i] = 0
                for q in range(4 if seen > 0 else 0):
                    for i in range(CHUNK + 2 * REACH):
                        down[i] = squares[i] = 0
                    for k in range(max(r - REACH, 0), min(r + REACH + 1, rows)):
                        at = k % ROWS
                        for i in range(left, stop):
                            m = terms[2 + q, at, i]
                            down[i - start + REACH] += m
                            squares[i - start + REACH] += m * m
                    # along x: xx of the first slope, xy of the second; across, y: xy, yy
                    for i in range(width):
                        if q == 0:
                            lever[i] = half * (xx[r, start + i] - x[r, start + i] * x[r, start + i])
                        elif q == 3:
                            lever[i] = half * (yy[r, start + i] - y[r, start + i] * y[r, start + i])
                        else:
                            lever[i] = half * (xy[r, start + i] - x[r, start + i] * y[r, start + i])
                    if q == 2:
                        for i in range(CHUNK):
                            before[i] = across[i]
                    for i in range(CHUNK):
                        n = before[i] if before[i] > one else one
                        m = n / alike
                        m = m if m > one else one
                        u = down[i] + down[i + 1] + down[i + 2] + down[i + 3] + down[i + 4] + down[i + 5] + down[i + 6]
                        v = squares[i] + squares[i + 1] + squares[i + 2] + squares[i + 3] + squares[i + 4]
                        u, v = u / n, (v + squares[i + 5] + squares[i + 6]) / n
                        v = v - u * u
                        total[i] += lever[i] * u
                        variance[i] += lever[i] * lever[i] * (v if v > none else none) / m
                for i in range(width):
                    found[r, start + i] = total[i]
                for i in range(width):
                    m, n = total[i] * total[i], sigma[r, start + i]
                    bent[r, start + i] = (m > n * n) & (m > doubt * doubt * variance[i])
                for i in range(width):
                    count = count + 1 if bent[r, start + i] else count
                start += CHUNK
    return count
