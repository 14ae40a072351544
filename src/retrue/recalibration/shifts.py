"""By what each point misses the place where a plane has it: in the pixels of either device, and as a step in space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.two_view import FREE
from retrue.kernels import copies as kernel
from retrue.recalibration.bows import BOWS, bend_at
from retrue.recalibration.posterior import Posterior

MOST_COPIED = 3  # planes, the largest
ENOUGH = 60  # points of a plane, that tell its bows


@dataclass(frozen=True, slots=True, eq=False)
class PlaneShifts:
    """Some points, as a plane that they do not lie on would have them.

    Attributes
    ----------
    plane : its number.
    pixels : (2, N, 2) what each point is shifted by, in the projector and in the camera.
    places, forth : (N, 3) y where the projector has them, h where the plane does.
    weights : (2, N) w of the step p, y ~ h + w p, that leads up either axis; none where nobody asks for steps.
    relative : (2, N, 2) log length of p, and its angle to that axis.
    gaps : (N,) the larger of both components of y - h.
    """

    plane: int
    pixels: FloatArray
    places: FloatArray
    forth: FloatArray
    weights: FloatArray
    relative: FloatArray
    gaps: FloatArray

    def select(self, rows: BoolArray) -> PlaneShifts:
        """The same of those points."""
        left = np.flatnonzero(rows)
        weights, relative, gaps = self.weights, self.relative, self.gaps
        if len(gaps):
            weights, relative = np.take(weights, left, axis=1), np.take(relative, left, axis=1)
            gaps = gaps[left]
        places, forth = (np.take(part, left, axis=0) for part in (self.places, self.forth))
        return PlaneShifts(self.plane, np.take(self.pixels, left, axis=1), places, forth, weights, relative, gaps)


def shifts_from_planes(posterior: Posterior, rows: IntArray) -> list[PlaneShifts]:
    """Of those points, from each of the largest planes; steps in space where texture may repeat.

    Where a plane is bowed by a share b of its disparity, its homography is R + (1 + b) t n^T.
    """
    points, pose, measured = posterior.points, posterior.pose, posterior.measured
    x = np.column_stack([points.camera_rays[rows], np.ones(len(rows))])
    y = np.column_stack([points.projector_rays[rows], np.ones(len(rows))])
    counts = np.bincount(points.plane_index[points.plane_index != FREE], minlength=len(pose.planes))
    found: list[PlaneShifts] = []
    for plane in np.argsort(-counts)[:MOST_COPIED].tolist():
        n = pose.planes[plane]
        H: FloatArray = pose.R + pose.t[:, None] * n
        forth = x @ H.T
        bend = _bend(posterior, rows, plane)
        forth += bend[:, None] * (x @ n)[:, None] * pose.t
        turned, t = y @ pose.R, pose.R.T @ pose.t  # the inverse is (I - (1 + b) t n^T / (1 + (1 + b) n t)) R^T
        with np.errstate(all="ignore"):
            back = turned - ((1 + bend) * (turned @ n) / (1 + (1 + bend) * float(n @ t)))[:, None] * t
        pixels = np.empty((2, len(rows), 2))
        np.subtract(measured.projector_px[rows], measured.rig.projector.project(forth), out=pixels[0])
        np.subtract(measured.camera_px[rows], measured.rig.camera.project(back), out=pixels[1])
        count = len(rows) if measured.textured else 0
        weights, relative, gaps = np.empty((2, count)), np.empty((2, count, 2)), np.empty(count)
        if measured.textured:
            kernel.steps(y, forth, x @ n, weights, relative, gaps)
        found.append(PlaneShifts(plane, pixels, y, forth, weights, relative, gaps))
    return found


def _bend(posterior: Posterior, rows: IntArray, plane: int) -> FloatArray:
    """(rows,) the share of that plane's disparity by which its bows would move those points, if they lay on it."""
    shares, bows = posterior.measured.bowed(posterior.parameters.bows)
    mine = np.flatnonzero(posterior.points.plane_index == plane)
    if not len(mine) or not bows[plane].any():
        return np.zeros(len(rows))
    rays, mine = posterior.points.camera_rays, mine[:: max(len(mine) // ENOUGH, 1)]
    return bend_at(rays[rows], rays[mine], shares[mine] @ bows[plane], 2 if bows.shape[1] == BOWS else 3)
