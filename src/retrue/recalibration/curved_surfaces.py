"""Planes, or the same as surfaces that are curved: balls, hills and faces in a small window are nearly flat.

A plane that is none bends the pose, with as little noise as any. Its rival is the same surface, much more bowed than
walls are.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from retrue.errors import DegenerateError
from retrue.geometry.arrays import BoolArray
from retrue.geometry.two_view import FREE, TwoViewPose
from retrue.recalibration.bows import CURVED
from retrue.recalibration.costs import least, total_costs
from retrue.recalibration.doubtful_planes import MOST_BOW, curved_planes
from retrue.recalibration.lens_evidence import untold_misfit
from retrue.recalibration.parameters import Parameters, Prior
from retrue.recalibration.posterior import Measured, Posterior, fit_posterior, posterior_at, same_answer
from retrue.recalibration.rivals import Rival, move_deg, move_nats

ITERATIONS = 10
GAIN = 12.0  # of chi-square: a first step that gains less leads to no rival
STRAY = 0.05  # of the points of planes, which no step is led by


def curved_rival(best: Posterior, old: TwoViewPose) -> Rival | None:
    """The best explanation with its planes as curved surfaces; None where that is no other answer, nor a better one.

    Twice the log evidence of each is its cost, and what its bows had to choose from: -log det of their information,
    with a prior of unit variance, all else being free (Laplace). Lenses are free within their prior, for those bend
    planes, too, and what no model of a lens explains of a real one counts as noise.
    """
    if not (len(best.pose.planes) and _may_gain(best)):
        return None
    curved = np.ones(len(best.pose.planes), dtype=np.bool_)
    try:
        bent = fit_posterior(*_with_free_lenses(best, curved), ITERATIONS)
        flattened = replace(best, parameters=replace(bent.parameters, bows=bent.parameters.bows * CURVED))
        flat = least([fit_posterior(*_with_free_lenses(start, ~curved), ITERATIONS) for start in (best, flattened)])
    except DegenerateError:
        return None
    costs = np.array(total_costs([bent, flat]))
    chosen = np.array([np.linalg.slogdet(fit.bow_information)[1] for fit in (bent, flat)])
    moves = [move_nats(move_deg(fit.pose, old)) for fit in (bent, best)]
    rival = Rival("a curved surface", bent, 0.5 * float(np.subtract(*(costs + chosen))), 0.0, moves[0] - moves[1])
    return None if same_answer(best, bent.pose) and rival.margin >= 0 else rival


def curved_of(rival: Rival) -> BoolArray:
    """(P,) which of its planes are curved: more than walls are, or the most."""
    bows = np.abs(rival.posterior.parameters.bows).max(axis=1) * CURVED
    return bows >= min(MOST_BOW, float(bows.max()))


def surfaces_of(fit: Posterior, bent: BoolArray) -> BoolArray:
    """(P,) which of those planes, as flat as walls before, are surfaces nevertheless, if they may be curved.

    Such a surface has most of its points, hardly scattered.
    """
    if not bent.any():
        return bent
    try:
        measured = replace(fit.measured, curved=fit.measured.may_be_curved(len(bent)) | bent)
        curved = fit_posterior(measured, fit.parameters.as_curved(bent), fit.prior, ITERATIONS)
        determined = bool(np.isfinite(curved.covariance).all())
    except DegenerateError:
        return np.zeros_like(bent)
    plane, there = curved.points.plane_index, curved.fit.robust_weights[1] > 0
    counts = [np.bincount(plane[rows], minlength=len(bent)) for rows in (plane != FREE, there & (plane != FREE))]
    return bent & ~curved_planes(curved) & (2 * counts[1] > counts[0]) & determined


def _may_gain(fit: Posterior) -> bool:
    """Whether a first step gains something, or points of planes are off them, which lead no step.

    Each point errs by itself: what is curved looks like an error that neighbours share, too.
    """
    on = fit.points.plane_index != FREE
    if np.count_nonzero(on & ~(fit.fit.robust_weights[1] > 0)) > STRAY * np.count_nonzero(on):
        return True
    measured, start, prior = _with_free_lenses(fit, np.ones(len(fit.pose.planes), dtype=np.bool_))
    alone = replace(measured, support=measured.support.each_alone())
    with suppress(DegenerateError):
        return posterior_at(alone, start, prior).step(0.0)[1] > GAIN
    return False


def _with_free_lenses(fit: Posterior, curved: BoolArray) -> tuple[Measured, Parameters, Prior]:
    """To fit the same with those of its planes, which were flat, as curved surfaces, and free lenses."""
    measured = replace(fit.measured, curved=curved, misfit=untold_misfit(fit.measured))
    return measured, fit.parameters.as_curved(curved), replace(fit.prior, free=True)
