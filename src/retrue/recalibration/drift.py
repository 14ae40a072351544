"""Does the rig's own pose hold? By how much what the captures tell contradicts it, and whether it is better known."""

from __future__ import annotations

import numpy as np

from retrue.errors import InputError
from retrue.geometry.arrays import FloatArray, finite_array
from retrue.geometry.two_view import POSE_PARAMETERS, pose_difference
from retrue.recalibration.chance import deviations_limit, deviations_of_mixture
from retrue.recalibration.fit import carried, own_pose
from retrue.recalibration.judge import Judgement
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.result import Evidence, sigma_at
from retrue.recalibration.slow_errors import taken_up
from retrue.rig import Rig

HELD = 1e-3  # of good rigs that are told to have moved


def drift(rig: Rig, judgement: Judgement, options: RecalibrateOptions) -> float:
    """By how many sigma the captures contradict the rig's own pose: chi with five degrees of freedom if it holds.

    The nearest explanation counts, of those that the captures do not tell apart; what slow errors it took up is not
    known, so that sigma are those exceeded as seldom as its distance is over all of them.
    """
    own, old = own_covariance(rig, options), own_pose(rig)
    unbeaten = [rival.posterior for rival in judgement.rivals if not rival.margin >= options.min_margin]
    possible = [(judgement.answer, judgement.slow), *((fit, taken_up(fit)) for fit in unbeaten)]
    found: list[float] = []
    for fit, slow in possible:
        there = carried(old, fit.pose)
        covariances = fit.covariance + there @ own @ there.T + slow.covariances
        difference = pose_difference(old, fit.pose)
        solved = np.linalg.solve(covariances, difference[:, None])[..., 0]
        found.append(deviations_of_mixture(slow.weights, np.sqrt([one @ difference for one in solved])))
    return min(found)


def own_covariance(rig: Rig, options: RecalibrateOptions) -> FloatArray:
    """(5, 5) of the rig's own pose: what its evidence states, else what the options have."""
    stated = rig.evidence.get("covariance")
    if stated is None:
        rotation, translation = np.radians([options.rig_sigma_rotation_deg, options.rig_sigma_translation_deg])
        return np.diag([rotation**2] * 3 + [translation**2] * 2)
    covariance = finite_array(stated, (POSE_PARAMETERS, POSE_PARAMETERS), "rig evidence, covariance")
    if not np.linalg.eigvalsh(covariance)[0] > 0:
        raise InputError("rig evidence, covariance: expected a covariance, found eigenvalues that are not positive")
    return covariance


def holds(rig: Rig, judgement: Judgement, evidence: Evidence, options: RecalibrateOptions) -> bool:
    """Whether the rig's own pose explains the captures too, and is known more closely than they know it."""
    found = None if evidence.sigma is None else evidence.sigma.displacement
    if found is None or not drift(rig, judgement, options) <= deviations_limit(HELD):
        return False
    known = sigma_at(evidence.working_distance, own_covariance(rig, options), own_pose(rig), rig).displacement
    return known is not None and known <= found
