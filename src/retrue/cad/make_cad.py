"""From a cloud to surfaces that CAD works with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.cad.model import CadModel, Outline, Patch
from retrue.cad.options import CadOptions
from retrue.cad.outlines import region_outlines, signed_area
from retrue.cad.segmentation import Region, smooth_regions
from retrue.cad.spline import SplineSurface, fit_spline
from retrue.cad.surfaces import PlaneSurface, SphereSurface, Surface, fit_plane, fit_sphere
from retrue.cad.thinning import ThinGrid, thin_grid
from retrue.errors import DegenerateError, InputError
from retrue.geometry.arrays import FloatArray, IntArray
from retrue.reconstruction.cloud import Cloud
from retrue.reconstruction.resolution import resolution
from retrue.reconstruction.surface_grid import surface_grid

NOISE_SIGMAS = 6.0
LEAST_KEPT = 0.8  # of a region's points, which a plane or sphere must still hold when fitted to all of them
NEARLY_ALL = 0.998  # of a region's points, which is enough for a spline to hold within their limit,
MOST = 0.95  # or so many, where twice the knots lose more than half as many: those are strays, not shape
MOST_LEVELS = 10  # of splines, each with twice the intervals of the one before
POINTS_PER_KNOT = 2  # at least, along each side of the region, in the thin grid
MOST_FITTED = 40_000  # points that a surface is fitted to; the errors are those of all


def make_cad(cloud: Cloud, options: CadOptions | None = None) -> CadModel:
    """Planes, spheres and B-spline surfaces through the smooth regions of a cloud.

    A point further from its surface than the tolerance, and than noise explains, is left out and counted: so
    `Patch.met` is False only where the tolerance asked for is finer than the points.

    Raises
    ------
    InputError : the points have no grid, or the tolerance is not positive.
    DegenerateError : the noise cannot be told and no tolerance is given, or there is no smooth region.
    """
    options = options or CadOptions()
    wanted = options.cad_tolerance
    if cloud.cells is None:
        raise InputError("cad: expected points of a capture with a grid, found scattered ones; decode a picture")
    if wanted is not None and not (0 < wanted < np.inf):
        raise InputError(f"cad_tolerance: expected a positive length, found {wanted}")
    noise_w = resolution(cloud.points, surface_grid(cloud.points, cloud.cells)).noise_w
    if wanted is None and not noise_w > 0:
        raise DegenerateError("cad: too few neighbours to tell the noise of the points; give --cad-tolerance")
    explained = NOISE_SIGMAS * np.nan_to_num(noise_w) * cloud.points[:, 2] ** 2  # w = 1 / Z: dZ = Z^2 dw
    fitting = _Fitting(cloud.points, cloud.cells - cloud.cells.min(axis=0), explained, wanted)
    thin = thin_grid(cloud.points, cloud.cells)
    thin_limit = fitting.limit(NOISE_SIGMAS * np.nan_to_num(noise_w) * thin.points[:, 2] ** 2)
    found = [_patch(fitting, thin, region) for region in smooth_regions(thin, thin_limit)]
    patches = sorted((patch for patch in found if patch is not None), key=lambda patch: -len(patch.rows))
    if not patches:
        raise DegenerateError(f"cad: no smooth region in {len(cloud)} points; give a larger --cad-tolerance")
    return CadModel(tuple(patches), cloud.unit, len(cloud))


@dataclass(frozen=True, slots=True, eq=False)
class _Fitting:
    """All points (N, 3), their cells (N, 2), and how far from its surface the noise of each may put it (N,)."""

    points: FloatArray
    cells: IntArray
    explained: FloatArray
    wanted: float | None

    def limit(self, explained: FloatArray) -> FloatArray:
        """How far points with such noise may lie from their surface and belong to it."""
        return explained if self.wanted is None else np.maximum(self.wanted, explained)


def _patch(fitting: _Fitting, thin: ThinGrid, region: Region) -> Patch | None:
    """The patch of a region; None where no face comes of it."""
    rows = _rows_of(fitting, thin, region.rows)
    points, limit = fitting.points[rows], fitting.limit(fitting.explained[rows])
    if region.surface is None:
        surface = _fitted_spline(points, limit, _most_intervals(thin, region.rows))
    else:
        surface = _refitted(region.surface, points, limit)
        if not (np.abs(surface.distances(points)) <= limit).mean() >= LEAST_KEPT:
            surface = _fitted_spline(points, limit, _most_intervals(thin, region.rows))
    distance = np.abs(surface.distances(points))
    on_it = distance <= limit
    outlines = _outlines(surface, thin, region.rows)
    if not on_it.any() or not outlines:
        return None
    return Patch(
        surface,
        outlines,
        rows[on_it],
        float(distance[on_it].max()),
        float(np.sqrt(np.mean(distance[on_it] ** 2))),
        float(limit[on_it].max()) if fitting.wanted is None else fitting.wanted,
    )


def _rows_of(fitting: _Fitting, thin: ThinGrid, thin_rows: IntArray) -> IntArray:
    """All points in the blocks of thin points."""
    blocks = fitting.cells // thin.block
    inside = np.zeros(blocks.max(axis=0) + 1, dtype=np.bool_)
    inside[tuple(thin.cells[thin_rows].T)] = True
    return np.flatnonzero(inside[tuple(blocks.T)])


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
        lost_now = float((np.abs(surface.distances(points)) > limit).mean())
        if best is not None and lost <= 1 - MOST and lost_now > lost / 2:
            break
        if best is None or lost_now < lost:
            best, lost = surface, lost_now
        if lost_now <= 1 - NEARLY_ALL or (2**level >= most).all():
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
