"""Points that lie on no surface, told by the topology of the capture's own grid.

A decoding mistake, or a pixel on the edge of an object, puts a point where nothing is. It is known by its
neighbours: the surface goes on to none of them, or to too few to have an inside.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.geometry.arrays import BoolArray, IntArray
from retrue.reconstruction.pieces import linked_pieces
from retrue.reconstruction.surface_grid import SurfaceGrid


@dataclass(frozen=True, slots=True, eq=False)
class Strays:
    """Masks (N,) of the points to leave out.

    Attributes
    ----------
    alone : the surface goes on to none of its neighbours.
    islands : on a piece of surface without an inside: none of its points has faces all around.
    """

    alone: BoolArray
    islands: BoolArray


def find_strays(grid: SurfaceGrid, count: int) -> Strays:
    """The strays among the `count` points of a grid."""
    piece = linked_pieces(*grid.links(), count)
    size = np.bincount(piece)
    has_inside = np.zeros(len(size), dtype=np.bool_)
    has_inside[piece[_inner(grid)]] = True
    stray = ~has_inside[piece]
    alone = stray & (size[piece] == 1)
    return Strays(alone, stray & ~alone)


def _inner(grid: SurfaceGrid) -> IntArray:
    """Points all of whose four squares are continuous on all sides."""
    right, down = grid.right, grid.down
    square = right[:-1] & right[1:] & down[:, :-1] & down[:, 1:]
    around = square[:-1, :-1] & square[:-1, 1:] & square[1:, :-1] & square[1:, 1:]
    return grid.index[1:-1, 1:-1][around]
