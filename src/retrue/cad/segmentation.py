"""Which points lie on one smooth surface: regions between jumps and creases, then planes and spheres in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.cad.surfaces import PlaneSurface, SphereSurface, fit_plane, fit_sphere
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.robust import MAD_TO_SIGMA
from retrue.reconstruction.normals import local_planes
from retrue.reconstruction.pieces import grown, linked_pieces
from retrue.reconstruction.surface_grid import NOISE_SIGMAS, SurfaceGrid, slope_residual, surface_grid

MOST_THIN_POINTS = 20_000
SHARPEST_BEND = np.radians(12.0)  # between neighbours, beyond what the surface bends before and after: a crease
FEWEST_POINTS = 12  # of a patch
DRAWS = 150  # of random minimal samples; with half of the points on the surface four are all on it in one of 16
LARGEST_SAMPLE = 2_000  # points that a draw is scored on
WHOLE = 0.9  # of a region that a plane or sphere must explain,
PART = 0.3  # or so much, where the rest plainly faces elsewhere: else one bent surface would become many facets
ELSEWHERE_COSINE = np.cos(np.radians(20.0))
ALIKE_COSINE = np.cos(np.radians(25.0))  # between the normals of a point and of the surface that it is taken to lie on
FRINGE = 3  # cells around a surface over which normals are smoothed
CURVED = 1.2  # a sphere must explain so many times the points that a plane does,
LEAST_SPAN_COSINE = np.cos(np.radians(10.0))  # and reach so far from the middle of them: less is a bent plane
SEED = 7


@dataclass(frozen=True, slots=True, eq=False)
class ThinGrid:
    """One point for each block of cells: of those in it, the one nearest to its middle.

    Attributes
    ----------
    points : (N, 3) on the plane through the neighbours of that point, which smooths it along its ray; where no point is
        left out, as they are, for neighbours may be so far apart that such a plane cuts through a curved surface.
    normals : (N, 3) of that plane, towards the camera.
    grid : of these points; its cells are the blocks.
    cells : (N, 2) block of each point, row and column, counted from the first cells of the full grid.
    block : side of a block in cells.
    """

    points: FloatArray
    normals: FloatArray
    grid: SurfaceGrid
    cells: IntArray
    block: int


def thin_grid(points: FloatArray, cells: IntArray) -> ThinGrid:
    """The thinned grid of points (N, 3) in cells (N, 2)."""
    block = max(1, int(np.ceil(np.sqrt(len(points) / MOST_THIN_POINTS))))
    cells = cells - cells.min(axis=0)
    planes = local_planes(points, surface_grid(points, cells))
    usable = np.flatnonzero(np.isfinite(planes).all(axis=1))
    usable = usable[_nearest_to_the_middle(cells[usable], block)]
    rays = np.column_stack([points[usable, :2] / points[usable, 2:], np.ones(len(usable))])
    n = planes[usable]
    w = (n * rays).sum(axis=1)
    ahead = w > 0
    kept = points[usable[ahead]] if block == 1 else rays[ahead] / w[ahead, None]
    normals = -n[ahead] / np.linalg.norm(n[ahead], axis=1, keepdims=True)
    thin_cells = cells[usable[ahead]] // block
    return ThinGrid(kept, normals, surface_grid(kept, thin_cells), thin_cells, block)


def _nearest_to_the_middle(cells: IntArray, block: int) -> IntArray:
    """Rows of `cells` (N, 2): of each block the one nearest to its middle."""
    blocks = cells // block
    off = ((cells - blocks * block - (block - 1) / 2) ** 2).sum(axis=1)
    order = np.lexsort([off, blocks[:, 1], blocks[:, 0]])
    ordered = blocks[order]
    first = np.ones(len(order), dtype=np.bool_)
    first[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    return order[first]


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """Points (rows) of the thin grid, and the surface that explains them; None where neither plane nor sphere does."""

    rows: IntArray
    surface: PlaneSurface | SphereSurface | None


def smooth_regions(thin: ThinGrid, tolerance: FloatArray) -> list[Region]:
    """Regions, largest first; `tolerance` (N,) is how far each thin point may lie from its surface.

    Regions end at depth jumps and at creases, where normals bend by more than before and after. A plane or a sphere
    that explains the region, or a part of it whose rest faces elsewhere, is taken out (RANSAC, then least squares),
    and what is left is looked at again; where there is none, the region is free-form.
    """
    a, b = _uncreased_links(thin)
    inner = np.zeros(len(thin.points), dtype=np.bool_)
    inner[_with_all_links(thin)] = True
    queue = _pieces(a, b, np.arange(len(thin.points)), len(thin.points))
    claimed = np.zeros(len(thin.points), dtype=np.bool_)
    regions: list[Region] = []
    while queue:
        rows = queue.pop()
        rows = rows[~claimed[rows]]
        if len(rows) < FEWEST_POINTS or not inner[rows].any():
            continue
        surface, explained = _analytic(thin, rows, tolerance)
        main = max(_pieces(a, b, rows[explained], len(thin.points)), key=len, default=rows[:0])
        rest = np.setdiff1d(rows, main)
        if surface is None or not _stands_out(thin, surface, main, rest):
            regions.append(Region(rows, None))
            continue
        claimed[main] = True
        main = np.concatenate([main, _fringe(thin, surface, main, tolerance, claimed)])
        claimed[main] = True
        regions.append(Region(main, surface))
        queue += _pieces(a, b, rest, len(thin.points))
    return sorted(regions, key=lambda region: -len(region.rows))


def _stands_out(thin: ThinGrid, surface: PlaneSurface | SphereSurface, main: IntArray, rest: IntArray) -> bool:
    """Whether a surface that explains `main` is that of the region, or of a part which the rest bends away from."""
    count = len(main) + len(rest)
    if len(main) < FEWEST_POINTS or len(main) < PART * count:
        return False
    if len(main) >= WHOLE * count:
        return True
    return bool(np.median(_cosines(surface, thin.points[rest], thin.normals[rest])) < ELSEWHERE_COSINE)


def _fringe(
    thin: ThinGrid, surface: PlaneSurface | SphereSurface, main: IntArray, tolerance: FloatArray, claimed: BoolArray
) -> IntArray:
    """Points beside `main` that lie on its surface though their normals, smoothed over the edge, do not say so."""
    inside = np.zeros(len(thin.points), dtype=np.bool_)
    inside[main] = True
    index = thin.grid.index
    beside = index[grown((index >= 0) & inside[index], FRINGE) & (index >= 0)]
    beside = beside[~claimed[beside]]
    return beside[np.abs(surface.distances(thin.points[beside])) <= tolerance[beside]]


def _uncreased_links(thin: ThinGrid) -> tuple[IntArray, IntArray]:
    """Links of the grid that cross no crease."""
    grid = thin.grid
    normals = np.where(grid.index[..., None] >= 0, thin.normals[grid.index], np.nan)
    bend_right = np.linalg.norm([slope_residual(normals[..., k]) for k in range(3)], axis=0)
    bend_down = np.linalg.norm([slope_residual(normals[..., k].T).T for k in range(3)], axis=0)
    bends = np.concatenate([bend_right[grid.right], bend_down[grid.down]])
    usual = MAD_TO_SIGMA * float(np.median(bends)) if len(bends) else 0.0
    smooth = bends <= max(SHARPEST_BEND, NOISE_SIGMAS * usual)
    a, b = grid.links()
    return a[smooth], b[smooth]


def _with_all_links(thin: ThinGrid) -> IntArray:
    """Points that the surface goes on from in all four directions."""
    right, down = thin.grid.right, thin.grid.down
    return thin.grid.index[1:-1, 1:-1][right[1:-1, 1:] & right[1:-1, :-1] & down[1:, 1:-1] & down[:-1, 1:-1]]


def _pieces(a: IntArray, b: IntArray, rows: IntArray, count: int) -> list[IntArray]:
    """What of `rows` hangs together by links between them; the largest piece last."""
    if not len(rows):
        return []
    local = np.full(count, -1)
    local[rows] = np.arange(len(rows))
    both = (local[a] >= 0) & (local[b] >= 0)
    piece = linked_pieces(local[a[both]], local[b[both]], len(rows))
    order = np.argsort(piece, kind="stable")
    parts = np.split(rows[order], np.flatnonzero(np.diff(piece[order])) + 1)
    return sorted(parts, key=len)


def _analytic(
    thin: ThinGrid, rows: IntArray, tolerance: FloatArray
) -> tuple[PlaneSurface | SphereSurface | None, BoolArray]:
    """The plane or sphere that explains most of the points, and which (len(rows),) those are."""
    points, normals, tolerance = thin.points[rows], thin.normals[rows], tolerance[rows]
    plane, on_plane = _best(points, normals, tolerance, 3)
    sphere, on_sphere = _best(points, normals, tolerance, 4)
    if on_sphere.sum() > CURVED * on_plane.sum() and isinstance(sphere, SphereSurface):
        outwards = points[on_sphere] - sphere.centre
        outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
        middle = outwards.mean(axis=0)
        if np.quantile(outwards @ middle / np.linalg.norm(middle), 0.1) < LEAST_SPAN_COSINE:
            return sphere, on_sphere
    return plane, on_plane


def _best(
    points: FloatArray, normals: FloatArray, tolerance: FloatArray, sample: int
) -> tuple[PlaneSurface | SphereSurface | None, BoolArray]:
    """RANSAC of planes (samples of three) or spheres (of four), then least squares of what the best explains."""
    fit = fit_plane if sample == 3 else fit_sphere
    random = np.random.default_rng(SEED)
    scored = np.arange(len(points))
    if len(points) > LARGEST_SAMPLE:
        scored = random.choice(len(points), LARGEST_SAMPLE, replace=False)
    best: PlaneSurface | SphereSurface | None = None
    most = 0
    for _ in range(DRAWS):
        surface = fit(points[random.choice(len(points), sample, replace=False)])
        if surface is None:
            continue
        found = int(_explained(surface, points[scored], normals[scored], tolerance[scored]).sum())
        if found > most:
            best, most = surface, found
    if best is None:
        return None, np.zeros(len(points), dtype=np.bool_)
    explained = _explained(best, points, normals, tolerance)
    for _ in range(5):
        refined = fit(points[explained])
        again = explained if refined is None else _explained(refined, points, normals, tolerance)
        if refined is None or again.sum() < explained.sum():
            break
        best, explained = refined, again
    return best, explained


def _explained(
    surface: PlaneSurface | SphereSurface, points: FloatArray, normals: FloatArray, tolerance: FloatArray
) -> BoolArray:
    """Points near enough to a surface, whose normals are alike."""
    alike = _cosines(surface, points, normals) >= ALIKE_COSINE
    return (np.abs(surface.distances(points)) <= tolerance) & alike


def _cosines(surface: PlaneSurface | SphereSurface, points: FloatArray, normals: FloatArray) -> FloatArray:
    """Of the angles between normals (N, 3) and those of a surface at points (N, 3)."""
    if isinstance(surface, PlaneSurface):
        return normals @ surface.normal
    outwards = points - surface.centre
    cosines = (normals * outwards).sum(axis=1) / np.linalg.norm(outwards, axis=1)
    return -cosines if surface.hollow else cosines
