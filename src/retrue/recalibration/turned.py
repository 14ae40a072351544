"""Points seen in a mirror: what lies around them runs the other way round, whatever the pose and the lenses are."""

from __future__ import annotations

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
    camera, projector = (_signs(rays, neighbours, noise) for rays in (points.camera_rays, points.projector_rays))
    signs = camera * projector
    return (np.count_nonzero(signs < 0, axis=1) >= FEWEST_TRIANGLES) & ~(signs > 0).any(axis=1)


def _signs(rays: FloatArray, neighbours: IntArray, noise: float) -> FloatArray:
    """(N, pairs) of the areas of each point's triangles with two of its neighbours; 0 where noise may have made it."""
    apart = rays[neighbours] - rays[:, None]
    squares = (apart**2).sum(axis=2)
    first, second = np.triu_indices(neighbours.shape[1], 1)
    x, y = apart[..., 0], apart[..., 1]
    area = x[:, first] * y[:, second] - y[:, first] * x[:, second]
    return np.where(area**2 > (CLEAR * noise) ** 2 * (squares[:, first] + squares[:, second]), np.sign(area), 0.0)
