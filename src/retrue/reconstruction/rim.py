"""Points beside a jump of depth: pixels that see two surfaces, and cells of a pattern that an edge cuts.

The light of two surfaces mixes within a camera pixel or two of the edge between them, and a decoder reads something in
between. That moves a point along the epipolar line, where the distance of its rays does not show it; its neighbours
along the edge are wrong alike. What tells is the surface further inside. So each point near the rim is held against
the plane of those inside; and how far such a plane is off by itself, the ring further in says, held against the plane
of those still further in by just as many cells.

Cells of a pattern lie too far apart for that: a block is as wide as the mixture. Of those at the rim their decoder's
word counts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray
from retrue.reconstruction.noise import robust_size
from retrue.reconstruction.normals import local_planes
from retrue.reconstruction.surface_grid import SurfaceGrid, cells_from_rim

MIXED = 2  # camera pixels from a jump within which light of two surfaces mixes; cells further apart are of a pattern
STEPS = 4 * MIXED  # of the walk that gathers the points inside
OUTLIER = 3.5  # sigmas from what the plane says
FINEST = 0.02  # of the spacing of points: what is off by less is on the surface
FEWEST = 100  # points that tell how far a ring of them is off
UNSURE = 6.0  # times the usual sigma, as stated: a cell at the rim that is cut


@dataclass(frozen=True, slots=True, eq=False)
class Rim:
    """What is so beside jumps.

    Attributes
    ----------
    level : (N,) how many times its sigma each point errs; 1 inside.
    cut : (N,) bool, points on no surface, but between two.
    """

    level: FloatArray
    cut: BoolArray


def find_rim(X: FloatArray, camera_px: FloatArray, stated: FloatArray, sigma: FloatArray, grid: SurfaceGrid) -> Rim:
    """The rim of N points.

    Parameters
    ----------
    X : (N, 3). camera_px : (N, 2) where they are seen. grid : of X.
    stated : (N,) sigma as the decoder has it, in any unit. sigma : (N,) of each point along its ray, in X's unit.
    """
    a, b = grid.links()
    step_px = float(np.median(np.linalg.norm(camera_px[a] - camera_px[b], axis=1))) if len(a) else np.inf
    if not step_px <= MIXED:
        at_rim = cells_from_rim(grid, len(X), 1) == 0
        return Rim(np.ones(len(X)), at_rim & (stated > UNSURE * float(np.median(stated))))

    cells = cells_from_rim(grid, len(X), 2 * MIXED)
    sigma_w = sigma / (np.linalg.norm(X, axis=1) * X[:, 2])
    spacing = float(np.median(np.linalg.norm(X[a] - X[b], axis=1)))
    off, beyond = (_off_plane(X, grid, cells >= inside) / sigma_w for inside in (MIXED, 2 * MIXED))
    apart = np.abs(off) * sigma_w * X[:, 2] ** 2 > FINEST * spacing
    level, cut = np.ones(len(X)), np.zeros(len(X), dtype=np.bool_)
    for ring in range(MIXED):
        here = (cells == ring) & np.isfinite(off)
        further_in = beyond[(cells == ring + MIXED) & np.isfinite(beyond)]
        if here.sum() < FEWEST or len(further_in) < FEWEST:
            continue
        usual = robust_size(further_in)
        cut |= here & apart & (np.abs(off) > OUTLIER * usual)
        more = robust_size(off[here & ~cut]) ** 2 - usual**2
        level[cells == ring] = np.sqrt(1 + max(more, 0.0))
    return Rim(level, cut)


def _off_plane(X: FloatArray, grid: SurfaceGrid, counted: BoolArray) -> FloatArray:
    """(N,) by how much 1 / Z is off the plane of the points about it that count; NaN where those tell none."""
    planes = local_planes(X, grid, counted, STEPS)
    with np.errstate(invalid="ignore"):
        return (1 - (planes * X).sum(axis=1)) / X[:, 2]
