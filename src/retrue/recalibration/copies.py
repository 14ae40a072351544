"""Shifted copies of planes, of codes that repeat in either picture, and of texture that repeats in space."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.robust import quantile, within_reach_of_mode
from retrue.geometry.two_view import FREE
from retrue.kernels import robust as robust_kernel
from retrue.recalibration.costs import worth_of
from retrue.recalibration.parts import (
    A_COPY,
    ALIKE,
    FEWEST_OF_A_PART,
    MOST_COPIES,
    Part,
    level_of,
    sigma_of,
)
from retrue.recalibration.posterior import Posterior
from retrue.recalibration.shifted_codes import shifted_codes
from retrue.recalibration.shifts import PlaneShifts, shifts_from_planes

FEWEST_OF_A_COPY = 6  # what its price is paid by; what one shift puts in place along both axes is no chance
ROUGH_STEP, STEPPED = 0.1, 8  # of a step, by which perspective makes it differ at first; and fits of it
MOST_MODES = 3
CENTRES = 50  # shifts to look for others about


def shifted_copy(posterior: Posterior, outside: BoolArray) -> Part | None:
    """Unexplained points that one shift puts where a plane has them; None where no many are.

    A code that repeats makes such matches, of pixels in either picture; repeated texture has the same step in space,
    one way and the other. The shift is the mode of what the points ask for.
    """
    found = shifted_copies(posterior, outside, 1)
    return found[0] if found else None


def _shifted_copy(posterior: Posterior, outside: BoolArray, rows: IntArray, planes: list[PlaneShifts]) -> Part | None:
    """The same, of the rows that are outside, as the planes have them."""
    points, measured = posterior.points, posterior.measured
    focals = measured.rig.projector.K[0, 0], measured.rig.camera.K[0, 0]
    sigma = sigma_of(points.select(rows))
    noise = 4 * float(quantile(sigma, 0.5) * posterior.fit.along_noise.total)
    found: list[Part] = []

    def take(mode: BoolArray, missed: FloatArray, parameters: int, plane: int) -> None:
        """Of `missed` (rows, 2); what lies between a plane's points is a copy of these, not of what it is itself."""
        count = int(np.count_nonzero(mode))
        if count < FEWEST_OF_A_COPY:
            return
        copied = np.count_nonzero((points.plane_index == plane) & ~outside)
        copy = np.zeros(len(outside), dtype=np.bool_)
        copy[rows[mode]] = True
        relative: FloatArray = missed[mode] / sigma[mode, None]
        seldom = max(0.0, 1 - copied / count)
        found.append(Part(A_COPY, copy, parameters, relative, level_of(relative), seldom=seldom))

    for seen in planes:
        for axis in range(2 if measured.textured else 0):
            mode, missed = _stepped(seen, axis, noise)
            take(mode, missed, 3, seen.plane)
        for shift, focal in zip(seen.pixels, focals, strict=True):
            mode = within_reach_of_mode(shift, CENTRES, noise * focal)
            middle = np.array([quantile(along, 0.5) for along in shift[mode].T]) if mode.any() else np.zeros(2)
            if np.abs(middle).max() > noise * focal:  # what lies where the plane has it is no copy
                take(mode, (shift - middle) / focal, 2, seen.plane)
    return max(found, key=lambda copy: worth_of(copy, posterior), default=None)


def _stepped(seen: PlaneShifts, axis: int, noise: float) -> tuple[BoolArray, FloatArray]:
    """(N,) points that lie one step p from their plane's, y ~ H x + p (n x) or less that; and what (N, 2) they miss.

    Which way is told by the sign along an axis. What moved has steps, too, and often more: each mode of them is asked.
    """
    relative, apart = seen.relative[axis], seen.gaps > noise
    asked, best, missed = apart.copy(), np.zeros(len(apart), dtype=np.bool_), np.zeros((len(apart), 2))
    for _ in range(MOST_MODES):
        rows = np.flatnonzero(asked)
        rough = rows[within_reach_of_mode(np.take(relative, rows, axis=0), CENTRES, ROUGH_STEP)]
        if len(rough) < FEWEST_OF_A_COPY:
            break
        asked[rough] = False
        mode, off = _of_one_step(seen.places, seen.forth, seen.weights[axis], rough, noise)
        if np.count_nonzero(mode & apart) > np.count_nonzero(best):
            best, missed = mode & apart, off
    return best, missed


def _of_one_step(
    y: FloatArray, forth: FloatArray, w: FloatArray, rows: IntArray, noise: float
) -> tuple[BoolArray, FloatArray]:
    """(N,) points where y ~ forth + w p, for the p of most of those rows; and what (N, 2) they miss."""
    mode = np.zeros(len(y), dtype=np.bool_)
    mode[rows] = True
    missed = np.zeros((len(y), 2))
    robust_kernel.of_one_step(y, forth, w, noise, STEPPED, mode.view(np.uint8), missed, np.empty(len(y)))
    return mode, missed


def copies_of_planes(posterior: Posterior, outside: BoolArray) -> list[Part]:
    """Shifted copies among what the pose does not explain; of texture, which repeats, among all off the largest plane.

    A print that repeats along the epipolar lines passes for another surface, from a pose that is a little off; and the
    right pose explains some of it, too.
    """
    plane = posterior.points.plane_index
    if not posterior.measured.textured or not (plane != FREE).any():  # a pose may have copies on its lines
        return shifted_copies(posterior, outside | (plane == FREE))
    largest = int(np.argmax(np.bincount(plane[plane != FREE])))
    found = shifted_copies(posterior, ~((plane == largest) & (posterior.fit.robust_weights[1] > 0)))
    known = np.any([~outside, *(one.rows for one in found)], axis=0)  # surfaces step by step hide what is none
    return found + shifted_copies(posterior, ~known)


def copies_explained(posterior: Posterior) -> list[Part]:
    """Those copies of planes that may have led the pose: much of what it explains off all planes is of them.

    A shift along its epipolar lines is another depth, and one that is nearly along them draws the pose a little.
    """
    explained = posterior.fit.explained
    loose = explained & (posterior.points.plane_index == FREE)
    fewest = max(FEWEST_OF_A_PART, int(ALIKE * np.count_nonzero(loose)))
    if not posterior.measured.textured:  # whole periods off to both sides, as many as led it are so together
        found = shifted_copies(posterior, loose)
        return found if sum(part.count for part in found) >= fewest else []
    return [part for part in posterior.parts if part.name == A_COPY and (part.rows & explained).sum() >= fewest]


def copies_seen_through(posterior: Posterior) -> list[Part]:
    """Shifted copies that the pose explains, of points that lie between those of a plane.

    A surface one step before a plane, all over, that shows the plane between each two of its points: it is the print,
    from any pose that explains the plane, and tells nothing of which.
    """
    neighbours, plane = posterior.measured.neighbours, posterior.points.plane_index
    if not posterior.measured.textured or not neighbours.size:
        return []
    beside = np.where(posterior.fit.robust_weights[1] > 0, plane, FREE)[neighbours]
    between = np.count_nonzero((beside != FREE) & (beside != plane[:, None]), axis=1) >= 2
    explained = posterior.fit.explained
    if not (between & explained).any():
        return []
    found = shifted_copies(posterior, between)
    return [replace(one, seen_through=True) for one in found if 2 * np.count_nonzero(one.rows & explained) > one.count]


def shifted_copies(posterior: Posterior, outside: BoolArray, most: int = MOST_COPIES) -> list[Part]:
    """The `shifted_copy` of those points, that of the others, ...

    None where no plane is where the pose has it: what passes for copies of it there is none.
    """
    found, rows = list[Part](), np.flatnonzero(outside)
    if len(rows) < FEWEST_OF_A_COPY or not len(posterior.pose.planes) or posterior.explains_no_plane:
        return found
    planes: list[PlaneShifts] = shifts_from_planes(posterior, rows)
    while (copy := _shifted_copy(posterior, outside, rows, planes)) is not None:
        found.append(copy)
        left = ~copy.rows[rows]
        if len(found) == most or np.count_nonzero(left) < FEWEST_OF_A_COPY:
            break
        outside, rows = outside & ~copy.rows, rows[left]
        planes = [seen.select(left) for seen in planes]
    return found


def parts_of(posterior: Posterior) -> list[Part]:
    """Copies of planes and of codes, and planes of their own: what has an explanation, and is none of the pose."""
    measured, outside = posterior.measured, posterior.unexplained
    copies = copies_of_planes(posterior, outside)
    if not measured.textured:  # of what is curved, a plane of its own and one shift are rivals
        copies += shifted_codes(posterior, outside & ~np.any([~outside, *(copy.rows for copy in copies)], axis=0))
    return [*copies, *posterior.planes_apart.values(), *copies_seen_through(posterior)]
