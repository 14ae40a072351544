"""Shifted copies of planes, of codes that repeat in either picture, and of texture that repeats in space."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray
from retrue.geometry.robust import quantile
from retrue.geometry.two_view import FREE
from retrue.recalibration.costs import worth_at_most, worth_of
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
from retrue.recalibration.shifts import FEWEST_OF_A_COPY, Shifts, shifts_from_planes

PARAMETERS = 3, 3, 2, 2  # of steps in space up either axis, and of shifts in the pixels of either device


def shifted_copy(posterior: Posterior, outside: BoolArray) -> Part | None:
    """Unexplained points that one shift puts where a plane has them; None where no many are.

    A code that repeats makes such matches, of pixels in either picture; repeated texture has the same step in space,
    one way and the other. The shift is the mode of what the points ask for.
    """
    found = shifted_copies(posterior, outside, 1)
    return found[0] if found else None


def _shifted_copy(posterior: Posterior, outside: BoolArray, shifts: Shifts) -> Part | None:
    """The same, of the points that are outside, as the planes have them: the one of most worth.

    What lies between a plane's points is a copy of these, not of what it is itself; of what is not seen there is none.
    They are built by what their number may be worth at most, until none left is worth more than the best.
    """
    points, measured = posterior.points, posterior.measured
    sigma = sigma_of(points)[shifts.rows]
    noise = 4 * float(quantile(sigma, 0.5) * posterior.fit.along_noise.total)
    focals = np.array([measured.rig.projector.K[0, 0], measured.rig.camera.K[0, 0]])
    modes, missed, counts = shifts.modes(noise, focals)
    shown = np.bincount(points.plane_index[~outside] + 1, minlength=len(posterior.pose.planes) + 1)[1:]
    candidates: list[tuple[float, int, int, float]] = []
    for number, (plane, own) in enumerate(zip(shifts.planes.tolist(), counts.tolist(), strict=True)):
        for kind, count in enumerate(own):
            if min(count, int(shown[plane])) >= FEWEST_OF_A_COPY:
                seldom = max(0.0, 1 - int(shown[plane]) / count)
                candidates.append((worth_at_most(count, PARAMETERS[kind], seldom), number, kind, seldom))
    best, most = None, -np.inf
    for bound, number, kind, seldom in sorted(candidates, key=lambda candidate: -candidate[0]):
        if not bound > most:
            break
        mode = modes[number, kind]
        copy = np.zeros(len(outside), dtype=np.bool_)
        copy[shifts.rows[mode]] = True
        relative: FloatArray = missed[number, kind][mode] / sigma[mode, None]
        part = Part(A_COPY, copy, PARAMETERS[kind], relative, level_of(relative), seldom=seldom)
        worth = worth_of(part, posterior)
        if worth > most:
            best, most = part, worth
    return best


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
    shifts = shifts_from_planes(posterior, rows)
    while (copy := _shifted_copy(posterior, outside, shifts)) is not None:
        found.append(copy)
        left = ~copy.rows[shifts.rows]
        if len(found) == most or np.count_nonzero(left) < FEWEST_OF_A_COPY:
            break
        outside, shifts = outside & ~copy.rows, shifts.select(left)
    return found


def parts_of(posterior: Posterior) -> list[Part]:
    """Copies of planes and of codes, and planes of their own: what has an explanation, and is none of the pose."""
    measured, outside = posterior.measured, posterior.unexplained
    copies = copies_of_planes(posterior, outside)
    if not measured.textured:  # of what is curved, a plane of its own and one shift are rivals
        copies += shifted_codes(posterior, outside & ~np.any([~outside, *(copy.rows for copy in copies)], axis=0))
    return [*copies, *posterior.planes_apart.values(), *copies_seen_through(posterior)]
