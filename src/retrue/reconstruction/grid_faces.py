"""Faces between neighbouring cells of a grid."""

from __future__ import annotations

import numpy as np

from retrue.geometry.arrays import IntArray
from retrue.reconstruction.surface_grid import SurfaceGrid


def grid_faces(grid: SurfaceGrid) -> IntArray:
    """Faces (M, 3): two a square whose four sides are continuous; one where just one corner is missing or cut off."""
    index, right, down = grid.index, grid.right, grid.down
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]  # a b over c d
    top, bottom, left, right_side = right[:-1], right[1:], down[:, :-1], down[:, 1:]
    whole = top & bottom & left & right_side
    corners = (
        (whole, (a, b, c)),
        (whole, (b, d, c)),
        (~top & ~left & bottom & right_side, (b, d, c)),
        (~top & ~right_side & bottom & left, (a, d, c)),
        (~bottom & ~left & top & right_side, (a, b, d)),
        (~bottom & ~right_side & top & left, (a, b, c)),
    )
    return np.concatenate([np.stack([corner[where] for corner in triangle], axis=1) for where, triangle in corners])
