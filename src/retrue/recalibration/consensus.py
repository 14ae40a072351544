"""Most points may share a pose more quietly than all of them do: a fit to all takes the others for noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from retrue.errors import DegenerateError
from retrue.geometry.arrays import FloatArray
from retrue.geometry.robust import QUARTILE, quantile
from retrue.geometry.two_view import epipolar_residuals
from retrue.recalibration.candidates import MOST, of_five_points
from retrue.recalibration.hypotheses import Hypothesis, hypothesis, one_place
from retrue.recalibration.lens import LensPrior
from retrue.recalibration.measured import MISFIT_PX
from retrue.recalibration.parameters import Parameters, Prior
from retrue.recalibration.parts import ELSEWHERE, FEWEST_OF_A_PART, LOUD, Part, set_aside
from retrue.recalibration.posterior import Measured, Posterior, posterior_at

AGREES = 3.0  # sigma
STEPS = 4  # at most, of fitting those that agree, and asking again which those are
UNEVEN = 0.5  # of the noise of each point: so much that neighbours share is more than they err alike, or another thing


def quieter_majorities(
    measured: Measured,
    posteriors: Sequence[Posterior],
    noise: float,
    local: float,
    prior: Prior,
    tight: LensPrior,
    homographies: list[FloatArray],
    rng: np.random.Generator,
) -> list[Hypothesis]:
    """Poses of most points that set the others aside, where those of all points may be held by what does not belong.

    A part that misses its epipolar lines by few sigma, as a copy does that was shifted along them, is no outlier to a
    level that is estimated with it, and a fit that begins at the right pose leaves it. Concentration steps do not, at
    the level of the nearest quarter of the points, or of neighbours about each other (`local`, in the unit of the rays)
    where that is less (Rousseeuw, Van Driessen 1999), but not of what lenses leave over. They are asked where the
    points are louder, or share much of it.
    """
    points = measured.support.points
    own = max(local / quantile(np.hypot(points.camera_sigma, points.projector_sigma), 0.5), MISFIT_PX)
    quietest = min((fit.fit.epipolar_noise for fit in posteriors), key=lambda one: one.level)
    if not (quietest.level > LOUD * own or quietest.shared > UNEVEN * quietest.level):
        return []
    everywhere = np.arange(len(points))
    starts = [
        start for level in (noise, local) for start in of_five_points(points, everywhere, homographies, level, rng)
    ]
    found: list[Hypothesis] = []
    for start in starts:
        one = _concentrated(measured, Parameters.of(start), own, prior, tight, homographies, found)
        found += [] if one is None else [one]
    quiet = quietest.level / LOUD  # fewer points are a little quieter anyway
    return [one for one in found if one.better().fit.epipolar_noise.level < quiet]


def _concentrated(
    measured: Measured,
    start: Parameters,
    own: float,
    prior: Prior,
    tight: LensPrior,
    homographies: list[FloatArray],
    known: Sequence[Hypothesis],
) -> Hypothesis | None:
    """The hypothesis of the points that agree with it; None where those are nearly all, or too few, or it is known."""
    points, found = measured.support.points, None
    missed = epipolar_residuals(start.pose, points)
    for _ in range(STEPS):
        level = min(own, quantile(np.abs(missed), 0.25) / QUARTILE)
        away = ~(np.abs(missed) < AGREES * level)
        if not FEWEST_OF_A_PART <= np.count_nonzero(away) < (1 - MOST) * len(points):
            return None
        part = Part(ELSEWHERE, away, 5, np.empty((0, 2)), 0.0)
        try:
            before, found = found, hypothesis(set_aside(measured, part), start, prior, tight, homographies)
            fit = found.better()
            if any(one_place(fit, other.better()) for other in known):
                return None
            if before is not None and one_place(fit, before.better()):
                return found
            missed = posterior_at(measured, fit.parameters, fit.prior).fit.found.epipolar
        except DegenerateError:
            return None
        start = fit.parameters
    return found
