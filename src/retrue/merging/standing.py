"""What stands still before the camera while the object turns or is moved: a wall behind it, a table, the turntable.

It looks the same in every view, and often has more points than the object: all views would lie on each other as if
nothing had turned, and the object be smeared over the turn. A point stands where most of the other views that can tell
saw the surface exactly there, no view by chance; those cannot tell whose camera had something before it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray
from retrue.merging.view import View, neighbour_tree

THERE = 0.05  # cells, and more than noise, within which a surface is the same
MOST = 0.5  # of the views that can tell
OFTEN = 0.25  # of all that saw anything there: objects turned by their own symmetry coincide in fewer
NEIGHBOURS = 15  # that decide together: chance has single points of the object coincide
LEAST_SHARE = 0.1  # of all points: fewer are no background, and cannot tie views
LEAST_MOVED = 30  # points of a view, that something is left of it
LEAST_VIEWS = 2


def find_standing(views: Sequence[View], cell: float) -> list[BoolArray] | None:
    """Which of each view's points stand; None where nothing does, or where nothing else is left to merge.

    Views that were all taken of the same thing at rest stand as a whole, and are one another's copies: None.
    """
    found = [_standing(view, [other for other in views if other is not view], cell) for view in views]
    share = sum(int(each.sum()) for each in found) / sum(map(len, found))
    moved = sum(int((~each).sum()) >= LEAST_MOVED for each in found)
    return found if share >= LEAST_SHARE and moved >= LEAST_VIEWS else None


def without(points: FloatArray, view: View, standing: BoolArray) -> BoolArray:
    """(N,) of the points that a view was thinned from: those nearest to none that stands."""
    return ~standing[view.tree.query(points)[1]]


def _standing(view: View, others: Sequence[View], cell: float) -> BoolArray:
    same, told, looked = np.zeros((3, len(view.points)))
    for other in others:
        depth = float(np.median(other.points[:, 2]))
        distance, row = other.ray_tree.query(view.rays, distance_upper_bound=cell / depth)
        seen = np.isfinite(distance)
        row = np.where(seen, row, 0)
        before = ((view.points - other.points[row]) * other.normals[row]).sum(axis=1)
        off = THERE * cell + 3 * float(np.hypot(view.noise, other.noise))
        same += seen & (np.abs(before) < off)
        told += seen & (before > -off)
        looked += seen
    stands = (same > MOST * told) & (same >= OFTEN * looked)
    known = np.flatnonzero(told > 0)
    if not len(known):
        return np.zeros(len(view.points), np.bool_)
    _, near = neighbour_tree(view.points[known]).query(view.points, min(NEIGHBOURS, len(known)))
    return np.asarray(stands[known][near.reshape(len(view.points), -1)].mean(axis=1) > 0.5, dtype=np.bool_)
