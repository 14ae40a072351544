"""A coarser grid of smoothed points, on which surfaces are told apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.geometry.arrays import FloatArray, IntArray
from retrue.reconstruction.normals import local_planes
from retrue.reconstruction.surface_grid import SurfaceGrid, surface_grid

MOST_POINTS = 20_000


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
    block = max(1, int(np.ceil(np.sqrt(len(points) / MOST_POINTS))))
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
