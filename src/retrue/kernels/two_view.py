"""Both residuals of points seen in two views, and their normal equations, in one pass over the points.

No Jacobian is kept: a row is made, weighed and added up. The equations, units and unknowns are those of
`geometry.two_view`. A point that weighs along the epipolar line, too, is linearised where its plane has it, another one
on its line: so a change of the lenses that the pose makes up for changes no row at all.
"""

from __future__ import annotations

import cython
from cython.cimports.libc.math import sqrt

NAN = cython.declare(cython.double, float("nan"))
EDGE_ON = cython.declare(cython.double, 1e-12)  # of the variance along the line: below it a plane tells nothing there
SMALLEST = cython.declare(cython.double, 1e-12)
FURTHER = cython.declare(cython.double, 4.0)  # sigma of a depth, that a point on no plane must be behind by
UNKNOWNS = cython.declare(cython.Py_ssize_t, 8)  # of one point: the pose, and n of its plane
MOST_EXTRA = cython.declare(cython.Py_ssize_t, 32)  # columns that a caller adds to the 8 of pose and plane

Vector = cython.struct(x=cython.double, y=cython.double, z=cython.double)
Essential = cython.struct(r1=Vector, r2=Vector, r3=Vector, t=Vector, e1=Vector, e2=Vector, e3=Vector)  # rows, columns
Pair = cython.struct(  # corrected rays on each other's epipolar line, and the lines
    x=Vector,
    y=Vector,
    dx=cython.double,
    dy=cython.double,
    ex=cython.double,
    ey=cython.double,
    lx=cython.double,
    ly=cython.double,
    lz=cython.double,
    v=Vector,
)
Seen = cython.struct(  # of a plane, through x: n . x, |t| / depth, 1 / depth in the projector, and where
    flat=cython.double,
    disparity=cython.double,
    closeness=cython.double,
    x=cython.double,
    y=cython.double,
)


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
    filled: cython.Py_ssize_t,
) -> cython.void:
    """weight row row^T: the `used` unknowns with each other into `square`, later columns, if filled, with all."""
    for i in range(used):
        scaled: cython.double = weight * row[i]
        for j in range(i + 1):
            square[UNKNOWNS * i + j] += scaled * row[j]
    for i in range(UNKNOWNS, filled):
        scaled = weight * row[i]
        for j in range(used):
            block[i, j] += scaled * row[j]
        for j in range(UNKNOWNS, i + 1):
            block[i, j] += scaled * row[j]


@cython.cfunc
@cython.exceptval(check=False)
def _flush(square: cython.p_double, block: cython.double[:, ::1]) -> cython.void:
    """Move the sums into the block."""
    for i in range(UNKNOWNS):
        for j in range(i + 1):
            block[i, j] += square[UNKNOWNS * i + j]
            square[UNKNOWNS * i + j] = 0.0


@cython.cfunc
@cython.inline
@cython.exceptval(check=False)
def _essential(R: cython.const[cython.double][:, ::1], axes: cython.const[cython.double][:, ::1]) -> Essential:
    """E = [t]x R, column by column."""
    r1, r2, r3 = Vector(R[0, 0], R[0, 1], R[0, 2]), Vector(R[1, 0], R[1, 1], R[1, 2]), Vector(R[2, 0], R[2, 1], R[2, 2])
    t = Vector(axes[0, 0], axes[0, 1], axes[0, 2])
    return Essential(
        r1,
        r2,
        r3,
        t,
        _cross(t, Vector(r1.x, r2.x, r3.x)),
        _cross(t, Vector(r1.y, r2.y, r3.y)),
        _cross(t, Vector(r1.z, r2.z, r3.z)),
    )


@cython.cfunc
@cython.inline
@cython.exceptval(check=False)
def _corrected(E: Essential, x: Vector, y: Vector, vx: cython.double, vy: cython.double) -> Pair:
    """The rays moved onto each other's epipolar line, by their variances."""
    lx, ly = E.e1.x * x.x + E.e2.x * x.y + E.e3.x, E.e1.y * x.x + E.e2.y * x.y + E.e3.y
    lz = E.e1.z * x.x + E.e2.z * x.y + E.e3.z
    mx, my = _dot(E.e1, y), _dot(E.e2, y)
    gain = (lx * y.x + ly * y.y + lz) / (vy * (lx * lx + ly * ly) + vx * (mx * mx + my * my))
    dx, dy = vx * gain * mx, vx * gain * my
    ex, ey = vy * gain * lx, vy * gain * ly
    x, y = Vector(x.x - dx, x.y - dy, 1.0), Vector(y.x - ex, y.y - ey, 1.0)
    return Pair(
        x,
        y,
        dx,
        dy,
        ex,
        ey,
        E.e1.x * x.x + E.e2.x * x.y + E.e3.x,
        E.e1.y * x.x + E.e2.y * x.y + E.e3.y,
        E.e1.z * x.x + E.e2.z * x.y + E.e3.z,
        Vector(_dot(E.r1, x), _dot(E.r2, x), _dot(E.r3, x)),
    )


@cython.cfunc
@cython.inline
@cython.exceptval(check=False)
def _seen(E: Essential, n: Vector, bend: cython.double, x: Vector, v: Vector) -> Seen:
    """Where the projector sees what the ray x = R^T v meets of the plane n, `bend` of its disparity nearer."""
    flat = _dot(n, x)
    disparity = flat * (1 + bend)
    closeness = 1 / (v.z + disparity * E.t.z)
    return Seen(
        flat, disparity, closeness, (v.x + disparity * E.t.x) * closeness, (v.y + disparity * E.t.y) * closeness
    )


def corrected_rays(
    R: cython.const[cython.double][:, ::1],
    axes: cython.const[cython.double][:, ::1],
    planes: cython.const[cython.double][:, ::1],
    camera_rays: cython.const[cython.double][:, ::1],
    projector_rays: cython.const[cython.double][:, ::1],
    camera_sigma: cython.const[cython.double][::1],
    projector_sigma: cython.const[cython.double][::1],
    plane_index: cython.const[cython.longlong][::1],
    bends: cython.const[cython.double][:, ::1],
    bows: cython.const[cython.double][:, ::1],
    weights: cython.const[cython.double][:, ::1],
    corrected: cython.double[:, :, ::1],
) -> None:
    """`corrected` (2, N, 2) <- the rays of both devices at which `two_view` makes the rows of those weights."""
    cython.declare(k=cython.Py_ssize_t, i=cython.Py_ssize_t)
    E = _essential(R, axes)
    for k in range(camera_rays.shape[0]):
        plane: cython.Py_ssize_t = plane_index[k]
        x = Vector(camera_rays[k, 0], camera_rays[k, 1], 1.0)
        y = Vector(projector_rays[k, 0], projector_rays[k, 1], 1.0)
        at = _corrected(E, x, y, camera_sigma[k] * camera_sigma[k], projector_sigma[k] * projector_sigma[k])
        corrected[0, k, 0], corrected[0, k, 1] = at.x.x, at.x.y
        corrected[1, k, 0], corrected[1, k, 1] = at.y.x, at.y.y
        if plane >= 0 and weights[1, k] > 0:
            bend = 0.0
            for i in range(bends.shape[1]):
                bend += bends[k, i] * bows[plane, i]
            seen = _seen(E, Vector(planes[plane, 0], planes[plane, 1], planes[plane, 2]), bend, at.x, at.v)
            corrected[1, k, 0], corrected[1, k, 1] = seen.x, seen.y


def two_view(
    R: cython.const[cython.double][:, ::1],
    axes: cython.const[cython.double][:, ::1],
    planes: cython.const[cython.double][:, ::1],
    camera_rays: cython.const[cython.double][:, ::1],
    projector_rays: cython.const[cython.double][:, ::1],
    camera_sigma: cython.const[cython.double][::1],
    projector_sigma: cython.const[cython.double][::1],
    plane_index: cython.const[cython.longlong][::1],
    bends: cython.const[cython.double][:, ::1],
    bows: cython.const[cython.double][:, ::1],
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
    bends, bows : (N, B) and (P, B): the share of its plane's disparity that each bow of it moves a point by; or none.
    residuals : (2, N) across and along the epipolar line; NaN where there is none.
    weights : (2, N) of either, or none.
    columns : C (K, 2, N), whatever else there is for each residual.
    camera_turns, projector_turns : (N, 2, A) how further unknowns move the rays of either device, at `corrected_rays`;
        or none.
    blocks : (P + 1, 8 + K + 2 A + B, the same), of the points on each plane: the pose, its n, and C, and how the
        residuals change with those unknowns and with the plane's bows; and of all points across the line. Added to, as
        far as the other triangle follows.
    """
    cython.declare(i=cython.Py_ssize_t, k=cython.Py_ssize_t)
    adds: cython.bint = weights.shape[1] > 0
    extra: cython.Py_ssize_t = columns.shape[0]
    first_turn: cython.Py_ssize_t = UNKNOWNS + extra
    turns: cython.Py_ssize_t = camera_turns.shape[2]
    first_bow: cython.Py_ssize_t = first_turn + 2 * turns
    last: cython.Py_ssize_t = -1  # the plane that `on_plane` has the sums of
    across, on_plane = cython.declare(cython.double[64]), cython.declare(cython.double[64])
    for i in range(64):
        across[i], on_plane[i] = 0.0, 0.0
    row = cython.declare(cython.double[40])
    if extra + 2 * turns + bends.shape[1] > MOST_EXTRA:
        raise ValueError("two views: more columns than a row holds")
    E = _essential(R, axes)
    t = E.t
    first, second = Vector(axes[1, 0], axes[1, 1], axes[1, 2]), Vector(axes[2, 0], axes[2, 1], axes[2, 2])
    for k in range(camera_rays.shape[0]):
        plane: cython.Py_ssize_t = plane_index[k]
        if adds and not (weights[0, k] > 0 or weights[1, k] > 0):
            continue
        vx: cython.double = camera_sigma[k] * camera_sigma[k]
        vy: cython.double = projector_sigma[k] * projector_sigma[k]
        x = Vector(camera_rays[k, 0], camera_rays[k, 1], 1.0)
        y = Vector(projector_rays[k, 0], projector_rays[k, 1], 1.0)
        at = _corrected(E, x, y, vx, vy)
        x, y, v = at.x, at.y, at.v
        on: cython.bint = plane >= 0 and not (adds and not weights[1, k] > 0)
        n, bend = Vector(0.0, 0.0, 0.0), 0.0
        if on:
            for i in range(bends.shape[1]):
                bend += bends[k, i] * bows[plane, i]
            n = Vector(planes[plane, 0], planes[plane, 1], planes[plane, 2])
        seen = _seen(E, n, bend, x, v)
        if adds and on:
            y = Vector(seen.x, seen.y, 1.0)
        mx, my = _dot(E.e1, y), _dot(E.e2, y)
        scale = 1 / sqrt(vy * (at.lx * at.lx + at.ly * at.ly) + vx * (mx * mx + my * my))
        if not adds:
            value = at.lx * y.x + at.ly * y.y + at.lz + at.lx * at.ex + at.ly * at.ey + mx * at.dx + my * at.dy
            residuals[0, k], residuals[1, k] = value * scale, NAN
        elif weights[0, k] > 0:
            # e = y . (t x v): by w it is v x (y x t), by t it is v x y.
            turned, shifted = _cross(v, _cross(y, t)), _cross(v, y)
            row[0], row[1], row[2] = turned.x * scale, turned.y * scale, turned.z * scale
            row[3], row[4] = _dot(first, shifted) * scale, _dot(second, shifted) * scale
            for i in range(extra):
                row[UNKNOWNS + i] = columns[i, 0, k]
            for i in range(turns):
                row[first_turn + i] = (mx * camera_turns[k, 0, i] + my * camera_turns[k, 1, i]) * scale
                row[first_turn + turns + i] = (
                    at.lx * projector_turns[k, 0, i] + at.ly * projector_turns[k, 1, i]
                ) * scale
            _add(across, blocks[planes.shape[0]], row, weights[0, k], 5, first_bow)
        if not on:
            continue
        # d h / d x, of h = H x with H = R + (1 + bend) t n^T.
        closeness, hx, hy = seen.closeness, seen.x, seen.y
        bent = Vector(n.x * (1 + bend), n.y * (1 + bend), n.z * (1 + bend))
        H31, H32 = E.r3.x + t.z * bent.x, E.r3.y + t.z * bent.y
        j11, j12 = (E.r1.x + t.x * bent.x - hx * H31) * closeness, (E.r1.y + t.x * bent.y - hx * H32) * closeness
        j21, j22 = (E.r2.x + t.y * bent.x - hy * H31) * closeness, (E.r2.y + t.y * bent.y - hy * H32) * closeness
        inverse = 1 / sqrt(at.lx * at.lx + at.ly * at.ly)
        ax, ay = at.lx * inverse, at.ly * inverse  # across the epipolar line; (-ay, ax) runs along it
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
            residuals[1, k] = gx * (projector_rays[k, 0] - hx - j11 * at.dx - j12 * at.dy) + gy * (
                projector_rays[k, 1] - hy - j21 * at.dx - j22 * at.dy
            )
            continue
        # d h = (I, -h) d w / depth for w = H x, so that g . d h = -p . d w with:
        p = Vector(-gx * closeness, -gy * closeness, (gx * hx + gy * hy) * closeness)
        turned, pulled = _cross(v, p), _dot(t, p)
        row[0], row[1], row[2] = turned.x, turned.y, turned.z
        row[3], row[4] = _dot(first, p) * seen.disparity, _dot(second, p) * seen.disparity
        by_n = pulled * (1 + bend)
        row[5], row[6], row[7] = by_n * x.x, by_n * x.y, by_n
        for i in range(extra):
            row[UNKNOWNS + i] = columns[i, 1, k]
        if turns > 0:
            qx, qy = gx * j11 + gy * j21, gx * j12 + gy * j22
            for i in range(turns):
                row[first_turn + i] = -qx * camera_turns[k, 0, i] - qy * camera_turns[k, 1, i]
                row[first_turn + turns + i] = gx * projector_turns[k, 0, i] + gy * projector_turns[k, 1, i]
        for i in range(bends.shape[1]):
            row[first_bow + i] = pulled * seen.flat * bends[k, i]
        if plane != last:
            if last >= 0:
                _flush(on_plane, blocks[last])
            last = plane
        _add(on_plane, blocks[plane], row, weights[1, k], 8, blocks.shape[1])
    if adds:
        _flush(across, blocks[planes.shape[0]])
        if last >= 0:
            _flush(on_plane, blocks[last])


def behind(
    R: cython.const[cython.double][:, ::1],
    axes: cython.const[cython.double][:, ::1],
    planes: cython.const[cython.double][:, ::1],
    camera_rays: cython.const[cython.double][:, ::1],
    projector_rays: cython.const[cython.double][:, ::1],
    camera_sigma: cython.const[cython.double][::1],
    projector_sigma: cython.const[cython.double][::1],
    plane_index: cython.const[cython.longlong][::1],
    level: cython.double,
    found: cython.uchar[::1],
) -> None:
    """`found` (N,) <- whether a point lies behind a device, or its plane faces away from one; noise of that level.

    A pose that has no planes sees every point as on none.
    """
    cython.declare(k=cython.Py_ssize_t)
    tx, ty, tz = axes[0, 0], axes[0, 1], axes[0, 2]
    bx, by = R[0, 0] * tx + R[1, 0] * ty + R[2, 0] * tz, R[0, 1] * tx + R[1, 1] * ty + R[2, 1] * tz  # R^T t
    bz = R[0, 2] * tx + R[1, 2] * ty + R[2, 2] * tz
    for k in range(camera_rays.shape[0]):
        plane: cython.Py_ssize_t = plane_index[k]
        x, y = camera_rays[k, 0], camera_rays[k, 1]
        depth = R[2, 0] * x + R[2, 1] * y + R[2, 2]
        if 0 <= plane < planes.shape[0]:  # both devices are on one side of a surface: no light comes through it
            least = 0.0
            disparity = planes[plane, 0] * x + planes[plane, 1] * y + planes[plane, 2]
            if not 1 + planes[plane, 0] * bx + planes[plane, 1] * by + planes[plane, 2] * bz > 0:
                disparity = -1.0
        else:  # y ~ R x + rho t along the epipolar line, by least squares
            a, b = tx - projector_rays[k, 0] * tz, ty - projector_rays[k, 1] * tz
            c = projector_rays[k, 0] * depth - (R[0, 0] * x + R[0, 1] * y + R[0, 2])
            d = projector_rays[k, 1] * depth - (R[1, 0] * x + R[1, 1] * y + R[1, 2])
            square = max(a * a + b * b, SMALLEST * SMALLEST)
            disparity = (a * c + b * d) / square
            variance = camera_sigma[k] * camera_sigma[k] + projector_sigma[k] * projector_sigma[k]
            least = -FURTHER * level * sqrt(variance / square)
        found[k] = disparity <= least or depth + disparity * tz <= 0
