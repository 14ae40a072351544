"""One posterior: the pose, the planes with their bow, and both lenses, from all points of all captures.

The lenses have the distribution that the calibration left them with; planes are flat up to a bow of known size. So the
covariance of the pose, the marginal of all that, holds what uncertain lenses and bowed walls do to it, and a lens that
the points contradict moves away from its prior instead of bending the pose.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from retrue.errors import DegenerateError
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.robust import COVARIANCE_FACTOR, CUTOFF, total_loss
from retrue.geometry.two_view import (
    NO_TURNS,
    POSE_PARAMETERS,
    TwoViewPoints,
    TwoViewPose,
    behind,
    corrected_rays,
    pose_difference,
    solve_normal_equations,
    step_equations,
)
from retrue.recalibration.chance import without_chance
from retrue.recalibration.fit import (
    PoseFit,
    Support,
    carried,
    evaluate,
    inverse_information,
    own_pose,
    same_pose,
    squared_sigmas,
)
from retrue.recalibration.likelihood import negative_log_likelihood, with_misfit
from retrue.recalibration.measured import Measured
from retrue.recalibration.parameters import LENSES, Parameters, Prior

SETTLED = 0.02  # of a squared standard deviation; after such a step about a sixtieth of that is left
FLAT = 0.02  # of chi-square: what a damped step gains along a valley where nothing more is to be told
SLOW = 0.3  # of the noise, that neighbours share
EASING = 8
WITHIN = 5.0  # sigma
MUCH_DAMPING, LARGEST_DAMPING = 0.3, 1e6
LONG = 1.0  # of a squared standard deviation: a step that damping would make many of
NEARBY, SHARES = 0.05, (1.0, 0.5, 0.25)  # of a step

if TYPE_CHECKING:
    from retrue.recalibration.parts import Part


@dataclass(frozen=True, eq=False)
class Posterior:
    """One place of the parameters, and the shape of the posterior there.

    Attributes
    ----------
    parameters : pose, planes, lenses, bows.
    prior : as it was taken.
    points : rays through those lenses.
    fit : residuals, noise and weights there; its normal equations are those of the pose and the planes alone.
    measured : what it was fitted to.
    """

    parameters: Parameters
    prior: Prior
    points: TwoViewPoints
    fit: PoseFit
    measured: Measured

    @property
    def information(self) -> FloatArray:
        """Of all parameters, priors included."""
        return self._normal_equations[0]

    @property
    def gradient(self) -> FloatArray:
        """Likewise."""
        return self._normal_equations[1]

    @cached_property
    def _normal_equations(self) -> tuple[FloatArray, FloatArray]:
        return _equations(self, lenses=True)

    @cached_property
    def _equations_of_a_step(self) -> tuple[FloatArray, FloatArray]:
        """Of what the points may move."""
        return self._normal_equations if self.prior.free else _equations(self, lenses=False)

    @property
    def pose(self) -> TwoViewPose:
        """R, unit t, planes."""
        return self.parameters.pose

    @cached_property
    def turns(self) -> tuple[FloatArray, FloatArray]:
        """`Measured.turns` where the equations are made."""
        bows = self.measured.bowed(self.parameters.bows)
        rays = corrected_rays(self.pose, self.points, self.fit.weights, bows)
        return self.measured.turns(self.parameters.lens, rays)

    @cached_property
    def covariance(self) -> FloatArray:
        """(5, 5) of the pose, see `pose_covariance`: all else is free within its prior.

        Lenses that are not free move the pose by S a change, see `follows`: the covariance is A^-1 + S P S^T (Schmidt's
        consider covariance). Of the pose that a calibration would have found together with its lenses, it is
        A^-1 + (S - C) P (S - C)^T, with C the prior's `together`.
        """
        if self.prior.free:
            return inverse_information(self.information)[:POSE_PARAMETERS, :POSE_PARAMETERS] * COVARIANCE_FACTOR
        apart = self.follows
        if self.prior.together is not None:
            apart = apart - carried(own_pose(self.measured.rig), self.pose) @ self.prior.together
        return self.statistical_covariance + apart @ self._kept @ apart.T

    @cached_property
    def follows(self) -> FloatArray:
        """(5, 8) by how much the pose follows each parameter of lenses that are not free: S = -A^-1 B.

        A and B are the information of all else and its part with the lenses.
        """
        return -self.own_inverse @ self.information[np.ix_(*self.own_and_lens)]

    @property
    def _kept(self) -> FloatArray:
        return self.prior.lens.covariance if self.prior.kept is None else self.prior.kept

    @property
    def joint_covariance(self) -> FloatArray:
        """(13, 13) of the pose and both lenses: lenses that are not free move the pose with them, see `covariance`."""
        if self.prior.free:
            pose_and_lenses = np.concatenate([np.arange(POSE_PARAMETERS), self.own_and_lens[1]])
            joint = inverse_information(self.information)[np.ix_(pose_and_lenses, pose_and_lenses)]
            scale = np.where(np.arange(len(joint)) < POSE_PARAMETERS, np.sqrt(COVARIANCE_FACTOR), 1.0)
            return joint * np.outer(scale, scale)
        cross = self.follows @ self._kept
        return np.block([[self.statistical_covariance + cross @ self.follows.T, cross], [cross.T, self._kept]])

    @cached_property
    def statistical_covariance(self) -> FloatArray:
        """(5, 5) of the pose, the lenses being exactly as they are."""
        return self.own_inverse[:, :POSE_PARAMETERS] * COVARIANCE_FACTOR

    @cached_property
    def own_inverse(self) -> FloatArray:
        """(5, S) rows of the pose in the inverse information of all but the lenses, those being exactly as they are."""
        own, _ = self.own_and_lens
        return inverse_information(self.information[np.ix_(own, own)])[:POSE_PARAMETERS]

    @cached_property
    def eased(self) -> Posterior:
        """What is compared: `through_free_lenses`, where a slow error asks for it that lenses may make."""
        slow = any(noise.shared > SLOW * noise.level for noise in self.fit.noises)
        return self.through_free_lenses if slow and not self.explains_no_plane else self

    @cached_property
    def through_free_lenses(self) -> Posterior:
        """The same with both lenses free within their prior; itself where these, or the pose, are another hypothesis.

        Points that are more exact than the lenses would else speak for whatever pose follows an error of those. On the
        way, no two points share an error, or all that a lens makes would be taken for it.
        """
        if self.prior.free:
            return self
        prior = replace(self.prior, free=True)
        apart = replace(self.measured, support=self.measured.support.each_alone())
        try:
            moved = fit_posterior(apart, self.parameters, prior, EASING)
        except DegenerateError:
            return self
        same = same_answer(self, moved.pose) and self.prior.lens.likely(moved.parameters.lens)
        return posterior_at(self.measured, moved.parameters, prior) if same else self

    @cached_property
    def losses(self) -> FloatArray:
        """(2, N) `negative_log_likelihood` of both families of residuals."""
        return negative_log_likelihood(self.fit, self.measured)

    @cached_property
    def impossible(self) -> BoolArray:
        """(N,) points that it has behind a device, or explains where it hides them: surfaces are opaque."""
        from retrue.recalibration.costs import hidden

        back = behind(self.pose, self.points, self.fit.epipolar_noise.level)
        copies = [part.rows for part in self.parts if part.seen_through] if self.measured.textured else []
        return np.any([back, hidden(self), *copies], axis=0)

    @cached_property
    def unexplained(self) -> BoolArray:
        """(N,) points that the pose does not explain."""
        level = self.fit.epipolar_noise.total
        wrong = ~(np.abs(self.fit.found.epipolar) < CUTOFF * level)
        return wrong | behind(self.pose, self.points, level)

    @cached_property
    def planes_apart(self) -> dict[int, Part]:
        """Planes that it does not explain, by their numbers."""
        from retrue.recalibration.parts import planes_apart

        return planes_apart(self)

    @property
    def explains_no_plane(self) -> bool:
        """Whether it is far louder on each of its planes than these are by themselves, as no real lens makes it."""
        return 0 < len(self.pose.planes) == len(self.planes_apart)

    @cached_property
    def parts(self) -> list[Part]:
        """Copies of planes that it explains, and planes that it does not: each has its own explanation."""
        from retrue.recalibration.copies import parts_of

        return parts_of(self)

    @cached_property
    def bent_planes(self) -> tuple[IntArray, FloatArray]:
        """The largest planes, of which there may be copies, and how each is bent: see `shifts.bent_planes`."""
        from retrue.recalibration.shifts import bent_planes

        return bent_planes(self)

    @property
    def lens_covariance(self) -> FloatArray:
        """(8, 8) of free lenses, all else being free too."""
        return inverse_information(self.information)[np.ix_(self.own_and_lens[1], self.own_and_lens[1])]

    @property
    def lens_information(self) -> FloatArray:
        """(8, 8) what the points alone say of both lenses, all else being free."""
        own, lens = self.own_and_lens
        cross = self.information[np.ix_(own, lens)]
        settled = solve_normal_equations(self.information[np.ix_(own, own)], cross)
        told = self.information[np.ix_(lens, lens)] - cross.T @ settled
        return (told + told.T) / 2 - self.prior.lens.precision

    @property
    def lens_pull(self) -> FloatArray:
        """(8,) where the points alone draw the rig's lenses, in the metric of `lens_information`, all else settled."""
        own, lens = self.own_and_lens
        cross = self.information[np.ix_(own, lens)]
        settled = solve_normal_equations(self.information[np.ix_(own, own)], self.gradient[own])
        pull = cross.T @ settled - self.gradient[lens]
        return pull + (self.lens_information + self.prior.lens.precision) @ self.parameters.lens

    @property
    def bow_information(self) -> FloatArray:
        """(B P, B P) of the bows, priors included, pose and planes being free, the lenses as they are."""
        own, _ = self.own_and_lens
        information = self.information[np.ix_(own, own)] if self.prior.free else self._equations_of_a_step[0]
        first = POSE_PARAMETERS + 3 * len(self.pose.planes)
        cross = information[:first, first:]
        told = information[first:, first:] - cross.T @ solve_normal_equations(information[:first, :first], cross)
        return (told + told.T) / 2

    @cached_property
    def own_and_lens(self) -> tuple[IntArray, IntArray]:
        """Numbers of all parameters but the lenses, the pose first; and of the lenses."""
        start = POSE_PARAMETERS + 3 * len(self.pose.planes)
        everything = np.arange(start + LENSES + self.parameters.bows.size)
        return np.delete(everything, slice(start, start + LENSES)), everything[start : start + LENSES]

    @cached_property
    def prior_cost(self) -> float:
        """Squared Mahalanobis length of the parameters in their priors."""
        return self.prior.cost(self.parameters)

    def step(self, damping: float) -> tuple[FloatArray, float]:
        """Of a Levenberg-Marquardt iteration, and its squared length in sigma; lenses that are not free stay."""
        information, gradient = self._equations_of_a_step
        step = solve_normal_equations(information, -gradient, damping)
        return self._of_all(step), float(step @ information @ step)

    def bend(self, step: FloatArray) -> FloatArray:
        """By how much the valley bends along a step d: a = -A^-1 J^T W r'', with r'' the residuals' second derivative.

        The way down is d s + a s^2 / 2, the geodesic (Transtrum and Sethna 2012, arXiv:1201.5885).
        """
        there = [self.parameters.moved(sign * NEARBY * step) for sign in (1, -1)]
        ahead, back = (posterior_at(self.measured, one, self.prior).fit.found.both for one in there)
        second = np.nan_to_num((ahead - 2 * self.fit.found.both + back) / NEARBY**2)
        bows, turns = self.measured.bowed(self.parameters.bows), self.turns if self.prior.free else NO_TURNS
        found = replace(self.fit.found, both=np.ascontiguousarray(second))
        _, gradient = step_equations(self.pose, self.points, self.fit.weights, found, turns, bows)
        return self._of_all(solve_normal_equations(self._equations_of_a_step[0], -gradient))

    def _of_all(self, step: FloatArray) -> FloatArray:
        """Of all parameters, lenses that stay among them."""
        first = POSE_PARAMETERS + 3 * len(self.pose.planes)
        return step if self.prior.free else np.concatenate([step[:first], np.zeros(LENSES), step[first:]])


def same_answer(best: Posterior, pose: TwoViewPose) -> bool:
    """Whether a pose is no other explanation: found twice, or one that the sigma of the best holds already."""
    return same_pose(pose, best.pose) or squared_sigmas(pose, best.pose, best.covariance) < WITHIN**2


def fit_posterior(measured: Measured, start: Parameters, prior: Prior, iterations: int) -> Posterior:
    """The most probable parameters near the start; DegenerateError where the points do not determine a pose."""
    return improved(posterior_at(measured, start, prior), iterations)


def improved(here: Posterior, iterations: int) -> Posterior:
    """Robust Levenberg-Marquardt from one place to a better one."""
    cost, damping, too_long = fit_cost(here, here), 0.0, False
    for _ in range(iterations):
        step, length = here.step(damping)
        moved = posterior_at(here.measured, here.parameters.moved(step), here.prior)
        gained, least = cost - fit_cost(moved, here), -(cost * 1e-9 + 1e-6)
        if not gained >= least:  # the valley bends: a straight step leaves it, and one more leads back, further down
            back = posterior_at(here.measured, moved.parameters.moved(moved.step(damping)[0]), here.prior)
            if fit_cost(back, here) < fit_cost(moved, here):
                moved, gained = back, cost - fit_cost(back, here)
        if not gained >= least and damping == 0 and length > LONG:  # or it bends all the way
            moved, gained = _along_the_valley(here, step)
        if not gained >= least:
            damping, too_long = max(10 * damping, 1e-4), True
            if damping > LARGEST_DAMPING or length < SETTLED:
                break
            continue
        settled = (damping < 1e-3 and length < SETTLED) or (0 < damping < MUCH_DAMPING and gained < FLAT)
        if not too_long:  # else a step with less damping has just failed: once more with this one
            damping = damping / 10 if damping > 1e-7 else 0.0
        here, cost, too_long = moved, fit_cost(moved, moved), False
        if settled:
            break
    return here


def _along_the_valley(here: Posterior, step: FloatArray) -> tuple[Posterior, float]:
    """The furthest place down a valley that bends, of whole, half and quarter steps; and what it gains."""
    cost, bend = fit_cost(here, here), here.bend(step)
    moved, gained = here, -np.inf
    for share in SHARES:
        parameters = here.parameters.moved(share * step + share**2 / 2 * bend)
        if not here.prior.cost(parameters) < cost:  # nothing that points may gain makes up for such lenses
            continue
        moved = posterior_at(here.measured, parameters, here.prior)
        gained = cost - fit_cost(moved, here)
        if gained > 0:
            break
    return moved, gained


def fit_cost(fit: Posterior, reference: Posterior) -> float:
    """In the noise of the reference, which a step is taken in."""
    return sum(total_loss(*one) for one in zip(fit.fit.found.both, reference.fit.noises, strict=True)) + fit.prior_cost


def posterior_at(measured: Measured, parameters: Parameters, prior: Prior) -> Posterior:
    """Residuals, noise and weights at one place of the parameters; normal equations when they are asked for."""
    points = measured.seen(parameters.lens)
    support, bows = Support(points, measured.support.blocks), measured.bowed(parameters.bows)
    fit = evaluate(parameters.pose, support, bows, measured.aside, measured.noise_shape)
    fit = without_chance(fit, measured.aside, measured.lone)
    fit = with_misfit(fit, measured) if measured.misfit > 0 else fit
    return Posterior(parameters, prior, points, fit, measured)


def _equations(posterior: Posterior, lenses: bool) -> tuple[FloatArray, FloatArray]:
    """Information and gradient of pose, planes, lenses where they are asked for, and bows; priors included."""
    pose, prior, fit = posterior.pose, posterior.prior, posterior.fit
    bows, turns = posterior.measured.bowed(posterior.parameters.bows), posterior.turns if lenses else NO_TURNS
    information, gradient = step_equations(pose, posterior.points, fit.weights, fit.found, turns, bows)
    if lenses:
        lens = slice(POSE_PARAMETERS + 3 * len(pose.planes), POSE_PARAMETERS + 3 * len(pose.planes) + LENSES)
        information[lens, lens] += prior.lens.precision
        gradient[lens] += prior.lens.precision @ posterior.parameters.lens
    if prior.pose is not None:
        there = carried(pose, prior.pose.pose)
        information[:POSE_PARAMETERS, :POSE_PARAMETERS] += there.T @ prior.pose.precision @ there
        gradient[:POSE_PARAMETERS] -= there.T @ prior.pose.precision @ pose_difference(pose, prior.pose.pose)
    return information, gradient
