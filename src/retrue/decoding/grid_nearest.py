"""The nearest of many points."""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from retrue.geometry.arrays import FloatArray, IntArray


def nearest(places: FloatArray, points: FloatArray) -> tuple[FloatArray, IntArray]:
    """Distance (M,) from each of `points` (M, 2) to the nearest of `places` (N, 2), one or more, and its index (M,)."""
    distance, index = nearest_of_all(places, points, 1)
    return distance[:, 0], index[:, 0]


def nearest_of_all(places: FloatArray, points: FloatArray, count: int) -> tuple[FloatArray, IntArray]:
    """The same of the `count` nearest ones, (M, count), the nearest first."""
    from scipy.spatial import KDTree

    tree = KDTree(places, balanced_tree=False, compact_nodes=False)  # half the time to build, for evenly spread points
    distance, index = cast(Any, tree).query(points, k=np.arange(1, count + 1))
    return cast(FloatArray, distance), cast(IntArray, index)
