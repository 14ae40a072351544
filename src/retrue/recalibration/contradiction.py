"""By how much points contradict a pose, whether or not they know a better one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from retrue.geometry.arrays import FloatArray
from retrue.geometry.two_view import TwoViewPose, planes_of_pose
from retrue.recalibration.fit import chi_square
from retrue.recalibration.posterior import PosePrior, Posterior, Prior, fit_posterior


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
