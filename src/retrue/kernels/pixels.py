"""Which pixels of a picture are looked at, and where those that became points are."""

from __future__ import annotations

import cython


def spans(wanted: cython.const[cython.uchar][:, ::1], gap: cython.Py_ssize_t, found: cython.int[:, ::1]) -> int:
    """`found` (M, 3) <- row, first and one past the last column of each run of wanted pixels; how many.

    Runs that less than `gap` pixels part are one. M must hold `width // gap + 1` a row.
    """
    cython.declare(y=cython.Py_ssize_t, x=cython.Py_ssize_t, count=cython.Py_ssize_t, last=cython.Py_ssize_t)
    width: cython.Py_ssize_t = wanted.shape[1]
    count = 0
    with cython.nogil:
        for y in range(wanted.shape[0]):
            last = -gap - 1
            for x in range(width):
                if wanted[y, x]:
                    if x - last > gap:
                        found[count, 0], found[count, 1] = cython.cast(cython.int, y), cython.cast(cython.int, x)
                        count += 1
                    last = x
                    found[count - 1, 2] = cython.cast(cython.int, x + 1)
    return count


def places(
    pixels: cython.const[cython.Py_ssize_t][::1],
    width: cython.Py_ssize_t,
    top: cython.Py_ssize_t,
    flat: cython.Py_ssize_t[::1],
    cells: cython.longlong[:, ::1],
    camera_px: cython.double[:, ::1],
) -> None:
    """Of flat indices into a band (N,) that begins at row `top`: those into the picture, (row, column), and (x, y)."""
    cython.declare(k=cython.Py_ssize_t, y=cython.Py_ssize_t, x=cython.Py_ssize_t, start=cython.Py_ssize_t)
    y = start = 0
    with cython.nogil:
        for k in range(pixels.shape[0]):
            x = pixels[k] - start
            if not 0 <= x < width:
                y = pixels[k] // width
                start = y * width
                x = pixels[k] - start
            flat[k] = pixels[k] + top * width
            cells[k, 0], cells[k, 1] = y + top, x
            camera_px[k, 0], camera_px[k, 1] = x, y + top
