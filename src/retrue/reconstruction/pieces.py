"""What hangs together: points joined by links, and cells of a mask."""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from retrue.geometry.arrays import BoolArray, IntArray


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
