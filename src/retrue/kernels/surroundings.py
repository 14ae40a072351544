"""What lies around places of a picture, around the blocks of one surface, and around points in two pictures."""

from __future__ import annotations

import cython
from cython.cimports.libc.math import floor, isfinite, sqrt

NAN = cython.declare(cython.double, float("nan"))
# Parts of these many cells are spread evenly: Roberts' sequence in two dimensions.
SPREAD_X = cython.declare(cython.double, 0.7548776662466927)
SPREAD_Y = cython.declare(cython.double, 0.5698402909980532)

Pixel = cython.fused_type(cython.uchar, cython.ushort)


@cython.cfunc
@cython.nogil
@cython.inline
@cython.exceptval(check=False)
def _inside(place: cython.Py_ssize_t, size: cython.Py_ssize_t) -> cython.Py_ssize_t:
    return 0 if place < 0 else size - 1 if place > size - 1 else place


def gather(
    pixels: cython.const[Pixel][::1],
    height: cython.Py_ssize_t,
    width: cython.Py_ssize_t,
    channels: cython.Py_ssize_t,
    places: cython.const[cython.longlong][:, ::1],
    found: Pixel[::1],
) -> cython.void:
    """`found` (N 9 channels,) <- of `pixels` (height width channels,) those about each (x, y) of `places` (N, 2).

    Row by row, all inside the picture: beyond its border, the pixel there.
    """
    cython.declare(n=cython.Py_ssize_t, i=cython.Py_ssize_t, j=cython.Py_ssize_t, k=cython.Py_ssize_t)
    cython.declare(at=cython.Py_ssize_t, here=cython.Py_ssize_t)
    at = 0
    with cython.nogil:
        for n in range(places.shape[0]):
            column: cython.Py_ssize_t = places[n, 0]
            row: cython.Py_ssize_t = places[n, 1]
            for i in range(3):
                for j in range(3):
                    here = (_inside(row + i - 1, height) * width + _inside(column + j - 1, width)) * channels
                    for k in range(channels):
                        found[at] = pixels[here + k]
                        at += 1


def mean_levels(around: cython.const[Pixel][:, :, ::1], means: cython.double[:, ::1]) -> cython.void:
    """`means` (N, channels) <- of pixels (N, 9, channels)."""
    cython.declare(n=cython.Py_ssize_t, i=cython.Py_ssize_t, k=cython.Py_ssize_t)
    with cython.nogil:
        for n in range(around.shape[0]):
            for k in range(around.shape[2]):
                total = 0.0
                for i in range(9):
                    total += around[n, i, k]
                means[n, k] = total / 9


def mean_of_blocks(
    values: cython.const[cython.double][:, :, ::1],
    centre_px: cython.const[cython.double][:, :, ::1],
    share: cython.const[cython.double][:, ::1],
    farthest: cython.const[cython.double][:, ::1],
    mean: cython.double[:, :, ::1],
) -> cython.void:
    """`mean` (rows, columns, 3) <- of the `values` that are finite in the blocks around each; NaN where none is.

    Those (2 K + 1, 2 K + 1) away weigh `share`, none whose centre is farther than `farthest`.
    """
    cython.declare(r=cython.Py_ssize_t, c=cython.Py_ssize_t, i=cython.Py_ssize_t, j=cython.Py_ssize_t)
    cython.declare(row=cython.Py_ssize_t, column=cython.Py_ssize_t, k=cython.Py_ssize_t)
    total, weight = cython.declare(cython.double[3]), cython.declare(cython.double[3])
    rows: cython.Py_ssize_t = values.shape[0]
    columns: cython.Py_ssize_t = values.shape[1]
    reach: cython.Py_ssize_t = share.shape[0] // 2
    with cython.nogil:
        for r in range(rows):
            for c in range(columns):
                for k in range(3):
                    total[k], weight[k] = 0.0, 0.0
                for i in range(2 * reach + 1):
                    row = r + i - reach
                    if not 0 <= row < rows:
                        continue
                    for j in range(2 * reach + 1):
                        column = c + j - reach
                        if not 0 <= column < columns:
                            continue
                        x = centre_px[row, column, 0] - centre_px[r, c, 0]
                        y = centre_px[row, column, 1] - centre_px[r, c, 1]
                        if not sqrt(x * x + y * y) <= farthest[i, j]:
                            continue
                        for k in range(3):
                            if isfinite(values[row, column, k]):
                                total[k] += share[i, j] * values[row, column, k]
                                weight[k] += share[i, j]
                for k in range(3):
                    mean[r, c, k] = total[k] / weight[k] if weight[k] > 0 else NAN


@cython.cfunc
@cython.nogil
@cython.inline
@cython.exceptval(check=False)
def _way(
    rays: cython.const[cython.double][:, ::1],
    k: cython.Py_ssize_t,
    first: cython.Py_ssize_t,
    second: cython.Py_ssize_t,
    clear: cython.double,
) -> cython.int:
    """Which way round the triangle k, first, second runs: 1 or -1; 0 where noise may have made it."""
    ux, uy = rays[first, 0] - rays[k, 0], rays[first, 1] - rays[k, 1]
    vx, vy = rays[second, 0] - rays[k, 0], rays[second, 1] - rays[k, 1]
    area = ux * vy - uy * vx
    if not area * area > clear * ((ux * ux + uy * uy) + (vx * vx + vy * vy)):
        return 0
    return 1 if area > 0 else -1


def turned_over(
    camera_rays: cython.const[cython.double][:, ::1],
    projector_rays: cython.const[cython.double][:, ::1],
    neighbours: cython.const[cython.longlong][:, ::1],
    clear: cython.double,
    fewest: cython.Py_ssize_t,
    found: cython.uchar[::1],
) -> cython.void:
    """`found` (N,) <- about which points all clear triangles with two of the neighbours (N, K) run the other way round
    in the other picture, `fewest` at least. Clear is an area whose square is `clear` times those of its two sides.
    """
    cython.declare(k=cython.Py_ssize_t, i=cython.Py_ssize_t, j=cython.Py_ssize_t)
    cython.declare(alike=cython.Py_ssize_t, other=cython.Py_ssize_t, way=cython.int)
    with cython.nogil:
        for k in range(neighbours.shape[0]):
            alike, other = 0, 0
            for i in range(neighbours.shape[1]):
                for j in range(i + 1, neighbours.shape[1]):
                    way = _way(camera_rays, k, neighbours[k, i], neighbours[k, j], clear)
                    way *= _way(projector_rays, k, neighbours[k, i], neighbours[k, j], clear)
                    alike += way > 0
                    other += way < 0
            found[k] = other >= fewest and alike == 0


@cython.cfunc
@cython.nogil
@cython.inline
@cython.exceptval(check=False)
def _distance(
    pixels: cython.const[cython.double][:, ::1], k: cython.Py_ssize_t, other: cython.Py_ssize_t
) -> cython.double:
    x, y = pixels[k, 0] - pixels[other, 0], pixels[k, 1] - pixels[other, 1]
    return sqrt(x * x + y * y)


def drop_copies(
    camera: cython.const[cython.double][:, ::1],
    projector: cython.const[cython.double][:, ::1],
    noise: cython.const[cython.double][::1],
    reach: cython.double,
    cell: cython.double[:, ::1],
    slot: cython.int[::1],
    table: cython.int[::1],
    kept: cython.uchar[::1],
) -> cython.void:
    """`kept` (N,) <- 0 of places (N, 2) that lie within reach, in both pictures, of the one of least noise in their
    cell; of as much, it is the first. Cells are squares of twice the reach, of four nets: copies lie in one of some.

    `cell` (N, 2), `slot` (N,) and `table`, longer than N, are room: the table says which place is the best of a cell.
    """
    cython.declare(net=cython.int, k=cython.Py_ssize_t, place=cython.Py_ssize_t, best=cython.int)
    size: cython.Py_ssize_t = table.shape[0]
    with cython.nogil:
        for net in range(4):
            for place in range(size):
                table[place] = -1
            for k in range(camera.shape[0]):
                if not kept[k]:
                    continue
                cell[k, 0] = floor(camera[k, 0] / (2 * reach) + 0.5 * (net % 2))
                cell[k, 1] = floor(camera[k, 1] / (2 * reach) + 0.5 * (net // 2))
                part = SPREAD_X * cell[k, 0] + SPREAD_Y * cell[k, 1]
                part -= floor(part)
                place = cython.cast(cython.Py_ssize_t, part * size) if 0 <= part < 1 else 0
                best = table[place]
                while best >= 0 and not (cell[best, 0] == cell[k, 0] and cell[best, 1] == cell[k, 1]):
                    place = place + 1 if place + 1 < size else 0
                    best = table[place]
                slot[k] = place
                if best < 0 or noise[k] < noise[best] or (noise[best] != noise[best] and noise[k] == noise[k]):
                    table[place] = k
            for k in range(camera.shape[0]):
                if kept[k] and table[slot[k]] != k:
                    best = table[slot[k]]
                    if _distance(camera, k, best) < reach and _distance(projector, k, best) < reach:
                        kept[k] = 0
