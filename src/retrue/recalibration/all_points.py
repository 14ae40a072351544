"""The chosen hypothesis on all points: what it was chosen without does not pull it away."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from retrue.geometry.robust import CUTOFF
from retrue.recalibration.bows import measured_scale
from retrue.recalibration.chance import strays
from retrue.recalibration.costs import total_costs
from retrue.recalibration.posterior import Posterior, improved, posterior_at, same_answer
from retrue.recalibration.rays import Rays

STRAYED = 5  # times, since other points may be strays where the pose then is


def settled(start: Posterior) -> Posterior:
    """The best place near the start, planes being held as flat as the points show them to be."""
    seen = unless_grown(start, improved(start, 1))  # enough to see how planes are bowed
    scale = measured_scale(seen.parameters.bows.ravel(), seen.bow_information)
    parameters = replace(seen.parameters, bows=seen.parameters.bows / scale)
    measured = replace(seen.measured, flatness=scale * seen.measured.flatness)
    there = posterior_at(measured, parameters, seen.prior)
    return unless_grown(there, improved(there, 3))


def unless_grown(there: Posterior, found: Posterior) -> Posterior:
    """What was found, unless an error that neighbours share grew with it, and made it less probable than the other.

    The larger it is across the lines, the less counts what is across them, and planes turn to what is left along them.
    """
    if not found.fit.epipolar_noise.shared > there.fit.epipolar_noise.shared:
        return found
    as_there, as_found = total_costs([there, found])
    return there if as_there < as_found else found


def without_strays(answer: Posterior) -> Posterior:
    """The best place near it without what lies on its epipolar lines by chance, see `strays`, and turned it there."""
    for _ in range(STRAYED):
        aside = answer.measured.aside
        gone = strays(answer.fit, aside)
        if not gone.any():
            break
        measured = replace(answer.measured, aside=gone if aside is None else gone | aside)
        answer = settled(posterior_at(measured, answer.parameters, answer.prior))
    return answer


def pulled_away(answer: Posterior, best: Posterior) -> bool:
    """Whether all points have another pose than those that the best hypothesis was chosen by, beyond its sigma.

    Copies of a print that miss their epipolar lines by little make the noise of all points so loud that they are
    right.
    """
    return best.measured.aside is not None and not same_answer(best, answer.pose)


def apart_as_chosen(there: Posterior, rays: Rays, best: Posterior, few: Rays) -> Posterior:
    """The hypothesis on all points but those that it was chosen without, and what of the others it does not explain.

    `there` is that hypothesis on all `rays`; it was compared on a `few` of them, in the order of all.
    """
    noise, measured = best.fit.epipolar_noise, there.measured
    aside = ~(np.abs(there.fit.found.epipolar) < CUTOFF * noise.total)
    most = int(rays.row.max(initial=0)) + 1
    compared = np.searchsorted(rays.capture * most + rays.row, few.capture * most + few.row)
    aside[compared] = best.measured.aside
    measured = replace(measured, aside=aside if measured.aside is None else aside | measured.aside)
    return posterior_at(measured, there.parameters, there.prior)
