"""Which pose, why that one, and how sure: the best of all hypotheses, and by how much it beats each of the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from retrue.correspondences import Correspondences
from retrue.geometry.arrays import BoolArray, FloatArray
from retrue.geometry.transform import direction_angle, rotation_angle
from retrue.recalibration.all_points import apart_as_chosen, pulled_away, settled, without_strays
from retrue.recalibration.contradiction import MOST_DEVIATIONS, differing_capture
from retrue.recalibration.copies import shifted_copy
from retrue.recalibration.costs import copies_that_pay
from retrue.recalibration.explanation import Beliefs, explained
from retrue.recalibration.lens import LENS_NAMES, LENS_PARAMETERS
from retrue.recalibration.lens_evidence import LensEvidence
from retrue.recalibration.near_rivals import allowed_error, near_rivals, spread
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.parameters import Prior
from retrue.recalibration.parts import (
    IN_A_MIRROR,
    Part,
    agreeing_with_both,
    other_part,
    parts_apart,
    set_aside,
)
from retrue.recalibration.posterior import Measured, Posterior, posterior_at
from retrue.recalibration.rays import Rays, loudest_px
from retrue.recalibration.reasons import (
    CapturesDiffer,
    DevicesExchanged,
    Imprecise,
    LensChanged,
    PartsContradict,
    PointsDisagree,
    PoseInverted,
    PoseUndetermined,
    Reason,
    RivalUnbeaten,
    TooFewPoints,
    Undecidable,
)
from retrue.recalibration.result import PoseSigma, working_distance
from retrue.recalibration.rivals import Rival, move_deg, ranked
from retrue.recalibration.scene import Scene, scene_of
from retrue.recalibration.slow_errors import TakenUp, taken_up
from retrue.recalibration.swapped import move_if_exchanged
from retrue.recalibration.together import pose_with_lenses
from retrue.rig import Rig

LARGEST_OTHER_PART = 0.8  # of the share that agrees


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """The best explanation, and what it rests on.

    Attributes
    ----------
    rays, measured : all points, with their planes.
    answer : the best hypothesis, fitted to all points.
    compared : the same on the points that hypotheses were compared on.
    rivals : the others.
    near : those of them that are not beaten, and so near that they only make the answer less sure.
    slow : what slow errors that it took up add to the covariance of the answer's pose.
    covariance : (5, 5) of that pose, these and those near counted.
    lens : what the points say of the lenses.
    outside : (N,) points that the answer does not explain.
    other_part : those of them that share another pose.
    differing : the capture that is furthest from the others' pose, and by how many sigma; None of a single one.
    misread : what says that the captures are meant in another way, of which the rig would have moved less.
    inverted : what says that the rig's old pose is written the other way round, where that gives the same answer.
    loudest_px : noise across their epipolar lines that points may have about the answer.
    """

    rays: Rays
    measured: Measured
    answer: Posterior
    compared: Posterior
    rivals: tuple[Rival, ...]
    near: tuple[Rival, ...]
    slow: TakenUp
    covariance: FloatArray
    lens: LensEvidence
    outside: BoolArray
    other_part: Part | None
    differing: tuple[int, float] | None
    misread: Reason | None
    loudest_px: float
    inverted: PoseInverted | None = None

    @property
    def resolved_by(self) -> str:
        """What speaks for the answer, against the strongest rival."""
        others = [rival for rival in self.rivals if rival not in self.near]
        if not others:
            return "no other pose explains the points"
        rival = min(others, key=lambda one: one.margin)
        said = {"points": rival.points, "light": rival.light, "the old pose": rival.move}
        ranked = sorted((item for item in said.items() if item[1] >= 1), key=lambda item: -item[1])
        parts = ", ".join(f"{name} {nats:.0f}" for name, nats in ranked)
        return f"{ranked[0][0]} (log evidence against {rival.name}: {parts})" if ranked else "nothing"


def judge(rig: Rig, captures: Sequence[Correspondences], options: RecalibrateOptions) -> Judgement:
    """Compare every hypothesis, and fit the best to all points. DegenerateError where no pose is determined."""
    rng = np.random.default_rng(options.seed)
    scene, beliefs = scene_of(rig, captures, options, rng), Beliefs.of(rig, options)
    scene, found = explained(scene, beliefs, rng)
    best, rivals, lens = found.best, found.rivals, found.lens
    if lens.verdict == "changed" and options.lens == "refit" and lens.posterior is not None:
        fits = [lens.posterior, *lens.others]
        best, rivals = ranked(fits, scene.measured(), scene.few, scene.light, beliefs.old, found.asides, rng)
    answer = _of_all_points(scene, best, found.part, _prior_of_answer(scene, beliefs, best, lens))
    outside, part = _other_part(scene, answer, found.part, rng)
    nearer = move_if_exchanged(rig, captures, answer, beliefs.old, options)
    misread = None if nearer is None else DevicesExchanged(move_deg(answer.pose, beliefs.old), nearer)
    differing = differing_capture(answer.measured, scene.rays, answer)
    loudest = loudest_px(captures, options.max_noise_px) if scene.photographs else options.max_noise_px
    near, slow = tuple(near_rivals(answer, rivals, rig, options)), taken_up(answer)
    covariance = answer.covariance + slow.covariance + spread(answer, near)
    return Judgement(
        scene.rays, answer.measured, answer, best, rivals, near, slow, covariance, lens, outside, part, differing,
        misread, loudest,
    )  # fmt: skip


def _prior_of_answer(scene: Scene, beliefs: Beliefs, best: Posterior, lens: LensEvidence) -> Prior:
    """What is believed of the lenses once the points have told of them."""
    rig, options, prior = scene.rig, scene.options, beliefs.prior
    if lens.verdict == "changed" and options.lens == "refit" and lens.posterior is not None:
        return Prior(beliefs.wide, free=True)
    if lens.verdict == "checked" or not prior.free:
        prior = Prior(lens.prior, free=best.prior.free and not prior.free)
    together = scene.photographs if options.calibrated_together is None else options.calibrated_together
    if together and "lens_covariance" not in rig.evidence and not prior.free:
        distance = working_distance(best.fit, best.points, float(np.linalg.norm(rig.projector_from_camera.t)))
        follows = None if distance is None else pose_with_lenses(rig, distance, beliefs.tight)
        prior = replace(prior, kept=lens.kept, together=follows)
    return prior


def _of_all_points(scene: Scene, best: Posterior, part: Part | None, prior: Prior) -> Posterior:
    """The best hypothesis fitted to all points but those of other parts. Undecidable where too few agree with it."""
    whole, options = scene.measured_of_all(), scene.options
    answer = posterior_at(whole, best.parameters, prior)
    others = [*parts_apart(answer, part), *copies_that_pay(answer)]
    for other in others:
        whole = set_aside(whole, other)
    answer = posterior_at(whole, best.parameters, prior) if others else answer
    if np.count_nonzero(answer.fit.explained) < options.min_points:  # no more of them agree than chance brings together
        share, level = float(np.mean(answer.fit.explained)), answer.fit.epipolar_noise.level
        if share >= 1 - options.max_outliers:
            raise Undecidable(TooFewPoints(int(np.count_nonzero(answer.fit.explained)), options.min_points))
        raise Undecidable(PointsDisagree(share, 1 - options.max_outliers, level, options.max_noise_px))
    answer = settled(answer)
    if pulled_away(answer, best):
        start = posterior_at(whole, best.parameters, prior)
        answer = settled(apart_as_chosen(start, scene.rays, best, scene.few))
    return without_strays(answer)


def _other_part(
    scene: Scene, answer: Posterior, part: Part | None, rng: np.random.Generator
) -> tuple[BoolArray, Part | None]:
    """The points (N,) that the answer does not explain, and those of them that share another explanation."""
    outside = answer.unexplained
    others = [*parts_apart(answer, part), shifted_copy(answer, outside)]
    if scene.turned.any() and (mirror := other_part(answer, outside, rng)) is not None:
        others.append(replace(mirror, name=IN_A_MIRROR))
    both = agreeing_with_both(answer, others)
    named = [replace(other, rows=other.rows & ~both) for other in others if other is not None]
    named = [other for other in named if other.count]
    part = max(named, key=lambda one: one.count, default=None)
    if part is not None and part.name != IN_A_MIRROR:  # whatever else has an explanation of its own, is none of its
        part = replace(part, rows=np.any([one.rows for one in named if one.name != IN_A_MIRROR], axis=0))
    return outside & ~both, part


def objection(
    judgement: Judgement, sigma: PoseSigma | None, distance: float | None, options: RecalibrateOptions
) -> Reason | None:
    """Why the best explanation is still not to be trusted; None where nothing speaks against it. NaN refuses."""
    fit, lens = judgement.answer.fit, judgement.lens
    share = 1 - np.count_nonzero(judgement.outside) / len(judgement.outside)
    level = float(np.maximum(fit.epipolar_noise.level, fit.along_noise.level))
    if judgement.misread is not None:
        return judgement.misread
    if lens.verdict == "changed" and options.lens != "refit":
        device, what = divmod(lens.clearest, LENS_PARAMETERS)
        amount = float(lens.change[lens.clearest])
        return LensChanged(
            ("camera", "projector")[device],
            LENS_NAMES[what],
            float(np.expm1(amount)) if what == 0 else amount,
            float(lens.sigma[lens.clearest]),
            lens.gain,
        )
    if not (share >= 1 - options.max_outliers and level <= options.max_noise_px):
        return PointsDisagree(share, 1 - options.max_outliers, level, options.max_noise_px)
    across = fit.epipolar_noise.level
    if not across <= judgement.loudest_px:  # lenses that err as their calibration says make right points as loud
        across = judgement.answer.through_free_lenses.fit.epipolar_noise.level
    if not across <= judgement.loudest_px:  # beside planes that are none, points may be as loud
        return PointsDisagree(share, 1 - options.max_outliers, across, judgement.loudest_px)
    if judgement.differing is not None and not judgement.differing[1] <= MOST_DEVIATIONS:
        return CapturesDiffer(judgement.differing[0] + 1, judgement.differing[1])
    part = judgement.other_part
    other = 0.0 if part is None or part.name == IN_A_MIRROR else part.count / len(judgement.outside)
    if not other <= LARGEST_OTHER_PART * share:  # what a mirror shows is of no direct pose
        return PartsContradict(share, other)
    far = [rival for rival in judgement.rivals if rival not in judgement.near]
    rival = min(far, key=lambda one: one.margin, default=None)
    if rival is not None and not rival.margin >= options.min_margin:
        if judgement.inverted is not None:
            return judgement.inverted
        pose, other = judgement.answer.pose, rival.posterior.pose
        apart = np.degrees([rotation_angle(pose.R @ other.R.T), direction_angle(pose.t, other.t)])
        return RivalUnbeaten(rival.name, rival.margin, *apart.tolist())
    if sigma is None or distance is None or sigma.displacement is None:
        return PoseUndetermined("pose: the points have no depth; show more of the scene")
    if np.isnan(sigma.displacement):
        return PoseUndetermined("pose: seen from it, the pictures share no points at the working distance; show more")
    error = sigma.displacement / distance
    if not error <= options.max_error:
        allowed = allowed_error(judgement.measured.rig, judgement.answer.pose, distance, options)
        if not error <= allowed:
            return Imprecise(sigma.rotation_deg, sigma.translation_deg, error, allowed)
    return None
