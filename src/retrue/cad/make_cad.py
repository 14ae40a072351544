"""From a cloud to surfaces that CAD works with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.cad.model import CadModel, Outline, Patch
from retrue.cad.options import CadOptions
from retrue.cad.outlines import region_outlines, signed_area
from retrue.cad.segmentation import Region, ThinGrid, smooth_regions, thin_grid
from retrue.cad.spline import SplineSurface, fit_spline
from retrue.cad.surfaces import PlaneSurface, SphereSurface, Surface, fit_plane, fit_sphere
from retrue.errors import DegenerateError, InputError, require_kind
from retrue.geometry.arrays import FloatArray, IntArray
from retrue.reconstruction.cloud import Cloud, require_cloud
from retrue.reconstruction.resolution import resolution
from retrue.reconstruction.surface_grid import NOISE_SIGMAS, SPACING_FRACTION, surface_grid

FINEST_LIMIT = 1e-6  # of the depth
HELD_SHARE = 0.95  # of a region's points, which a surface must hold within their limit: the others are strays,
ENOUGH_HELD = 0.998  # and which is enough of them, however much finer knots could be
MOST_LEVELS = 10  # of splines, each with twice the intervals of the one before
POINTS_PER_KNOT = 2  # at least, along each side of the region, in the thin grid
MOST_FITTED = 40_000  # points that a surface is fitted to; the errors are those of all


def make_cad(cloud: Cloud, options: CadOptions | None = None) -> CadModel:
    """Planes, spheres and B-spline surfaces through the smooth regions of a cloud.

    A point further from its surface than the tolerance is left out and counted. Where more than one in twenty would
    be, none is, and `Patch.met` is False.

    Raises
    ------
    InputError : the points have no grid.
    DegenerateError : the noise cannot be told and no tolerance is given, or there is no smooth region.
    """
    require_cloud(cloud)
    options = CadOptions() if options is None else options
    require_kind(options, CadOptions, "options")
    wanted = options.cad_tolerance
    if cloud.cells is None:
        raise InputError("cad: expected points of a capture with a grid, found scattered ones; decode a picture")
    noise_w = resolution(cloud.points, surface_grid(cloud.points, cloud.cells)).noise_w
    if wanted is None and not noise_w >= 0:
        raise DegenerateError("cad: too few neighbours to tell the noise of the points; give --cad-tolerance")
    limit = _noise_limit(noise_w, cloud.points[:, 2]) if wanted is None else np.full(len(cloud), wanted)
    fitting = _Fitting(cloud.points, cloud.cells - cloud.cells.min(axis=0), limit)
    thin = thin_grid(cloud.points, cloud.cells)
    apart = np.maximum(wanted or 0.0, _noise_limit(np.nan_to_num(noise_w), thin.points[:, 2]))
    found = [_patch(fitting, thin, region) for region in smooth_regions(thin, apart)]
    patches = sorted((patch for patch in found if patch is not None), key=lambda patch: -len(patch.rows))
    if not patches:
        raise DegenerateError(f"cad: no smooth region in {len(cloud)} points; give a larger --cad-tolerance")
    return CadModel(tuple(patches), cloud.unit, len(cloud))


def _noise_limit(noise_w: float, depth: FloatArray) -> FloatArray:
    """Six sigma of depth Z (N,), whose noise is Z^2 times that of w = 1 / Z; and no less than rounding."""
    return np.maximum(NOISE_SIGMAS * noise_w * depth**2, FINEST_LIMIT * depth)


@dataclass(frozen=True, slots=True, eq=False)
class _Fitting:
    """All points (N, 3), their cells (N, 2), and how far each may lie from its surface (N,)."""

    points: FloatArray
    cells: IntArray
    limit: FloatArray


def _patch(fitting: _Fitting, thin: ThinGrid, region: Region) -> Patch | None:
    """The patch of a region; None where no face comes of it."""
    rows = _rows_of(fitting, thin, region.rows)
    points, limit = fitting.points[rows], fitting.limit[rows]
    surface = None if region.surface is None else _refitted(region.surface, points, limit)
    if surface is None or not _held(surface, points, limit) >= HELD_SHARE:
        surface = _fitted_spline(points, limit, _most_intervals(thin, region.rows))
    distance = np.abs(surface.distances(points))
    on_it = distance <= limit
    if on_it.mean() < HELD_SHARE:
        on_it[:] = True
    outlines = _outlines(surface, thin, region.rows)
    if not outlines:
        return None
    return Patch(
        surface,
        outlines,
        rows[on_it],
        float(distance[on_it].max()),
        float(np.sqrt(np.mean(distance[on_it] ** 2))),
        float(limit[on_it].max()),
    )


def _held(surface: Surface, points: FloatArray, limit: FloatArray) -> float:
    """Share of the points that lie within their limit."""
    return float((np.abs(surface.distances(points)) <= limit).mean())


def _rows_of(fitting: _Fitting, thin: ThinGrid, thin_rows: IntArray) -> IntArray:
    """All points in the blocks of thin points, but for those across a depth jump in a block."""
    blocks = fitting.cells // thin.block
    thin_row = np.full(blocks.max(axis=0) + 1, -1)
    thin_row[tuple(thin.cells[thin_rows].T)] = thin_rows
    nearest = thin_row[tuple(blocks.T)]
    rows = np.flatnonzero(nearest >= 0)
    off = fitting.points[rows] - thin.points[nearest[rows]]
    depth = np.abs((off * thin.normals[nearest[rows]]).sum(axis=1))
    return rows[depth <= fitting.limit[rows] + SPACING_FRACTION * np.linalg.norm(off, axis=1)]


def _refitted(surface: PlaneSurface | SphereSurface, points: FloatArray, limit: FloatArray) -> Surface:
    """Least squares again, of all the points near the surface."""
    for _ in range(3):
        near = points[np.abs(surface.distances(points)) <= limit]
        refined = (fit_plane if isinstance(surface, PlaneSurface) else fit_sphere)(_sampled(near))
        if refined is None:
            break
        surface = refined
    return surface


def _fitted_spline(points: FloatArray, limit: FloatArray, most: IntArray) -> SplineSurface:
    """The spline of the fewest knots that holds nearly all points within their limit, else that of the most."""
    best: SplineSurface | None = None
    lost = np.inf
    for level in range(MOST_LEVELS):
        intervals = np.minimum(2**level, most)
        surface = _robust_spline(points, limit, (int(intervals[0]), int(intervals[1])))
        lost_now = 1 - _held(surface, points, limit)
        if best is not None and lost <= 1 - HELD_SHARE and lost_now > lost / 2:
            break
        if best is None or lost_now < lost:
            best, lost = surface, lost_now
        if lost_now <= 1 - ENOUGH_HELD or (2**level >= most).all():
            break
    assert best is not None
    return best


def _robust_spline(points: FloatArray, limit: FloatArray, intervals: tuple[int, int]) -> SplineSurface:
    """Least squares, and again of the points that it holds, where those are most."""
    surface = fit_spline(_sampled(points), intervals)
    held = np.abs(surface.distances(points)) <= limit
    return fit_spline(_sampled(points[held]), intervals) if 0.9 <= held.mean() < 1.0 else surface


def _most_intervals(thin: ThinGrid, rows: IntArray) -> IntArray:
    """(2,) along x and along y: no finer than the points allow, whichever way the grid lies in the picture."""
    size = np.ptp(thin.cells[rows], axis=0)
    rays = thin.points[rows, :2] / thin.points[rows, 2:]
    turned = abs(np.corrcoef(rays[:, 0], thin.cells[rows, 0])[0, 1]) > abs(
        np.corrcoef(rays[:, 0], thin.cells[rows, 1])[0, 1]
    )
    along = size if turned else size[::-1]
    return np.maximum(1, along // POINTS_PER_KNOT)


def _sampled(points: FloatArray) -> FloatArray:
    """At most `MOST_FITTED` of them, evenly."""
    return points[:: max(1, -(-len(points) // MOST_FITTED))]


def _outlines(surface: Surface, thin: ThinGrid, rows: IntArray) -> tuple[Outline, ...]:
    """Outlines of the region in the surface's parameters, the outer one counter-clockwise there."""
    uv = np.full((len(thin.points), 2), np.nan)
    uv[rows] = surface.parameters(thin.points[rows, :2] / thin.points[rows, 2:])
    there = np.isfinite(uv).all(axis=1)
    outlines: list[Outline] = []
    for loops in region_outlines(thin.grid, np.asarray(there)):
        polygons = sorted((uv[loop] for loop in loops), key=lambda polygon: -abs(signed_area(polygon)))
        outer, holes = polygons[0], polygons[1:]
        outlines.append(
            tuple(_turned(polygon, sign) for polygon, sign in [(outer, 1), *((hole, -1) for hole in holes)])
        )
    return tuple(outlines)


def _turned(polygon: FloatArray, sign: int) -> FloatArray:
    return polygon if signed_area(polygon) * sign > 0 else polygon[::-1]
