"""How the places of blocks bend along the rows and the columns of a surface, and not at its creases."""

from __future__ import annotations

import cython
from cython.cimports.libc.math import isfinite


@cython.cfunc
@cython.nogil
@cython.inline
@cython.exceptval(check=False)
def _linked(
    joints: cython.const[cython.uchar][:, :],
    r: cython.Py_ssize_t,
    c: cython.Py_ssize_t,
    down: cython.Py_ssize_t,
    k: cython.Py_ssize_t,
) -> cython.bint:
    """Whether (r, c) is linked to its k-th neighbour along the line; at the edge of the raster none is."""
    first: cython.Py_ssize_t = k if k < 0 else 0
    last: cython.Py_ssize_t = k if k > 0 else 0
    cython.declare(i=cython.Py_ssize_t, row=cython.Py_ssize_t, column=cython.Py_ssize_t)
    for i in range(first, last):
        row, column = r + i * down, c + i * (1 - down)
        if not (0 <= row < joints.shape[0] and 0 <= column < joints.shape[1]) or joints[row, column] == 0:
            return False
    return True


@cython.cfunc
@cython.nogil
@cython.exceptval(check=False)
def _usual(
    position: cython.const[cython.double][:, :, ::1],
    joints: cython.const[cython.uchar][:, :],
    r: cython.Py_ssize_t,
    c: cython.Py_ssize_t,
    down: cython.Py_ssize_t,
    axis: cython.Py_ssize_t,
) -> cython.double:
    """The median second difference of (r, c) and two on either side; 0 where nothing tells."""
    around = cython.declare(cython.double[5])
    cython.declare(k=cython.Py_ssize_t, i=cython.Py_ssize_t, y=cython.Py_ssize_t, x=cython.Py_ssize_t)
    value: cython.double
    count: cython.Py_ssize_t = 0
    right: cython.Py_ssize_t = 1 - down
    for k in range(-2, 3):
        y, x = r + k * down, c + k * right
        if not (_linked(joints, r, c, down, k) and _linked(joints, y, x, down, -1) and _linked(joints, y, x, down, 1)):
            continue
        value = position[y + down, x + right, axis] - position[y, x, axis]
        value -= position[y, x, axis] - position[y - down, x - right, axis]
        if isfinite(value):
            i = count
            while i > 0 and around[i - 1] > value:
                around[i] = around[i - 1]
                i -= 1
            around[i] = value
            count += 1
    if count == 0:
        return 0.0
    return (around[count // 2] + around[(count - 1) // 2]) / 2


def bends(
    position: cython.const[cython.double][:, :, ::1],
    right: cython.const[cython.uchar][:, :],
    down: cython.const[cython.uchar][:, :],
    blocks: cython.const[cython.Py_ssize_t][::1],
    bend: cython.double[:, :, ::1],
) -> cython.void:
    """`bend` (N, 2, 2) <- of N blocks, the median second difference of five along the row, along the column; or 0."""
    cython.declare(k=cython.Py_ssize_t, r=cython.Py_ssize_t, c=cython.Py_ssize_t, axis=cython.Py_ssize_t)
    with cython.nogil:
        for k in range(blocks.shape[0]):
            r = blocks[k] // position.shape[1]
            c = blocks[k] - r * position.shape[1]
            for axis in range(2):
                bend[k, 0, axis] = _usual(position, right, r, c, 0, axis)
                bend[k, 1, axis] = _usual(position, down, r, c, 1, axis)
