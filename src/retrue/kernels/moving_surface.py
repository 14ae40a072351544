"""What the points about a place say of where the surface is: moving least squares of oriented points."""

from __future__ import annotations

import cython
from cython.cimports.libc.math import exp, sqrt


def heights(
    places: cython.const[cython.double][:, ::1],
    points: cython.const[cython.double][:, ::1],
    normals: cython.const[cython.double][:, ::1],
    sigma: cython.const[cython.double][::1],
    near: cython.const[cython.longlong][:, ::1],
    reach: cython.double,
    farthest: cython.double,
    value: cython.double[::1],
    normal: cython.double[:, ::1],
    spread: cython.double[::1],
) -> None:
    """`value` (M,), `normal` (M, 3) and `spread` (M,), one sigma, <- f at `places` (M, 3), see `merging.surface`.

    `near` (M, K), K at most 32: rows of `points` (N, 3) that have a say where they lie within `farthest`, N for none.
    A place that no point is near to is left as it is.
    """
    cython.declare(i=cython.Py_ssize_t, k=cython.Py_ssize_t, row=cython.Py_ssize_t)
    weight = cython.declare(cython.double[32])
    with cython.nogil:
        for i in range(places.shape[0]):
            total: cython.double = 0.0
            u: cython.double = 0.0
            v: cython.double = 0.0
            w: cython.double = 0.0
            for k in range(near.shape[1]):
                weight[k] = 0.0
                row = near[i, k]
                if row >= points.shape[0]:
                    continue
                x: cython.double = places[i, 0] - points[row, 0]
                y: cython.double = places[i, 1] - points[row, 1]
                z: cython.double = places[i, 2] - points[row, 2]
                square: cython.double = x * x + y * y + z * z
                if square > farthest * farthest:
                    continue
                weight[k] = exp(-square / (reach * reach)) / (sigma[row] * sigma[row])
                total += weight[k]
                u += weight[k] * normals[row, 0]
                v += weight[k] * normals[row, 1]
                w += weight[k] * normals[row, 2]
            length: cython.double = sqrt(u * u + v * v + w * w)
            if not length > 0.0:
                continue
            u, v, w = u / length, v / length, w / length
            normal[i, 0], normal[i, 1], normal[i, 2] = u, v, w
            away: cython.double = 0.0
            variance: cython.double = 0.0
            for k in range(near.shape[1]):
                if weight[k] > 0.0:
                    row = near[i, k]
                    mean_u: cython.double = normals[row, 0] + u
                    mean_v: cython.double = normals[row, 1] + v
                    mean_w: cython.double = normals[row, 2] + w
                    x = places[i, 0] - points[row, 0]
                    y = places[i, 1] - points[row, 1]
                    z = places[i, 2] - points[row, 2]
                    length = sqrt(mean_u * mean_u + mean_v * mean_v + mean_w * mean_w)
                    away += weight[k] * (mean_u * x + mean_v * y + mean_w * z) / length
                    variance += weight[k] * weight[k] * sigma[row] * sigma[row]
            value[i] = away / total
            spread[i] = sqrt(variance) / total
