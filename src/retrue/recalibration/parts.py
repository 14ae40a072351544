"""Points, or captures, of another pose than the answer's: those that share one are set aside, and named."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.errors import DegenerateError
from retrue.geometry.arrays import BoolArray
from retrue.geometry.five_points import best_essential, poses_of_essential, sampson_squares
from retrue.geometry.robust import CUTOFF
from retrue.geometry.two_view import POSE_PARAMETERS, TwoViewPose
from retrue.recalibration.candidates import behind
from retrue.recalibration.posterior import Measured, PosePrior, Posterior, fit_posterior
from retrue.recalibration.rays import Rays

FEWEST_OF_A_PART = 15
CENTRES = 50  # shifts to look for others about
SHARE_OF_A_PART = 0.3  # of the unexplained points; five free choices among wrong matches bring few together


@dataclass(frozen=True, slots=True, eq=False)
class OtherPart:
    """Points (N,) that the answer does not explain, and that share another pose."""

    rows: BoolArray
    pose: TwoViewPose

    @property
    def count(self) -> int:
        """How many they are."""
        return int(np.count_nonzero(self.rows))


def unexplained(posterior: Posterior) -> BoolArray:
    """(N,) points that the pose does not explain."""
    noise = posterior.fit.epipolar_noise
    level = float(np.hypot(noise.level, noise.shared))
    wrong = ~(np.abs(posterior.fit.found.epipolar) < CUTOFF * level)
    return wrong | behind(posterior.pose, posterior.points, level)


def shifted_copy(posterior: Posterior, outside: BoolArray) -> BoolArray | None:
    """(N,) unexplained points that one shift, in either picture, puts where a plane has them; None where no many are.

    Repeated texture, or a code that repeats, makes such matches. The shift is the mode of what the points ask for.
    """
    points, pose = posterior.points, posterior.pose
    rows = np.flatnonzero(outside)
    fewest = max(FEWEST_OF_A_PART, int(SHARE_OF_A_PART * len(rows)))
    if len(rows) < fewest:
        return None
    noise = float(np.median(np.hypot(points.camera_sigma, points.projector_sigma)))
    noise *= 4 * float(np.hypot(posterior.fit.along_noise.level, posterior.fit.along_noise.shared))
    x = np.column_stack([points.camera_rays[rows], np.ones(len(rows))])
    y = np.column_stack([points.projector_rays[rows], np.ones(len(rows))])
    best: BoolArray | None = None
    for n in pose.planes:
        H = pose.R + np.outer(pose.t, n)
        with np.errstate(all="ignore"):
            forth, back = x @ H.T, y @ np.linalg.inv(H).T
            shifts = (y[:, :2] - forth[:, :2] / forth[:, 2:], x[:, :2] - back[:, :2] / back[:, 2:])
        for shift in shifts:
            near = np.abs(shift[:, None] - shift[None, :: max(1, len(rows) // CENTRES)]).max(axis=2) < noise
            mode = near[:, int(np.argmax(near.sum(axis=0)))]
            if np.count_nonzero(mode) >= fewest and (best is None or np.count_nonzero(mode) > np.count_nonzero(best)):
                best = mode
    if best is None:
        return None
    copy = np.zeros(len(outside), dtype=np.bool_)
    copy[rows[best]] = True
    return copy


def other_part(posterior: Posterior, outside: BoolArray, rng: np.random.Generator) -> OtherPart | None:
    """The unexplained points that share another pose, where they are more than chance brings together."""
    rows = np.flatnonzero(outside)
    if len(rows) < FEWEST_OF_A_PART:
        return None
    points = posterior.points.select(rows)
    noise = float(np.median(np.hypot(points.camera_sigma, points.projector_sigma)))
    noise *= float(np.hypot(posterior.fit.epipolar_noise.level, posterior.fit.epipolar_noise.shared))
    samples = rng.integers(0, len(rows), (60, 5))
    scored = rng.permutation(len(rows))[:600]
    E = best_essential(points.camera_rays, points.projector_rays, noise, samples, scored)
    if E is None:
        return None
    agree = sampson_squares(E, points.camera_rays, points.projector_rays) < (3 * noise) ** 2
    if np.count_nonzero(agree) < max(FEWEST_OF_A_PART, SHARE_OF_A_PART * len(rows)):
        return None
    R, t = poses_of_essential(E)[0]
    part = np.zeros(len(outside), dtype=np.bool_)
    part[rows[agree]] = True
    return OtherPart(part, TwoViewPose(R, t))


def differing_capture(measured: Measured, rays: Rays, answer: Posterior) -> tuple[int, float] | None:
    """The capture whose own pose is furthest from the joint one, in its own sigma; None where there is only one."""
    captures = int(rays.capture.max()) + 1
    if captures < 2:
        return None
    joint = PosePrior(answer.pose.R, answer.pose.t, np.eye(POSE_PARAMETERS))
    furthest = (0, 0.0)
    for capture in range(captures):
        part = measured.select(rays.capture == capture)
        try:
            own = fit_posterior(part, answer.parameters, answer.prior, 4)
            difference = joint.difference(own.pose)
            deviations = float(np.sqrt(difference @ np.linalg.solve(own.covariance, difference)))
        except DegenerateError:  # it says nothing by itself
            continue
        if deviations > furthest[1]:
            furthest = capture, deviations
    return furthest
