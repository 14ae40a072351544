"""Points seen in a mirror: what lies around them runs the other way round, whatever the pose and the lenses are."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.two_view import TwoViewPoints

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
    turned, kept = np.zeros(len(points), dtype=np.int64), np.zeros(len(points), dtype=np.int64)
    for first, second in combinations(neighbours.T, 2):
        camera, projector = (_areas(rays, first, second, noise) for rays in (points.camera_rays, points.projector_rays))
        turned += camera * projector < 0
        kept += camera * projector > 0
    return (turned >= FEWEST_TRIANGLES) & (kept == 0)


def _areas(rays: FloatArray, first: IntArray, second: IntArray, noise: float) -> FloatArray:
    """(N,) the sign of each point's triangle with these two; 0 where noise may have made it."""
    a, b = rays[first] - rays, rays[second] - rays
    area = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    clear = np.abs(area) > CLEAR * noise * np.sqrt((a**2).sum(axis=1) + (b**2).sum(axis=1))
    return np.where(clear, np.sign(area), 0.0)
