"""What hangs together: points joined by links, cells of a mask; and strays, the points that hang together with none.

A decoding mistake, or a pixel on the edge of an object, puts a point where nothing is. It is known by its
neighbours: the surface goes on to none of them, or to too few to have an inside.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from retrue.geometry.arrays import BoolArray, IntArray
from retrue.reconstruction.surface_grid import SurfaceGrid


def linked_pieces(a: IntArray, b: IntArray, count: int) -> IntArray:
    """(count,) number of the piece that each point belongs to, links going from a (M,) to b (M,).

    >>> linked_pieces(np.array([0, 3]), np.array([2, 1]), 5).tolist()
    [0, 1, 0, 1, 2]
    """
    from scipy import sparse
    from scipy.sparse import csgraph

    links = cast("Any", sparse).coo_array((np.ones(len(a), dtype=np.bool_), (a, b)), shape=(count, count))
    _, piece = cast("Any", csgraph).connected_components(links, directed=False)
    return piece.astype(np.int64)


def masked_pieces(mask: BoolArray) -> tuple[IntArray, list[tuple[slice, slice]]]:
    """(H, W) number from 1 of the piece that each cell of the mask belongs to, 0 elsewhere; and the box of each.

    Cells hang together by their sides.
    """
    from scipy import ndimage

    numbers, _ = cast("Any", ndimage).label(mask)
    return numbers.astype(np.int64), cast("Any", ndimage).find_objects(numbers)


def grown(mask: BoolArray, cells: int) -> BoolArray:
    """The mask (H, W) and all that is so many cells from it, corners included.

    >>> grown(np.eye(3, dtype=np.bool_)[:1], 1).tolist()
    [[True, True, False]]
    """
    from scipy import ndimage

    return cast("Any", ndimage).binary_dilation(mask, np.ones((3, 3)), cells)


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
