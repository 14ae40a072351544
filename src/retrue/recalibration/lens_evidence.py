"""Do the lenses hold? The same fit with lenses that may have changed, against the one that trusts them."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from retrue.errors import DegenerateError
from retrue.geometry.arrays import FloatArray
from retrue.geometry.robust import biweight_loss
from retrue.geometry.two_view import POSE_PARAMETERS, TwoViewPose
from retrue.recalibration.bows import BOWS, CURVED, bow_shapes
from retrue.recalibration.candidates import behind, same_pose
from retrue.recalibration.chance import beyond_chance
from retrue.recalibration.costs import SELDOM, UNEXPLAINED, anywhere_along, least, price_of, scattered, total_costs
from retrue.recalibration.fit import BLOCKS
from retrue.recalibration.hypotheses import drawn_in
from retrue.recalibration.lens import FOCAL, LENS_PARAMETERS, LensPrior, scaled_starts
from retrue.recalibration.measured import MISFIT_PX
from retrue.recalibration.parameters import Parameters, Prior
from retrue.recalibration.parts import LOUD, Part, plane_levels
from retrue.recalibration.posterior import Measured, Posterior, fit_posterior, posterior_at
from retrue.recalibration.reasons import CLEAR
from retrue.recalibration.rivals import move_deg, move_nats

KNOWN_FOCAL = 0.01
CHANGED_GAIN = 30.0  # of chi-square; eight parameters that nobody touched gain as much once in 5000 times
BEATS = 14.0  # of chi-square: what a changed lens must be better by than whatever else explains the points
DOUBTFUL_GAIN = 9.0
FAR_MOVE_DEG = 10.0
FARTHEST = 3.0  # wide sigma that a lens changes by
DEGREES = 2, 3  # of what is curved: one bend, or one that turns
ROUGHER = 1.2  # along the epipolar line than across it: what a plane leaves is alike
BELIEVED_BLOCKS = BLOCKS**2  # one picture's, that the misfit of real lenses is believed as much as: some have none
PART_PRICE = 60.0  # of chi-square: five free parameters, and the choice of points


@dataclass(frozen=True, slots=True, eq=False)
class LensEvidence:
    """What the points say of the lenses.

    Attributes
    ----------
    verdict : "checked": they hold; "unchecked": the points do not tell; "changed": they do not hold.
    change, sigma : (8,) log focal length, principal point (px), k1 of camera and projector, the lenses being free.
    gain : of chi-square, lenses being free; of a change that is not clear, what a first step would.
    prior : what is believed of the rig's own lenses.
    kept : (8, 8) second moment of what the rig's own lenses are off by, given what the points say.
    posterior : with free lenses, where one was fitted.
    others : likewise, of other poses.
    """

    verdict: Literal["checked", "unchecked", "changed"]
    change: FloatArray
    sigma: FloatArray
    gain: float
    prior: LensPrior
    kept: FloatArray
    posterior: Posterior | None = None
    others: tuple[Posterior, ...] = ()

    @property
    def clearest(self) -> int:
        """Which of the eight numbers changed most clearly; where none did by itself, the one that alone explains most.

        With L the information on lenses and c the change, one number alone gains (L c)_i^2 / L_ii of c^T L c.
        """
        clear = np.abs(self.change) / self.sigma
        if self.posterior is None or clear.max() >= CLEAR:
            return int(np.argmax(clear))
        told = np.linalg.inv(self.posterior.lens_covariance)
        return int(np.argmax((told @ self.change) ** 2 / np.diag(told)))


def lens_evidence(
    measured: Measured,
    homographies: list[FloatArray],
    best: Posterior,
    unbeaten: Sequence[Posterior],
    part: Part | None,
    tight: LensPrior,
    wide: LensPrior,
    old: TwoViewPose,
    searched: Sequence[Parameters] = (),
    changed: Sequence[Parameters] = (),
) -> LensEvidence:
    """Fit again with free lenses where that could gain something; else what it would say is at hand.

    The same through the rig's own lenses begins at the best, where free ones lead, and at what was `searched`; free
    ones begin at what it has left `unbeaten`, too, and where they were found `changed` before.
    """
    real = replace(measured, misfit=MISFIT_PX)
    pull, told, gain = _asked(posterior_at(real, best.parameters, best.prior), tight, wide)
    covariance = _with_prior(told, wide)
    change = covariance @ pull
    moved = move_deg(best.pose, old)
    quiet = min(plane_levels(measured), default=np.inf)
    elsewhere = _shares_an_error(best) or not best.fit.epipolar_noise.level < min(LOUD * quiet, 1.0)
    elsewhere = elsewhere or part is not None or best.measured.aside is not None  # both may be right, through others
    posterior, others = None, ()
    apart = [_with_each_alone(measured, fit, tight, wide) for fit in (best, *unbeaten)]
    led = [start for start in apart if start is not None]
    if gain > DOUBTFUL_GAIN or elsewhere or led or moved > FAR_MOVE_DEG:
        real, free = replace(measured, misfit=untold_misfit(measured)), Prior(wide, free=True)
        at_hand = [best.parameters, *changed, *(fit.parameters for fit in unbeaten), *led]
        starts = [(start, 30) for start in at_hand]
        for fit in (best, *unbeaten) if not measured.textured else ():
            with suppress(DegenerateError):  # what photographs' lenses leave over looks like another, a little further
                starts.append((drawn_in(real, fit.parameters, free), 30))
        if elsewhere or moved > FAR_MOVE_DEG:  # through other lenses, another pose may be it
            for lens, pose in scaled_starts(measured.support.points, homographies, 3):
                starts.append((Parameters.of(pose, lens), 25))
        fits: list[Posterior] = []
        for start, iterations in starts:
            with suppress(DegenerateError):
                fits.append(fit_posterior(real, start, free, iterations))
        posterior = least(fits)
        others = tuple(fit for fit in fits if not same_pose(fit.pose, posterior.pose))
        change, covariance = posterior.parameters.lens, posterior.lens_covariance
    sigma = np.sqrt(np.diag(covariance))
    determined = bool((sigma[FOCAL] <= KNOWN_FOCAL).all())
    # The change itself must be clear: another fit, of whatever kind, is no proof of a lens.
    clear = float(change @ np.linalg.solve(covariance + tight.covariance, change))
    if posterior is not None and clear > CHANGED_GAIN:
        nearer = 2 * (move_nats(moved) - move_nats(move_deg(posterior.pose, old)))
        gain = _gain(real, best, posterior, tight, part, searched) + nearer
    verdict = "changed" if clear > CHANGED_GAIN and gain > BEATS else "checked" if determined else "unchecked"
    prior = _effective_prior(tight, sigma) if verdict == "checked" else tight
    left = _with_prior(told, prior)
    asked = left @ pull  # lenses that stay are off by what the points ask for, too
    kept = left + np.outer(asked, asked)
    return LensEvidence(verdict, change, sigma, gain, prior, kept, posterior, others)


def held_instead(lens: LensEvidence, fits: Sequence[Posterior], asides: Sequence[Part]) -> Posterior | None:
    """Of all explanations through the rig's own lenses, the one that beats changed lenses; None where none does.

    Where codes are wrong, the pose that explains most of them leads to other lenses, and a quieter one of fewer, which
    has the others as copies, costs less than both; or not more, once parts that are in one place are no longer paid for
    by the point.
    """
    if lens.verdict != "changed" or lens.posterior is None:
        return None
    misfit = lens.posterior.measured.misfit
    seen = [posterior_at(replace(fit.measured, misfit=misfit), fit.parameters, fit.prior) for fit in fits]
    changed, *held = total_costs([lens.posterior, *seen], asides)
    least_held = int(np.argmin(held))
    if held[least_held] < changed:
        return fits[least_held]
    gains = [_preferred(one, lens.posterior, None, _louder(one, lens.posterior)) for one in seen]
    least_held = int(np.argmin(gains))
    return fits[least_held] if gains[least_held] < 0 else None


def untold_misfit(measured: Measured) -> float:
    """What real lenses leave, px, beyond what the scatter of B blocks tells: m sqrt(n / (n + B - p)), p unknowns.

    The shared noise of a fit holds that scatter; what its own unknowns took up of it, and few blocks tell nothing of,
    is believed to be as other lenses have it; so is all of it for photographs, whose matches lie where texture is.
    """
    if measured.textured:
        return MISFIT_PX
    blocks = np.unique(measured.support.blocks[0])
    told = max(len(blocks) - POSE_PARAMETERS - 2 * LENS_PARAMETERS, 0)
    return MISFIT_PX * float(np.sqrt(BELIEVED_BLOCKS / (BELIEVED_BLOCKS + told)))


def _with_each_alone(measured: Measured, best: Posterior, tight: LensPrior, wide: LensPrior) -> Parameters | None:
    """Where free lenses lead the pose if each point errs by itself; None where they gain nothing.

    What other lenses do to a pose looks like an error that neighbours share; beside planes, so does what photographs'
    lenses leave over, and those are not asked.
    """
    if len(best.pose.planes) and measured.textured:
        return None
    alone = replace(measured, support=measured.support.each_alone())
    shares = best.measured is not measured or any(noise.shared > 0 for noise in best.fit.noises)
    seen = posterior_at(alone, best.parameters, best.prior) if shares else best  # none shares its error anyway
    if not _asked(seen, tight, wide)[2] > CHANGED_GAIN:
        return None
    try:
        return fit_posterior(alone, best.parameters, Prior(wide, free=True), 30).parameters
    except DegenerateError:
        return None


def _louder(held: Posterior, free: Posterior) -> float:
    """Chi-square that its louder noise costs, of all that it explains: 2 log(s / s') of each residual."""
    counts = (held.fit.robust_weights > 0).sum(axis=1)
    levels = [(one.level / other.level) for one, other in zip(held.fit.noises, free.fit.noises, strict=True)]
    return float(2 * counts @ np.log(np.maximum(levels, 1.0)))


def hidden_by_planes(best: Posterior, part: Part | None, tight: LensPrior, wide: LensPrior, old: TwoViewPose) -> bool:
    """Whether lenses changed by what points say across their epipolar lines alone, where the planes fit badly.

    What passes for planes and is none asks for a pose that no lens gives it; it outvotes what asks for another lens.
    """
    across, along = best.fit.even_levels
    if not (len(best.pose.planes) and (along > ROUGHER * across or _shares_an_error(best))):
        return False
    gone = np.ones(len(best.pose.planes), dtype=np.bool_)
    measured = best.measured.without_planes(gone)
    try:
        alone = fit_posterior(measured, best.parameters.without_planes(gone), best.prior, 6)
        return lens_evidence(measured, [], alone, (), part, tight, wide, old).verdict == "changed"
    except DegenerateError:
        return False


def _shares_an_error(fit: Posterior) -> bool:
    """Whether neighbours leave more in common than their own scatter and real lenses do."""
    noise = fit.fit.epipolar_noise
    return not noise.shared < max(0.5 * noise.level, MISFIT_PX)


def _asked(seen: Posterior, tight: LensPrior, wide: LensPrior) -> tuple[FloatArray, FloatArray, float]:
    """The pull (8,) of the points on the lenses, their information (8, 8), and the chi-square that following gains."""
    pull, told = _believable(seen.lens_pull, seen.lens_information, wide)
    gain = float(pull @ _with_prior(told, wide) @ pull - pull @ _with_prior(told, tight) @ pull)
    return pull, told, gain


def _believable(pull: FloatArray, told: FloatArray, wide: LensPrior) -> tuple[FloatArray, FloatArray]:
    """The pull, as far as it asks for changes of less than `FARTHEST` wide sigma; and the information, not below zero.

    Where the points hardly tell of a lens, as of a bare wall, what is left of a pull is rounding and linearisation.
    """
    root = np.linalg.cholesky(wide.covariance)
    values, vectors = np.linalg.eigh(root.T @ told @ root)
    values = np.maximum(values, 0.0)
    along = np.clip(vectors.T @ (root.T @ pull), -FARTHEST * values, FARTHEST * values)
    back = np.linalg.solve(root.T, vectors)
    return back @ along, (back * values) @ back.T


def _with_prior(told: FloatArray, prior: LensPrior) -> FloatArray:
    """(8, 8) covariance of lenses of which the points tell T: (T + P^-1)^-1 = L (1 + L' T L)^-1 L', with P = L L'.

    So written, it stays positive however much or little the points tell.
    """
    root = np.linalg.cholesky(prior.covariance)
    inverse = np.linalg.inv(np.eye(len(root)) + root.T @ told @ root)
    return root @ ((inverse + inverse.T) / 2) @ root.T


def _gain(
    measured: Measured,
    best: Posterior,
    free: Posterior,
    prior: LensPrior,
    part: Part | None,
    searched: Sequence[Parameters],
) -> float:
    """Chi-square by which the points prefer the free lenses to those of the prior, wherever that fits best.

    In the noise of the latter, which free lenses must explain. Their rival is also a scene whose planes are none, but
    curved: it looks as flat through other lenses as planes do through the rig's own.
    """
    apart = replace(measured, aside=best.measured.aside)
    starts = [(apart, best.eased.parameters), (apart, free.parameters), *((measured, start) for start in searched)]
    gains: list[float] = []
    for measured, start in starts:
        held = fit_posterior(measured, start, Prior(prior, free=True), 15)
        gains.append(_preferred(held, free, part, 0.0))
        for degree in DEGREES if start.bows.size else ():
            if gains[-1] > DOUBTFUL_GAIN:
                held = fit_posterior(*_curved(measured, start, degree), Prior(prior, free=True), 15)
                gains.append(_preferred(held, free, part, _price_of_curving(measured, held)))
    return min(gains)


def _curved(measured: Measured, parameters: Parameters, degree: int) -> tuple[Measured, Parameters]:
    """The same with all its planes as curved surfaces, of polynomials of that degree, each as large as the bows."""
    shapes = bow_shapes(measured.support.points, degree)
    larger = float(np.sqrt(shapes.shape[1] / BOWS))
    flat = ~measured.may_be_curved(len(parameters.bows))
    bows = np.zeros((len(flat), shapes.shape[1]))
    bows[:, :BOWS] = parameters.as_curved(flat).bows
    measured = replace(measured, shapes=shapes, flatness=larger * measured.flatness, curved=np.ones_like(flat))
    return measured, replace(parameters, bows=bows)


def _price_of_curving(measured: Measured, curved: Posterior) -> float:
    """Chi-square that the bows of planes cost which may be curved now, and might not before."""
    bows = curved.parameters.bows
    return 2 * float(np.log(CURVED)) * bows[~measured.may_be_curved(len(bows))].size


def _preferred(held: Posterior, free: Posterior, part: Part | None, price: float) -> float:
    costs, theirs = _joint_costs(held, held), _joint_costs(free, held)
    # The rivals of a changed lens: those points are copies, seen in a mirror, or moved, and as well known.
    # A part in one place was not chosen point by point. Among poses, so cheap a one would excuse what no lens explains.
    parts = [(one.rows, one.seldom * SELDOM * scattered(one, held.measured), price_of(one)) for one in held.parts]
    parts += [(rows, SELDOM, PART_PRICE) for rows in (held.measured.aside, part and part.rows) if rows is not None]
    for rows, each, own_price in parts:
        gained = np.maximum(costs[rows] - theirs[rows] - each, 0.0)
        if float(gained.sum()) > own_price:
            costs[rows] -= gained
            price += own_price
    preferred = costs - theirs
    for one in held.parts:  # what a copy puts in place along its lines, too, is one through any lenses
        if (along := anywhere_along(one, held)).sum() > price_of(one):
            preferred[one.rows] = np.where(along > 0, np.minimum(preferred[one.rows], 0.0), preferred[one.rows])
    # Of chance are points, and what they would have to be excused by; what is believed of lenses is not.
    told = (float(preferred.sum()) + price) * beyond_chance(preferred)
    return told + held.prior_cost - free.prior_cost


def _joint_costs(posterior: Posterior, reference: Posterior) -> FloatArray:
    """(N,) saturating chi-square of both residuals of each point together, at one level.

    Noise is seldom alike along and across the epipolar line, and the lens turns that line: taken one by one, the
    residuals would speak for the lens that turns it along the axes of the noise. So would those of points on no plane,
    which have but one, if the noise across each line did not count as what the planes make of it.
    """
    across, along = reference.fit.epipolar_noise, reference.fit.along_noise
    level = float(np.hypot(across.level, along.level) / np.sqrt(2))
    found = np.hypot(posterior.fit.found.epipolar, np.nan_to_num(posterior.fit.found.along))
    before, after = reference.fit.uneven, posterior.fit.uneven
    if posterior is not reference and before is not None and after is not None:
        louder = np.sqrt(before.usual[0] / after.usual[0]) * before.relative[0] / after.relative[0]
        found = found * np.where(np.isnan(posterior.fit.found.along), louder, 1.0)
    found = biweight_loss(found / level)
    hidden = behind(posterior.pose, posterior.points, posterior.fit.epipolar_noise.level)
    found = np.where(hidden, np.maximum(found, UNEXPLAINED), found)
    return found * level**2 / np.minimum(across.variance_of_blocks, along.variance_of_blocks)


def _effective_prior(tight: LensPrior, sigma: FloatArray) -> LensPrior:
    """Focal lengths that the points checked are not believed more closely than a third of what those tell."""
    widened = np.zeros(2 * LENS_PARAMETERS)
    widened[FOCAL] = np.maximum((sigma[FOCAL] / 3) ** 2 - np.diag(tight.covariance)[FOCAL], 0.0)
    return LensPrior(tight.covariance + np.diag(widened))
