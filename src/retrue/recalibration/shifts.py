"""By what each point misses the place where a plane has it: in the pixels of either device, and as a step in space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.two_view import FREE
from retrue.kernels import copies as kernel
from retrue.recalibration.bows import BOWS, MONOMIALS, bend_of
from retrue.recalibration.posterior import Posterior

MOST_COPIED = 3  # planes, the largest
ENOUGH = 60  # points of a plane, that tell its bows
FEWEST_OF_A_COPY = 6  # what its price is paid by; what one shift puts in place along both axes is no chance
CENTRES = 50  # shifts to look for others about
STRIPS = 64


@dataclass(frozen=True, slots=True, eq=False)
class Shifts:
    """Some points, as the largest planes, which they do not lie on, would have them.

    Attributes
    ----------
    rows : (N,) which.
    planes : (P,) numbers of the planes.
    places : (2, N) where the projector has the points.
    seen : (P, 4 or 13, N) what they are shifted by and, where texture may repeat in space, what step each asks for; see
        `retrue.kernels.copies.shifts`.
    """

    rows: IntArray
    planes: IntArray
    places: FloatArray
    seen: FloatArray

    def select(self, kept: BoolArray) -> Shifts:
        """The same of those points."""
        left = np.flatnonzero(kept)
        of_those = (np.take(part, left, axis=-1) for part in (self.places, self.seen))
        return Shifts(self.rows[left], self.planes, *of_those)

    def modes(self, noise: float, focals: FloatArray) -> tuple[BoolArray, FloatArray, IntArray]:
        """Per plane, which points (P, 4, N) are most alike, what they miss (P, 4, N, 2), and how many they are (P, 4).

        They lie one step up either axis from where the plane has them, y ~ h + w p, or are off by one shift in the
        pixels of projector or camera, of `focals` (2,); `noise` is how far apart they may be. Which way a step leads is
        told by the sign along its axis. What moved has steps, too, and often more: each mode of them is asked.
        """
        shape = len(self.planes), 4, len(self.rows)
        members, missed, counts = np.empty(shape, np.bool_), np.empty((*shape, 2)), np.zeros(shape[:2], np.int64)
        starts, room = np.empty(STRIPS + 2, dtype=np.int64), np.empty((4, shape[2]))
        found = members.view(np.uint8), missed, counts
        if self.seen.shape[1] > 4:
            more = np.empty((3, shape[2]), dtype=np.uint8), np.empty((shape[2], 2))
            kernel.of_steps(self.places, self.seen, noise, CENTRES, FEWEST_OF_A_COPY, starts, room, *more, *found)
        kernel.of_shifts(self.seen, noise, focals, CENTRES, starts, room, *found)
        return members, missed, counts


def shifts_from_planes(posterior: Posterior, rows: IntArray) -> Shifts:
    """Of those points, from each of the largest planes; steps in space where texture may repeat.

    Where a plane is bowed by a share b of its disparity, its homography is R + (1 + b) t n^T.
    """
    points, pose, measured = posterior.points, posterior.pose, posterior.measured
    planes, bends = posterior.bent_planes
    normals = np.ascontiguousarray(pose.planes[planes])
    x, y = np.ascontiguousarray(points.camera_rays), np.ascontiguousarray(points.projector_rays)
    forth, back = np.empty((2, len(planes), len(rows), 3))
    R, t = np.ascontiguousarray(pose.R), np.ascontiguousarray(pose.t)
    kernel.through_planes(rows, x, y, R, t, normals, bends, forth, back)
    seen = np.stack([measured.rig.projector.project(forth), measured.rig.camera.project(back)])
    found = np.empty((len(planes), 13 if measured.textured else 4, len(rows)))
    pixels = np.ascontiguousarray(measured.camera_px), np.ascontiguousarray(measured.projector_px)
    kernel.shifts(rows, x, y, *pixels, normals, forth, seen, found)
    return Shifts(rows, planes, np.ascontiguousarray(y[rows].T), found)


def bent_planes(posterior: Posterior) -> tuple[IntArray, FloatArray]:
    """(P,) the largest planes, and (P, 14) the share of their disparity by which bows move a point: see `bend_of`."""
    index, rays = posterior.points.plane_index, posterior.points.camera_rays
    shares, bows = posterior.measured.bowed(posterior.parameters.bows)
    planes = np.argsort(-np.bincount(index[index != FREE], minlength=len(bows)))[:MOST_COPIED]
    found = np.zeros((len(planes), 4 + MONOMIALS))
    found[:, 2:4] = 1.0
    for bend, plane in zip(found, planes.tolist(), strict=True):
        mine = np.flatnonzero(index == plane)
        if len(mine) and bows[plane].any():
            mine = mine[:: max(len(mine) // ENOUGH, 1)]
            bend[:] = bend_of(rays[mine], shares[mine] @ bows[plane], 2 if bows.shape[1] == BOWS else 3)
    return planes, found
