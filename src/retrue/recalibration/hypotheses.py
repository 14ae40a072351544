"""Each hypothesis through the rig's own lenses and through those that it asks for, with all points or without parts."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from retrue.errors import DegenerateError
from retrue.geometry.arrays import BoolArray, FloatArray
from retrue.geometry.robust import biweight_level, gather_weights
from retrue.geometry.two_view import TwoViewPose, planes_of_pose
from retrue.recalibration.all_points import unless_grown
from retrue.recalibration.candidates import MOST, twins_of_planes
from retrue.recalibration.copies import copies_explained
from retrue.recalibration.costs import PARAMETER, RARE, total_costs
from retrue.recalibration.fit import squared_sigmas
from retrue.recalibration.lens import LensPrior
from retrue.recalibration.likelihood import with_misfit
from retrue.recalibration.measured import MISFIT_PX
from retrue.recalibration.parameters import Parameters, Prior
from retrue.recalibration.parts import (
    ELSEWHERE,
    Part,
    agreeing,
    most_unexplained,
    parts_apart,
    plane_levels,
    set_aside,
)
from retrue.recalibration.posterior import Measured, Posterior, fit_cost, fit_posterior, posterior_at

GATHERED = 15  # steps
DRAWN_IN = 1e-7  # of a squared sigma: what follows is settled long before
SETTLED = 15  # likewise
MOVES = 30.0  # of chi-square, by which lenses that move must be better; by chance eight numbers gain it once in 5000
LOPSIDED = 2.0  # noise across the lines over that along them: what a plane leaves is alike
LEAST_LEFT = 0.05  # of the points, as many as a plane holds at least


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One explanation of the captures.

    Lenses that are off by what a calibration leaves open make points and planes disagree, as parts of two poses do, or
    as if all of them were loud. Each of these is a hypothesis of its own, and moved lenses are the rival of both.

    Attributes
    ----------
    fixed : through the lenses as they were given.
    moved : through lenses that move as far as the calibration allows; None where nothing asks for it.
    """

    fixed: Posterior
    moved: Posterior | None

    def better(self, asides: Sequence[Part] = ()) -> Posterior:
        """Through moved lenses where these are clearly better, whichever parts have an explanation of their own."""
        if self.moved is None:
            return self.fixed
        as_given, through_moved = total_costs(self._with_misfit, asides)
        return self.moved if as_given - through_moved > MOVES else self.fixed

    @cached_property
    def _with_misfit(self) -> list[Posterior]:
        """Both as they are compared: what no lens explains of a real one is a rival of lenses that move."""
        forms = [fit for fit in (self.fixed, self.moved) if fit is not None]
        return [_through_real_lenses(fit) for fit in forms]


def hypotheses_of(
    measured: Measured,
    starts: Sequence[Parameters],
    prior: Prior,
    tight: LensPrior,
    homographies: list[FloatArray],
) -> list[Hypothesis]:
    """One for each start; of those that lead to the same place through the rig's own lenses, the first."""
    found: list[Hypothesis] = []
    for start in starts:
        fit = _fixed(measured, start, prior)
        if start.lens.any() or not any(one_place(fit, other.fixed) for other in found):
            found.append(_in_both_forms(fit, start, tight, homographies))
    return found


def hypothesis(
    measured: Measured, start: Parameters, prior: Prior, tight: LensPrior, homographies: list[FloatArray]
) -> Hypothesis:
    """The most probable parameters near the start, in both forms; DegenerateError where no pose is determined."""
    return _in_both_forms(_fixed(measured, start, prior), start, tight, homographies)


def _in_both_forms(fit: Posterior, start: Parameters, tight: LensPrior, homographies: list[FloatArray]) -> Hypothesis:
    # What photographs' lenses leave over looks like other lenses, and is slower than its scatter.
    asked = not (fit.prior.free or fit.measured.textured)
    return Hypothesis(fit, _moved(fit, start, tight, homographies) if asked else None)


def _fixed(measured: Measured, start: Parameters, prior: Prior) -> Posterior:
    """Through the lenses as they were given.

    A slow error across the lines makes what is across them count less; planes then turn to what is left along them, and
    it grows. Where it may have, the fit in which no two points share an error is its rival. Captures that share no pose
    leave such an error, too, and are told by it.
    """
    start = start if prior.free else replace(start, lens=np.zeros_like(start.lens))
    fit = fit_posterior(measured, start, prior, 6)
    across, along = fit.fit.noises
    lopsided = len(start.pose.planes) > 0 and across.shared > 0 and across.level > LOPSIDED * along.level
    if not lopsided or measured.support.captures > 1:
        return fit
    alone = fit_posterior(replace(measured, support=measured.support.each_alone()), start, prior, 6)
    return unless_grown(posterior_at(measured, alone.parameters, prior), fit)


def _through_real_lenses(fit: Posterior) -> Posterior:
    """The same place, with what real lenses leave over."""
    measured = replace(fit.measured, misfit=MISFIT_PX)
    if fit.measured.misfit > 0:
        return posterior_at(measured, fit.parameters, fit.prior)
    return replace(fit, measured=measured, fit=with_misfit(fit.fit, measured))


def _moved(fit: Posterior, start: Parameters, tight: LensPrior, homographies: list[FloatArray]) -> Posterior | None:
    """Each point errs by itself on the way, or all that a lens makes would be taken for a shared error.

    Planes start where their homographies have them: through lenses that are off, they may have bent to what they miss.
    """
    free = Prior(tight, free=True)
    alone = replace(fit.measured, support=fit.measured.support.each_alone())
    found: list[Posterior] = []
    with suppress(DegenerateError):
        _, gain = posterior_at(alone, fit.parameters, free).step(0.0)
        if fit.parts or gain > MOVES:
            R, t = fit.pose.R, fit.pose.t
            near = Parameters.of(TwoViewPose(R, t, planes_of_pose(R, t, homographies)))
            found.append(fit_posterior(alone, drawn_in(alone, near, free), free, SETTLED))
    if start.lens.any():  # it was so before, and through the rig's lenses it may have gone astray
        with suppress(DegenerateError):
            found.append(fit_posterior(alone, start, free, SETTLED))
    if not found:
        return None
    moved = [posterior_at(fit.measured, one.parameters, free) for one in found]
    best = moved[0] if len(moved) == 1 else moved[int(np.argmin(total_costs(moved)))]
    return best if tight.likely(best.parameters.lens) else None


def drawn_in(measured: Measured, start: Parameters, prior: Prior) -> Parameters:
    """Draw in what a pose of one plane misses, as `gather` does, the lenses being free.

    Through wrong lenses a plane alone is explained by a wrong pose, and what else is seen then looks like an outlier.
    """
    plane_index = np.ascontiguousarray(measured.support.points.plane_index)
    floor = reach = np.inf
    for _ in range(GATHERED):
        here = posterior_at(measured, start, prior)
        both = here.fit.found.both
        floor = floor if len(start.pose.planes) else biweight_level(here.fit.found.epipolar)
        weights, floor, reach = gather_weights(both, plane_index, len(start.pose.planes), floor, reach)
        robust = np.zeros(weights.shape)
        for own, weight, noise in zip(robust, weights, here.fit.noises, strict=True):
            np.multiply(weight, noise.variance, out=own, where=weight > 0)
        step, length = replace(here, fit=replace(here.fit, robust_weights=robust)).step(0.0)
        start = start.moved(step)
        if length < DRAWN_IN and (reach <= floor or reach == np.inf):  # which it stays, where most of them are silent
            break
    return start


def without_parts(
    hypotheses: Sequence[Hypothesis],
    best: Posterior,
    asides: Sequence[Part],
    homographies: list[FloatArray],
    tight: LensPrior,
    *,
    alone: bool,
) -> list[Hypothesis]:
    """Each hypothesis fitted again without the parts that it does not explain, though they have an explanation.

    And each plane of a capture that is `alone` by itself, where the best is louder than one of them by more than a part
    costs: it may explain what does not belong together. Captures are one as loud, one as quiet.
    """
    measured = best.measured
    points, prior = measured.support.points, hypotheses[0].fixed.prior
    part = most_unexplained(asides, best)
    fitted = [fit for one in hypotheses for fit in (one.fixed, one.moved) if fit is not None]
    apart_from = [(fit, parts_apart(fit, part)) for fit in fitted]
    if measured.textured:
        apart_from += [(one.fixed, [copy]) for one in hypotheses for copy in copies_explained(one.fixed)]
    else:  # codes that are whole periods off are copies to both sides
        apart_from.append((best, copies_explained(best)))
    starts = [(fit.parameters, others) for fit, others in _once([one for one in apart_from if one[1]])]
    level = max(noise.level for noise in best.eased.fit.noises)
    gained = len(points) * 4 * float(np.log(level / min(plane_levels(measured), default=level)))
    if alone and len(homographies) > 1 and not gained < 2 * PARAMETER + RARE:
        for plane, twin in twins_of_planes(points, homographies):
            elsewhere = points.plane_index != plane
            starts.append((Parameters.of(twin), [Part(ELSEWHERE, elsewhere, 8, np.empty((0, 2)), 0.0)]))
    found: list[Hypothesis] = []
    for start, others in starts:
        if others:
            apart = measured
            for other in others:
                apart = set_aside(apart, other)
            left = LEAST_LEFT if alone else MOST  # several captures of a rig share its pose, and so do most points
            if apart.aside is not None and np.count_nonzero(~apart.aside) < len(points) * left:
                continue  # what is left of it any pose explains
            try:
                if any(other.name == ELSEWHERE for other in others):  # the plane led there; what agrees belongs to it
                    led = _fixed(apart, start, prior)
                    apart, start = with_agreeing(led), led.parameters
                found.append(hypothesis(apart, start, prior, tight, homographies))
            except DegenerateError:
                continue
    return found


def _once(starts: list[tuple[Posterior, list[Part]]]) -> list[tuple[Posterior, list[Part]]]:
    """Starts with the parts that each goes without; the same without the same points but once."""
    kept: list[tuple[Posterior, list[Part], BoolArray]] = []
    for fit, others in starts:
        gone = np.any([other.rows for other in others], axis=0)
        if not any(np.array_equal(gone, rows) and one_place(fit, other) for other, _, rows in kept):
            kept.append((fit, others, gone))
    return [(fit, others) for fit, others, _ in kept]


def one_place(fit: Posterior, other: Posterior) -> bool:
    """Whether a sigma holds both, lenses being as they are, and both fit as well: another fit would end at the same."""
    if fit.prior.free != other.prior.free or not abs(fit_cost(fit, other) - fit_cost(other, other)) < 1:
        return False
    with suppress(DegenerateError):  # of none that the points do not determine
        return squared_sigmas(fit.pose, other.pose, other.statistical_covariance) < 1
    return False


def with_agreeing(fit: Posterior) -> Measured:
    """What it was fitted to, with those of the points set aside that lie on their epipolar lines nevertheless."""
    aside = fit.measured.aside
    return fit.measured if aside is None else replace(fit.measured, aside=aside & ~agreeing(fit))
