"""By how much points contradict a pose, whether or not they know a better one; and which capture does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from retrue.errors import DegenerateError
from retrue.geometry.arrays import FloatArray
from retrue.geometry.two_view import TwoViewPose, planes_of_pose
from retrue.recalibration.fit import chi_square, squared_sigmas
from retrue.recalibration.measured import Measured
from retrue.recalibration.parameters import PosePrior, Prior
from retrue.recalibration.parts import FEWEST_OF_A_PART
from retrue.recalibration.posterior import Posterior, fit_posterior, posterior_at
from retrue.recalibration.rays import Rays
from retrue.recalibration.slow_errors import taken_up

MOST_DEVIATIONS = 6.0  # of a capture from the others' pose


def contradiction(answer: Posterior, pose: TwoViewPose, covariance: FloatArray) -> float:
    """In sigma: the root of the likelihood ratio of the best explanation near `answer` and the best at another pose.

    Planes, bows and lenses are fitted anew at that pose, within its covariance (5, 5). Where the points hardly tell a
    pose, their own covariance holds near their answer alone, and its distance from the other pose says nothing.
    """
    measured, lens = answer.measured, answer.prior.lens
    best = fit_posterior(measured, answer.parameters, Prior(lens, free=True), 10)
    precision: FloatArray = np.linalg.inv(covariance).astype(np.float64)
    held = Prior(lens, free=True, pose=PosePrior(pose, precision))
    homographies = [answer.pose.R + answer.pose.t[:, None] * n for n in answer.pose.planes]
    there = replace(pose, planes=planes_of_pose(pose.R, pose.t, homographies))
    ratios: list[float] = []
    for start in (replace(answer.parameters, pose=there), answer.parameters):
        fit = fit_posterior(measured, start, held, 15)
        lost = chi_square(fit.fit, best.fit) - chi_square(best.fit, best.fit)
        ratios.append(float(lost.sum()) + fit.prior_cost - best.prior_cost)
    return float(np.sqrt(max(min(ratios), 0.0)))


def differing_capture(measured: Measured, rays: Rays, answer: Posterior) -> tuple[int, float] | None:
    """The capture that contradicts the joint pose, or that of the others, the most, in sigma; None where there is one.

    Infinitely far is one that was set aside whole: hardly a point of it agrees with the joint pose.
    """
    captures = int(rays.capture.max()) + 1
    if captures < 2:
        return None
    furthest = (0, 0.0)
    for capture in range(captures):
        mine = rays.capture == capture
        if np.count_nonzero(mine & answer.fit.explained) < FEWEST_OF_A_PART <= np.count_nonzero(mine):
            return capture, np.inf
        try:
            # all points of a capture may be of another pose, but not what the answer has set aside of the others
            own = _own_pose(replace(measured, aside=None).select(mine), answer)
            others = _own_pose(measured.select(~mine), answer)
        except DegenerateError:  # it says nothing by itself
            continue
        mine_alone, theirs = (fit.covariance + taken_up(fit).covariance for fit in (own, others))
        from_joint = _apart(own, answer.pose, answer.covariance, mine_alone)  # which rests on it, too
        deviations = max(from_joint, _apart(own, others.pose, theirs, mine_alone + theirs))
        if deviations > furthest[1]:
            furthest = capture, deviations
    return furthest


def _own_pose(measured: Measured, answer: Posterior) -> Posterior:
    """Of some captures, sought as if no two points shared an error: what another pose leaves would be taken for one."""
    prior = replace(answer.prior, kept=None, together=None)  # each follows the lenses' errors in its own way
    apart = replace(measured, support=measured.support.each_alone())
    return posterior_at(measured, fit_posterior(apart, answer.parameters, prior, 6).parameters, prior)


def _apart(own: Posterior, pose: TwoViewPose, covariance: FloatArray, of_distance: FloatArray) -> float:
    """In sigma: by how far its own pose is off another, and by what its points say of that, whichever is less."""
    deviations = float(np.sqrt(squared_sigmas(pose, own.pose, of_distance)))
    return min(deviations, contradiction(own, pose, covariance)) if deviations > MOST_DEVIATIONS else deviations
