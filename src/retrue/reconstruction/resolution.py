"""How fine and how exact a cloud is, told by its own grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray
from retrue.reconstruction.surface_grid import SurfaceGrid

WINDOWS_PER_SIDE = 10  # a window is this fraction of the longer side of the grid,
SMALLEST_WINDOW = 5  # and at least so many cells, of which
LEAST_FILLED = 0.6  # so many hold a point,
MOST_CUT = 0.02  # and so many of whose links are jumps
MOST_WINDOWS = 200
QUADRIC = 6  # coefficients


@dataclass(frozen=True, slots=True)
class Resolution:
    """Lengths in the cloud's unit; NaN where no neighbours, or no smooth window, tell.

    Attributes
    ----------
    spacing : median distance of neighbours on one surface.
    noise : one sigma of the depth at the cloud's median depth Z: of w = 1 / Z, times Z squared.
    noise_w : one sigma of w.
    """

    spacing: float
    noise: float
    noise_w: float


def resolution(points: FloatArray, grid: SurfaceGrid) -> Resolution:
    """The spacing of points (N, 3), and how far they scatter about smooth windows of their grid."""
    a, b = grid.links()
    spacing = float(np.median(np.linalg.norm(points[a] - points[b], axis=1))) if len(a) else float("nan")
    noise_w = _noise(points, grid)
    return Resolution(spacing, noise_w * float(np.median(points[:, 2])) ** 2, noise_w)


def _noise(points: FloatArray, grid: SurfaceGrid) -> float:
    """Median over windows of the RMS that w leaves to a quadric of the ray; noise in w is even over the picture.

    A window is wide enough that what neighbours have in common, as decoders smooth, is not taken for truth.
    """
    height, width = grid.index.shape
    side = max(SMALLEST_WINDOW, max(height, width) // WINDOWS_PER_SIDE)
    stride = max(side, int(np.sqrt(height * width / MOST_WINDOWS)))
    found: list[float] = []
    for top in range(0, height - side + 1, stride):
        for left in range(0, width - side + 1, stride):
            rows, columns = slice(top, top + side), slice(left, left + side)
            there = grid.index[rows, columns] >= 0
            if there.mean() >= LEAST_FILLED and there.sum() > 2 * QUADRIC and _smooth(grid, there, rows, columns):
                found.append(_rms_about_quadric(points[grid.index[rows, columns][there]]))
    return float(np.median(found)) if found else float("nan")


def _smooth(grid: SurfaceGrid, there: BoolArray, rows: slice, columns: slice) -> bool:
    """Whether hardly any neighbours in the window are on two sides of a jump."""
    right = grid.right[rows, columns.start : columns.stop - 1]
    down = grid.down[rows.start : rows.stop - 1, columns]
    pairs = np.concatenate([(there[:, :-1] & there[:, 1:]).ravel(), (there[:-1] & there[1:]).ravel()])
    linked = np.concatenate([right.ravel(), down.ravel()])
    return bool((pairs & ~linked).sum() <= MOST_CUT * pairs.sum())


def _rms_about_quadric(points: FloatArray) -> float:
    """RMS, for the degrees of freedom, of w about its least-squares quadric of the ray (x, y)."""
    x, y = (points[:, :2] / points[:, 2:]).T
    x, y = (x - x.mean()) / np.ptp(x), (y - y.mean()) / np.ptp(y)
    terms = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    w = 1 / points[:, 2]
    off = w - terms @ np.linalg.lstsq(terms, w, rcond=None)[0]
    return float(np.sqrt((off @ off) / (len(w) - QUADRIC)))
