"""What neighbours in the picture say together.

Wrong matches contradict the pose each in its own way. Points that contradict it alike are a surface, seen with other
intrinsics or from another pose; and two planes that alternate all over the picture are one plane, seen from two poses.
"""

from __future__ import annotations

from typing import cast

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.two_view import FREE, epipolar_residuals
from retrue.recalibration.fit import CUTOFF, PoseFit
from retrue.recalibration.prepare import Rays

APART = 10.0  # times the noise: nearer to the line where two planes meet, either may claim a point
ENOUGH_POINTS = 2000
LARGE = 0.25  # share of a capture's points on planes
ALIKE = 0.25  # residuals of two neighbours, apart by less than this share of the larger
ALIKE_BY_CHANCE = 0.25  # share of independent ones that are; 1/8 where uniform


def contradicting_share(fit: PoseFit, rays: Rays) -> float:
    """Share of all points that contradict the pose, and as their neighbours among such points do."""
    step = max(1, len(rays) // ENOUGH_POINTS)
    points, capture = rays.points.select(slice(None, None, step)), rays.capture[::step]
    residual = epipolar_residuals(fit.pose.R, fit.pose.t, points)
    wrong = ~(np.abs(residual) < CUTOFF * float(np.hypot(fit.epipolar_noise.level, fit.epipolar_noise.shared)))
    alike = 0
    for index in range(int(capture.max(initial=-1)) + 1):
        mine = np.flatnonzero(wrong & (capture == index))
        if len(mine) < 2:
            continue
        r, other = residual[mine], residual[mine][_nearest(points.camera_rays[mine])]
        alike += int(np.count_nonzero(np.abs(r - other) < ALIKE * np.maximum(np.abs(r), np.abs(other))))
    excess = (alike - ALIKE_BY_CHANCE * np.count_nonzero(wrong)) / (1 - ALIKE_BY_CHANCE)
    return max(float(excess), 0.0) / max(len(points), 1)


def interleaved_share(fit: PoseFit, rays: Rays) -> float:
    """Share of the points on large planes whose nearest neighbour lies on another one, clearly apart from theirs there.

    Surfaces meet along lines, so that few points have such a neighbour; each plane of a mixture is everywhere.
    """
    rows = np.flatnonzero(rays.points.plane_index != FREE)
    rows = rows[:: max(1, len(rows) // ENOUGH_POINTS)]
    foreign = counted = 0
    for capture in range(int(rays.capture.max(initial=-1)) + 1):
        mine = rows[rays.capture[rows] == capture]
        mine = mine[_on_large_planes(rays.points.plane_index[mine])]
        if len(mine) < 2:
            continue
        x = rays.points.camera_rays[mine]
        plane = rays.points.plane_index[mine]
        other = plane[_nearest(x)]
        apart: BoolArray = _apart(fit, x, plane, other) > APART * _noise(fit, rays, mine)
        foreign += int(np.count_nonzero((other != plane) & apart))
        counted += len(mine)
    return foreign / max(counted, 1)


def _on_large_planes(plane: IntArray) -> BoolArray:
    """(N,) points of planes with a quarter of all: a mixture has two of them, scattered points none."""
    counts = np.bincount(plane)
    return counts[plane] >= LARGE * len(plane)


def _nearest(x: FloatArray) -> IntArray:
    """(N,) row of each point's nearest neighbour."""
    from scipy.spatial import KDTree

    return cast(IntArray, KDTree(x).query(x, 2)[1])[:, 1]


def _apart(fit: PoseFit, x: FloatArray, plane: IntArray, other: IntArray) -> FloatArray:
    """(N,) how far apart the projector rays to the two planes are, along one camera ray."""
    rays = np.column_stack([x, np.ones(len(x))])
    first, second = (_seen(fit, rays, (rays * fit.pose.planes[index]).sum(axis=1)) for index in (plane, other))
    return np.linalg.norm(first - second, axis=1)


def _seen(fit: PoseFit, rays: FloatArray, disparity: FloatArray) -> FloatArray:
    points = rays @ fit.pose.R.T + disparity[:, None] * fit.pose.t
    return points[:, :2] / points[:, 2:]


def _noise(fit: PoseFit, rays: Rays, rows: IntArray) -> FloatArray:
    """(N,) noise of a point in the projector, in the unit of its rays."""
    sigma = np.hypot(rays.points.camera_sigma[rows], rays.points.projector_sigma[rows])
    return sigma * float(np.hypot(fit.along_noise.level, fit.along_noise.shared))
