"""Points seen in a mirror: what lies around them runs the other way round, whatever the pose and the lenses are."""

from __future__ import annotations

import numpy as np

from retrue.geometry.arrays import BoolArray, IntArray
from retrue.geometry.two_view import TwoViewPoints
from retrue.kernels import surroundings as kernel

CLEAR = 3.0  # sigma of a triangle's area, in both pictures
FEWEST_TRIANGLES = 3


def turned_over(points: TwoViewPoints, neighbours: IntArray, noise: float) -> BoolArray:
    """(N,) points about which every clear triangle with two of its neighbours (N, K) is turned over, three at least.

    Both devices see a surface from its front, and so a small triangle on it runs the same way round in both; one that
    a mirror shows runs the other way round. A point that lies elsewhere than its neighbours, on a pole or by a wrong
    match, turns over some of its triangles, never all. `noise` is that of a match, in the unit of the rays.

    >>> grid = np.stack(np.meshgrid(np.arange(3.0), np.arange(3.0)), axis=-1).reshape(-1, 2)
    >>> seen = TwoViewPoints(grid, grid * [-1, 1], *np.ones((2, 9)), np.full(9, -1))
    >>> turned_over(seen, np.array([[1, 3, 5, 7]] * 9), 0.1)[4]
    np.True_
    """
    found = np.empty(len(points), dtype=np.bool_)
    kernel.turned_over(
        np.ascontiguousarray(points.camera_rays),
        np.ascontiguousarray(points.projector_rays),
        np.ascontiguousarray(neighbours),
        (CLEAR * noise) ** 2,
        FEWEST_TRIANGLES,
        found.view(np.uint8),
    )
    return found
