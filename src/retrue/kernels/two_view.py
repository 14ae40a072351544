"""Both residuals of points seen in two views, and their normal equations, in one pass over the points.

No Jacobian is kept: a row is made, weighed and added up. The equations, units and unknowns are those of
`geometry.two_view`.
"""

from __future__ import annotations

import cython
from cython.cimports.libc.math import sqrt

NAN = cython.declare(cython.double, float("nan"))
EDGE_ON = cython.declare(cython.double, 1e-12)  # of the variance along the line: below it a plane tells nothing there
POSE = cython.declare(cython.Py_ssize_t, 5)
UNKNOWNS = cython.declare(cython.Py_ssize_t, 8)  # of one point: the pose, and n of its plane
MOST_EXTRA = cython.declare(cython.Py_ssize_t, 32)  # columns that a caller adds to the 8 of pose and plane

Vector = cython.struct(x=cython.double, y=cython.double, z=cython.double)


@cython.cfunc
@cython.inline
@cython.exceptval(check=False)
def _cross(a: Vector, b: Vector) -> Vector:
    return Vector(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


@cython.cfunc
@cython.inline
@cython.exceptval(check=False)
def _dot(a: Vector, b: Vector) -> cython.double:
    return a.x * b.x + a.y * b.y + a.z * b.z


@cython.cfunc
@cython.inline
@cython.exceptval(check=False)
def _add(
    square: cython.p_double,
    block: cython.double[:, ::1],
    row: cython.p_double,
    weight: cython.double,
    used: cython.Py_ssize_t,
) -> cython.void:
    """weight row row^T: the unknowns with each other into `square`, and each later column with those before it."""
    for i in range(used):
        scaled: cython.double = weight * row[i]
        for j in range(i + 1):
            square[UNKNOWNS * i + j] += scaled * row[j]
    for i in range(UNKNOWNS, block.shape[0]):
        scaled = weight * row[i]
        for j in range(i + 1):
            block[i, j] += scaled * row[j]


@cython.cfunc
@cython.exceptval(check=False)
def _flush(square: cython.p_double, block: cython.double[:, ::1]) -> cython.void:
    """Move the sums into the block."""
    for i in range(UNKNOWNS):
        for j in range(i + 1):
            block[i, j] += square[UNKNOWNS * i + j]
            square[UNKNOWNS * i + j] = 0.0


def two_view(
    R: cython.const[cython.double][:, ::1],
    axes: cython.const[cython.double][:, ::1],
    planes: cython.const[cython.double][:, ::1],
    camera_rays: cython.const[cython.double][:, ::1],
    projector_rays: cython.const[cython.double][:, ::1],
    camera_sigma: cython.const[cython.double][::1],
    projector_sigma: cython.const[cython.double][::1],
    plane_index: cython.const[cython.longlong][::1],
    residuals: cython.double[:, ::1],
    weights: cython.const[cython.double][:, ::1],
    columns: cython.const[cython.double][:, :, ::1],
    camera_turns: cython.const[cython.double][:, :, ::1],
    projector_turns: cython.const[cython.double][:, :, ::1],
    blocks: cython.double[:, :, ::1],
) -> None:
    """Fill the residuals; or, where weights are given, add up [J C]^T W [J C] of each plane.

    Parameters
    ----------
    R, axes, planes : (3, 3) of the pose; t, and the two axes across it; (P, 3).
    camera_rays, projector_rays, camera_sigma, projector_sigma, plane_index : N points as in `TwoViewPoints`.
    residuals : (2, N) across and along the epipolar line; NaN where there is none.
    weights : (2, N) of either, or none.
    columns : C (K, 2, N), whatever else there is for each residual: the first is the residual itself.
    camera_turns, projector_turns : (N, 2, A) and (N, 2, B) how further unknowns move the rays of either device, or
        none; the first of each is the log of the focal length, which divides the sigma of those rays, too.
    blocks : (P + 1, 8 + K + A + B, the same), of the points on each plane: the pose, its n, and C, and how the
        residuals change with those unknowns; and of all points across the line. Added to, as far as the other triangle
        follows.
    """
    cython.declare(i=cython.Py_ssize_t, k=cython.Py_ssize_t)
    adds: cython.bint = weights.shape[1] > 0
    extra: cython.Py_ssize_t = columns.shape[0]
    first_turn: cython.Py_ssize_t = UNKNOWNS + extra
    turns: cython.Py_ssize_t = camera_turns.shape[2]
    more_turns: cython.Py_ssize_t = projector_turns.shape[2]
    last: cython.Py_ssize_t = -1  # the plane that `on_plane` has the sums of
    across, on_plane = cython.declare(cython.double[64]), cython.declare(cython.double[64])
    for i in range(64):
        across[i], on_plane[i] = 0.0, 0.0
    row = cython.declare(cython.double[40])
    if extra + turns + more_turns > MOST_EXTRA:
        raise ValueError("two views: more columns than a row holds")
    r1, r2, r3 = Vector(R[0, 0], R[0, 1], R[0, 2]), Vector(R[1, 0], R[1, 1], R[1, 2]), Vector(R[2, 0], R[2, 1], R[2, 2])
    t = Vector(axes[0, 0], axes[0, 1], axes[0, 2])
    first, second = Vector(axes[1, 0], axes[1, 1], axes[1, 2]), Vector(axes[2, 0], axes[2, 1], axes[2, 2])
    # E = [t]x R, column by column.
    E1 = _cross(t, Vector(r1.x, r2.x, r3.x))
    E2 = _cross(t, Vector(r1.y, r2.y, r3.y))
    E3 = _cross(t, Vector(r1.z, r2.z, r3.z))
    for k in range(camera_rays.shape[0]):
        plane: cython.Py_ssize_t = plane_index[k]
        if adds and not (weights[0, k] > 0 or weights[1, k] > 0):
            continue
        vx: cython.double = camera_sigma[k] * camera_sigma[k]
        vy: cython.double = projector_sigma[k] * projector_sigma[k]
        x = Vector(camera_rays[k, 0], camera_rays[k, 1], 1.0)
        y = Vector(projector_rays[k, 0], projector_rays[k, 1], 1.0)
        # Lines l = E x and m = E^T y; then the same at the corrected rays.
        lx, ly = E1.x * x.x + E2.x * x.y + E3.x, E1.y * x.x + E2.y * x.y + E3.y
        lz = E1.z * x.x + E2.z * x.y + E3.z
        mx, my = _dot(E1, y), _dot(E2, y)
        gain = (lx * y.x + ly * y.y + lz) / (vy * (lx * lx + ly * ly) + vx * (mx * mx + my * my))
        dx, dy = vx * gain * mx, vx * gain * my
        ex, ey = vy * gain * lx, vy * gain * ly
        x, y = Vector(x.x - dx, x.y - dy, 1.0), Vector(y.x - ex, y.y - ey, 1.0)
        lx, ly = E1.x * x.x + E2.x * x.y + E3.x, E1.y * x.x + E2.y * x.y + E3.y
        lz = E1.z * x.x + E2.z * x.y + E3.z
        mx, my = _dot(E1, y), _dot(E2, y)
        scale = 1 / sqrt(vy * (lx * lx + ly * ly) + vx * (mx * mx + my * my))
        v = Vector(_dot(r1, x), _dot(r2, x), _dot(r3, x))
        if not adds:
            value = lx * y.x + ly * y.y + lz + lx * ex + ly * ey + mx * dx + my * dy
            residuals[0, k], residuals[1, k] = value * scale, NAN
        elif weights[0, k] > 0:
            # e = y . (t x v): by w it is v x (y x t), by t it is v x y.
            turned, shifted = _cross(v, _cross(y, t)), _cross(v, y)
            row[0], row[1], row[2] = turned.x * scale, turned.y * scale, turned.z * scale
            row[3], row[4] = _dot(first, shifted) * scale, _dot(second, shifted) * scale
            row[5], row[6], row[7] = 0.0, 0.0, 0.0
            for i in range(extra):
                row[UNKNOWNS + i] = columns[i, 0, k]
            for i in range(turns):
                row[first_turn + i] = (mx * camera_turns[k, 0, i] + my * camera_turns[k, 1, i]) * scale
            for i in range(more_turns):
                row[first_turn + turns + i] = (lx * projector_turns[k, 0, i] + ly * projector_turns[k, 1, i]) * scale
            if turns > 0:
                row[first_turn] += columns[0, 0, k] * scale * scale * vx * (mx * mx + my * my)
            if more_turns > 0:
                row[first_turn + turns] += columns[0, 0, k] * scale * scale * vy * (lx * lx + ly * ly)
            _add(across, blocks[planes.shape[0]], row, weights[0, k], 5)
        if plane < 0 or (adds and not weights[1, k] > 0):
            continue
        n = Vector(planes[plane, 0], planes[plane, 1], planes[plane, 2])
        disparity = _dot(n, x)  # |t| / depth
        closeness = 1 / (v.z + disparity * t.z)
        hx, hy = (v.x + disparity * t.x) * closeness, (v.y + disparity * t.y) * closeness
        # d h / d x, of h = H x with H = R + t n^T.
        H31, H32 = r3.x + t.z * n.x, r3.y + t.z * n.y
        j11, j12 = (r1.x + t.x * n.x - hx * H31) * closeness, (r1.y + t.x * n.y - hx * H32) * closeness
        j21, j22 = (r2.x + t.y * n.x - hy * H31) * closeness, (r2.y + t.y * n.y - hy * H32) * closeness
        inverse = 1 / sqrt(lx * lx + ly * ly)
        ax, ay = lx * inverse, ly * inverse  # across the epipolar line; (-ay, ax) runs along it
        c11, c12 = vy + vx * (j11 * j11 + j12 * j12), vx * (j11 * j21 + j12 * j22)
        c22 = vy + vx * (j21 * j21 + j22 * j22)
        across_variance = ax * ax * c11 + 2 * ax * ay * c12 + ay * ay * c22
        along_variance = ay * ay * c11 - 2 * ax * ay * c12 + ax * ax * c22
        covariance = ax * ay * (c22 - c11) + (ax * ax - ay * ay) * c12
        slope = covariance / across_variance
        left = along_variance - slope * covariance
        scale = 1 / sqrt(left) if left > EDGE_ON * along_variance else 0.0
        gx, gy = (-ay - slope * ax) * scale, (ax - slope * ay) * scale  # residual = g . (y - h)
        if not adds:
            residuals[1, k] = gx * (projector_rays[k, 0] - hx - j11 * dx - j12 * dy) + gy * (
                projector_rays[k, 1] - hy - j21 * dx - j22 * dy
            )
            continue
        # d h = (I, -h) d w / depth for w = H x, so that g . d h = -p . d w with:
        p = Vector(-gx * closeness, -gy * closeness, (gx * hx + gy * hy) * closeness)
        turned, pulled = _cross(v, p), _dot(t, p)
        row[0], row[1], row[2] = turned.x, turned.y, turned.z
        row[3], row[4] = _dot(first, p) * disparity, _dot(second, p) * disparity
        row[5], row[6], row[7] = pulled * x.x, pulled * x.y, pulled
        for i in range(extra):
            row[UNKNOWNS + i] = columns[i, 1, k]
        if turns > 0 or more_turns > 0:
            qx, qy = gx * j11 + gy * j21, gx * j12 + gy * j22
            for i in range(turns):
                row[first_turn + i] = -qx * camera_turns[k, 0, i] - qy * camera_turns[k, 1, i]
            for i in range(more_turns):
                row[first_turn + turns + i] = gx * projector_turns[k, 0, i] + gy * projector_turns[k, 1, i]
        if scale > 0:  # with the sigmas, both the scale of this residual and its share of the other one change
            off_x = projector_rays[k, 0] - hx - j11 * dx - j12 * dy
            off_y = projector_rays[k, 1] - hy - j21 * dx - j22 * dy
            sideways = (ax * off_x + ay * off_y) * scale
            half = 0.5 * columns[0, 1, k] / left if turns > 0 or more_turns > 0 else 0.0
            if turns > 0:
                d_across, d_along, d_both = across_variance - vy, along_variance - vy, covariance
                d_slope = (d_both - slope * d_across) / across_variance
                d_left = d_along - 2 * slope * d_both + slope * slope * d_across
                row[first_turn] += 2 * (d_slope * sideways + half * d_left)
            if more_turns > 0:
                d_slope, d_left = -slope * vy / across_variance, vy + slope * slope * vy
                row[first_turn + turns] += 2 * (d_slope * sideways + half * d_left)
        if plane != last:
            if last >= 0:
                _flush(on_plane, blocks[last])
            last = plane
        _add(on_plane, blocks[plane], row, weights[1, k], 8)
    if adds:
        _flush(across, blocks[planes.shape[0]])
        if last >= 0:
            _flush(on_plane, blocks[last])
