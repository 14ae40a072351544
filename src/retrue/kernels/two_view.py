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
LOT = cython.declare(cython.Py_ssize_t, 16)  # points at a time: one after the other, each would wait for its divisions
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
    columns : C (K, 2, N), whatever else there is for each residual; (K, 1, N) leave out the rows along the line.
    camera_turns, projector_turns : (N, 2, A) how further unknowns move rays, at the `corrected_rays`; or none.
    blocks : (P + 1, 8 + K + 2 A + B, the same), of the points on each plane: the pose, its n, and C, and how the
        residuals change with those unknowns and with the plane's bows; and of all points across the line. Added to, as
        far as the other triangle follows.
    """
    cython.declare(i=cython.Py_ssize_t, k=cython.Py_ssize_t, m=cython.Py_ssize_t)
    adds: cython.bint = weights.shape[1] > 0
    extra: cython.Py_ssize_t = columns.shape[0]
    first_turn: cython.Py_ssize_t = UNKNOWNS + extra
    turns: cython.Py_ssize_t = camera_turns.shape[2]
    first_bow: cython.Py_ssize_t = first_turn + 2 * turns
    last: cython.Py_ssize_t = -1  # the plane that `on_plane` has the sums of
    across, on_plane = cython.declare(cython.double[64]), cython.declare(cython.double[64])
    for i in range(64):
        across[i], on_plane[i] = 0.0, 0.0
    row, flat = cython.declare(cython.double[40]), cython.declare(cython.double[16])
    index, on = cython.declare(cython.Py_ssize_t[16]), cython.declare(cython.bint[16])  # of the points of a lot
    nx, ny, nz = cython.declare(cython.double[16]), cython.declare(cython.double[16]), cython.declare(cython.double[16])
    lx, ly, lz = cython.declare(cython.double[16]), cython.declare(cython.double[16]), cython.declare(cython.double[16])
    v1, v2, v3 = cython.declare(cython.double[16]), cython.declare(cython.double[16]), cython.declare(cython.double[16])
    hx, hy, hz = cython.declare(cython.double[16]), cython.declare(cython.double[16]), cython.declare(cython.double[16])
    cx, cy, px = cython.declare(cython.double[16]), cython.declare(cython.double[16]), cython.declare(cython.double[16])
    py, vx, vy = cython.declare(cython.double[16]), cython.declare(cython.double[16]), cython.declare(cython.double[16])
    dx, dy, ex = cython.declare(cython.double[16]), cython.declare(cython.double[16]), cython.declare(cython.double[16])
    ey, gx, gy = cython.declare(cython.double[16]), cython.declare(cython.double[16]), cython.declare(cython.double[16])
    mx, my, by = cython.declare(cython.double[16]), cython.declare(cython.double[16]), cython.declare(cython.double[16])
    j11, j12 = cython.declare(cython.double[16]), cython.declare(cython.double[16])
    j21, j22 = cython.declare(cython.double[16]), cython.declare(cython.double[16])
    bow, rho = cython.declare(cython.double[16]), cython.declare(cython.double[16])
    if extra + 2 * turns + bends.shape[1] > MOST_EXTRA:
        raise ValueError("two views: more columns than a row holds")
    E = _essential(R, axes)
    t = E.t
    first, second = Vector(axes[1, 0], axes[1, 1], axes[1, 2]), Vector(axes[2, 0], axes[2, 1], axes[2, 2])
    following: cython.Py_ssize_t = 0
    while following < camera_rays.shape[0]:
        taken: cython.Py_ssize_t = 0
        some: cython.bint = False  # on a plane
        while taken < LOT and following < camera_rays.shape[0]:
            k = following
            following += 1
            if adds and not (weights[0, k] > 0 or weights[1, k] > 0):
                continue
            plane: cython.Py_ssize_t = plane_index[k]
            index[taken], on[taken] = k, plane >= 0 and not (adds and not weights[1, k] > 0)
            cx[taken], cy[taken] = camera_rays[k, 0], camera_rays[k, 1]
            px[taken], py[taken] = projector_rays[k, 0], projector_rays[k, 1]
            vx[taken], vy[taken] = camera_sigma[k] * camera_sigma[k], projector_sigma[k] * projector_sigma[k]
            nx[taken], ny[taken], nz[taken], bend = 0.0, 0.0, 0.0, 0.0
            if on[taken]:
                some = True
                for i in range(bends.shape[1]):
                    bend += bends[k, i] * bows[plane, i]
                nx[taken], ny[taken], nz[taken] = planes[plane, 0], planes[plane, 1], planes[plane, 2]
            bow[taken] = bend
            taken += 1
        if taken == 0:
            break
        for m in range(taken, LOT):  # all are computed
            cx[m], cy[m], px[m], py[m], vx[m], vy[m] = cx[0], cy[0], px[0], py[0], vx[0], vy[0]
            nx[m], ny[m], nz[m], bow[m], on[m] = 0.0, 0.0, 0.0, 0.0, False
        for m in range(LOT):
            at = _corrected(E, Vector(cx[m], cy[m], 1.0), Vector(px[m], py[m], 1.0), vx[m], vy[m])
            cx[m], cy[m], px[m], py[m] = at.x.x, at.x.y, at.y.x, at.y.y
            dx[m], dy[m], ex[m], ey[m] = at.dx, at.dy, at.ex, at.ey
            lx[m], ly[m], lz[m] = at.lx, at.ly, at.lz
            v1[m], v2[m], v3[m] = at.v.x, at.v.y, at.v.z
        if some:
            for m in range(LOT):
                n, x, v = Vector(nx[m], ny[m], nz[m]), Vector(cx[m], cy[m], 1.0), Vector(v1[m], v2[m], v3[m])
                seen = _seen(E, n, bow[m], x, v)
                flat[m], rho[m], hx[m], hy[m], hz[m] = seen.flat, seen.disparity, seen.x, seen.y, seen.closeness
                px[m], py[m] = seen.x if adds and on[m] else px[m], seen.y if adds and on[m] else py[m]
        for m in range(LOT):
            y = Vector(px[m], py[m], 1.0)
            mx[m], my[m] = _dot(E.e1, y), _dot(E.e2, y)
            by[m] = 1 / sqrt(vy[m] * (lx[m] * lx[m] + ly[m] * ly[m]) + vx[m] * (mx[m] * mx[m] + my[m] * my[m]))
        if not adds:
            for m in range(taken):
                value = lx[m] * px[m] + ly[m] * py[m] + lz[m] + lx[m] * ex[m] + ly[m] * ey[m]
                value = value + mx[m] * dx[m] + my[m] * dy[m]
                residuals[0, index[m]], residuals[1, index[m]] = value * by[m], NAN
        if some:
            for m in range(LOT):
                # d h / d x, of h = H x with H = R + (1 + bend) t n^T.
                b1, b2 = nx[m] * (1 + bow[m]), ny[m] * (1 + bow[m])
                H31, H32 = E.r3.x + t.z * b1, E.r3.y + t.z * b2
                j11[m], j12[m] = E.r1.x + t.x * b1 - hx[m] * H31, E.r1.y + t.x * b2 - hx[m] * H32
                j21[m], j22[m] = E.r2.x + t.y * b1 - hy[m] * H31, E.r2.y + t.y * b2 - hy[m] * H32
                j11[m], j12[m], j21[m], j22[m] = j11[m] * hz[m], j12[m] * hz[m], j21[m] * hz[m], j22[m] * hz[m]
                inverse = 1 / sqrt(lx[m] * lx[m] + ly[m] * ly[m])
                ax, ay = lx[m] * inverse, ly[m] * inverse  # across the epipolar line; (-ay, ax) runs along it
                c11 = vy[m] + vx[m] * (j11[m] * j11[m] + j12[m] * j12[m])
                c12 = vx[m] * (j11[m] * j21[m] + j12[m] * j22[m])
                c22 = vy[m] + vx[m] * (j21[m] * j21[m] + j22[m] * j22[m])
                across_variance = ax * ax * c11 + 2 * ax * ay * c12 + ay * ay * c22
                along_variance = ay * ay * c11 - 2 * ax * ay * c12 + ax * ax * c22
                covariance = ax * ay * (c22 - c11) + (ax * ax - ay * ay) * c12
                slope = covariance / across_variance
                left = along_variance - slope * covariance
                scale = 1 / sqrt(left) if left > EDGE_ON * along_variance else 0.0
                gx[m], gy[m] = (-ay - slope * ax) * scale, (ax - slope * ay) * scale  # residual = g . (y - h)
        for m in range(taken):
            k = index[m]
            if not adds:
                if on[m]:
                    apart = projector_rays[k, 0] - hx[m] - j11[m] * dx[m] - j12[m] * dy[m]
                    down = projector_rays[k, 1] - hy[m] - j21[m] * dx[m] - j22[m] * dy[m]
                    residuals[1, k] = gx[m] * apart + gy[m] * down
                continue
            v, y = Vector(v1[m], v2[m], v3[m]), Vector(px[m], py[m], 1.0)
            if weights[0, k] > 0:
                # e = y . (t x v): by w it is v x (y x t), by t it is v x y.
                turned, shifted = _cross(v, _cross(y, t)), _cross(v, y)
                row[0], row[1], row[2] = turned.x * by[m], turned.y * by[m], turned.z * by[m]
                row[3], row[4] = _dot(first, shifted) * by[m], _dot(second, shifted) * by[m]
                for i in range(extra):
                    row[UNKNOWNS + i] = columns[i, 0, k]
                for i in range(turns):
                    row[first_turn + i] = (mx[m] * camera_turns[k, 0, i] + my[m] * camera_turns[k, 1, i]) * by[m]
                    turn = lx[m] * projector_turns[k, 0, i] + ly[m] * projector_turns[k, 1, i]
                    row[first_turn + turns + i] = turn * by[m]
                _add(across, blocks[planes.shape[0]], row, weights[0, k], 5, first_bow)
            if not on[m] or columns.shape[1] == 1:
                continue
            # d h = (I, -h) d w / depth for w = H x, so that g . d h = -p . d w with:
            p = Vector(-gx[m] * hz[m], -gy[m] * hz[m], (gx[m] * hx[m] + gy[m] * hy[m]) * hz[m])
            turned, pulled = _cross(v, p), _dot(t, p)
            row[0], row[1], row[2] = turned.x, turned.y, turned.z
            row[3], row[4] = _dot(first, p) * rho[m], _dot(second, p) * rho[m]
            by_n = pulled * (1 + bow[m])
            row[5], row[6], row[7] = by_n * cx[m], by_n * cy[m], by_n
            for i in range(extra):
                row[UNKNOWNS + i] = columns[i, 1, k]
            if turns > 0:
                qx, qy = gx[m] * j11[m] + gy[m] * j21[m], gx[m] * j12[m] + gy[m] * j22[m]
                for i in range(turns):
                    row[first_turn + i] = -qx * camera_turns[k, 0, i] - qy * camera_turns[k, 1, i]
                    row[first_turn + turns + i] = gx[m] * projector_turns[k, 0, i] + gy[m] * projector_turns[k, 1, i]
            for i in range(bends.shape[1]):
                row[first_bow + i] = pulled * flat[m] * bends[k, i]
            plane = plane_index[k]
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
