"""Which pose, why that one, and how sure: the best of all hypotheses, and by how much it beats each of the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from retrue.correspondences import Correspondences
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.transform import direction_angle, rotation_angle
from retrue.recalibration.all_points import apart_as_chosen, pulled_away, settled, without_strays
from retrue.recalibration.bent_planes import bent_planes
from retrue.recalibration.bows import bow_shapes
from retrue.recalibration.candidates import (
    check_spread,
    foremost,
    match_noise,
    poses_of_no_plane,
    refined_poses,
    starting_poses,
    with_planes,
)
from retrue.recalibration.consensus import quieter_majorities
from retrue.recalibration.contradiction import MOST_DEVIATIONS, differing_capture
from retrue.recalibration.copies import shifted_copy
from retrue.recalibration.costs import has_copies
from retrue.recalibration.curved_surfaces import curved_of, curved_rival, surfaces_of
from retrue.recalibration.doubtful_planes import (
    better_without_planes,
    curved_planes,
    misleading_plane,
    much_quieter,
    needless_planes,
    planes_between,
    quieter,
)
from retrue.recalibration.fit import Support, own_pose
from retrue.recalibration.hypotheses import hypotheses_of, without_parts
from retrue.recalibration.lens import LENS_NAMES, LENS_PARAMETERS, stated_prior, wide_prior
from retrue.recalibration.lens_evidence import LensEvidence, held_instead, hidden_by_planes, lens_evidence
from retrue.recalibration.measured import MISFIT_PX
from retrue.recalibration.near_rivals import allowed_error, near_rivals, spread
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.parameters import Parameters, Prior
from retrue.recalibration.parts import (
    FEWEST_OF_A_PART,
    IN_A_MIRROR,
    Part,
    agreeing_with_both,
    belongs_to,
    homography_residuals,
    most_unexplained,
    noise_of_planes,
    other_part,
    other_parts,
    parts_apart,
    plane_levels,
    set_aside,
    unexplained,
)
from retrue.recalibration.posterior import Measured, Posterior, posterior_at
from retrue.recalibration.rays import Rays, loudest_px, rays_of_captures
from retrue.recalibration.reasons import (
    CapturesDiffer,
    DevicesExchanged,
    Imprecise,
    LensChanged,
    PartsContradict,
    PointsDisagree,
    PoseUndetermined,
    Reason,
    RivalUnbeaten,
    TooFewPoints,
    Undecidable,
)
from retrue.recalibration.result import PoseSigma, working_distance
from retrue.recalibration.rivals import Rival, light_of, move_deg, nearest_points, ranked, rivals_of, same_answer
from retrue.recalibration.slow_errors import TakenUp, taken_up
from retrue.recalibration.swapped import move_if_exchanged
from retrue.recalibration.together import pose_with_lenses
from retrue.recalibration.turned import turned_over
from retrue.recalibration.uneven_noise import noise_shape
from retrue.rig import Rig

COMPARED_POINTS = 1500  # enough to tell hypotheses apart; the best is then fitted to all
LEAST_LEFT = 0.05  # of the points, as many as a plane holds at least
LEAST_TURNED = 0.03  # of the points; wrong matches turn a few over, too
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
    exchanged : how far the rig moved, and would have if its devices were exchanged; None where that is no nearer.
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
    exchanged: tuple[float, float] | None
    loudest_px: float

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
    """Refine every hypothesis on all points, and compare. DegenerateError where no pose is determined."""
    rng = np.random.default_rng(options.seed)
    rays = rays_of_captures(rig, captures, options.max_points, rng)
    check_spread(rays, options)
    few = rays.thinned(COMPARED_POINTS, rng)
    (noise, local), neighbours = match_noise(few.points, rng), nearest_points(few)
    turned = np.zeros(len(rays), dtype=np.bool_)
    if np.count_nonzero(turned_over(few.points, neighbours, noise)) > max(FEWEST_OF_A_PART, LEAST_TURNED * len(few)):
        turned = turned_over(rays.points, nearest_points(rays), noise)
    rays, homographies = with_planes(rays, rig, options, rng, turned)
    few = rays.select(~turned).thinned(COMPARED_POINTS, rng)
    neighbours, old = nearest_points(few), own_pose(rig)
    photographs = all(capture.card is not None and capture.card.counted == "features" for capture in captures)
    if not photographs:
        between = planes_between(few.points.plane_index, neighbours, len(homographies))
        rays, few, homographies = _without_planes(between, rays, few, homographies)
    uneven = noise_shape(few.points, homographies, neighbours)
    uneven_of_all = None if uneven is None else uneven.of(rays.points, homographies)
    fits = refined_poses(starting_poses(few.points, homographies, old, noise, rng), Support.of(few), rng)
    tight = stated_prior(rig, options.focal_sigma, options.principal_point_sigma_px, options.k1_sigma)
    wide = wide_prior(rig, tight)
    prior = Prior(wide, free=True) if options.lens == "may-have-changed" else Prior(tight)
    starts = [Parameters.of(fit.pose) for fit in foremost(fits, few.points)]
    light, bowed = light_of(rig, captures, few), np.zeros(len(homographies), dtype=np.bool_)
    searched: list[Parameters] = []
    while True:
        measured = _measured(rig, captures, few, homographies, neighbours, options.flatness_sigma, photographs)
        lone = None  # small things of photographs show one match each, and no surface has a second of them
        if not photographs:
            lone = noise_of_planes(few.points, homographies, neighbours, plane_levels(measured))
        measured = replace(measured, curved=bowed, noise_shape=uneven, lone=lone)
        hypotheses = hypotheses_of(measured, starts, prior, tight, homographies)
        posteriors = [one.better() for one in hypotheses]
        majorities = quieter_majorities(measured, posteriors, noise, local, prior, tight, homographies, rng)
        posteriors += [one.better() for one in majorities]
        hypotheses += majorities
        best, rivals = ranked(posteriors, measured, few, light, old, (), rng)
        asked = [best, *(one.fixed for one in hypotheses if one.moved is best)]
        asked += [*(one.better() for one in majorities), *(rival.posterior for rival in rivals)]
        asides = other_parts(asked, rng)
        hypotheses += without_parts(hypotheses, best, asides, homographies, tight, alone=len(captures) == 1)
        compared = posteriors
        if asides or len(hypotheses) > len(posteriors):
            compared = [one.better(asides) for one in hypotheses]
            posteriors = compared[: len(posteriors)]
            best, rivals = ranked(compared, measured, few, light, old, asides, rng)
            unasked = [fit for fit in (best, *(rival.posterior for rival in rivals[:1])) if fit not in asked]
            if more := [part for part in other_parts(unasked, rng) if not belongs_to(best, part)]:
                asides += more
                best, rivals = ranked(compared, measured, few, light, old, asides, rng)
        part = most_unexplained(asides, best)
        lens = lens_evidence(measured, homographies, best, part, tight, wide, old, searched)
        if lens.verdict == "changed" and not searched:  # what was not found through the rig's own lenses, is no proof
            poses = poses_of_no_plane(measured.support, homographies, (noise, local), rng)
            searched = [Parameters.of(pose) for pose in poses]
            if searched:
                starts = [*(fit.parameters for fit in posteriors), *searched]
                continue
        if (held := held_instead(lens, compared, asides)) is not None:
            lens = replace(lens, verdict="unchecked")
            if held is not best:
                best, rivals = held, rivals_of(held, compared, measured, few, light, old, asides, rng)
        undecided = [best, *(rival.posterior for rival in rivals if rival.margin < 0)]  # each beats another in turn
        curved = np.all([curved_planes(fit) for fit in undecided], axis=0)
        more = curved & ~bowed
        if not photographs and lens.verdict != "changed" and (more := surfaces_of(best, more)).any():
            bowed = bowed | more
            starts = [fit.parameters.as_curved(more) for fit in posteriors]
            continue
        if not curved.any():
            curved = misleading_plane(best, lens.kept)
        if photographs and not curved.any():
            curved = bent_planes(best)
        bent = None if photographs or curved.any() or bowed.any() else curved_rival(best, old)
        if photographs and not curved.any() and not has_copies(best):
            curved = needless_planes(best, lens.kept)  # without its plane, a copy would be another surface
        changed = lens.verdict == "changed"  # through another lens planes look curved
        free = [] if curved.any() and not changed else better_without_planes(best, noise, rng)
        if changed:  # but curved scenes do not ask for it
            free = [fit for fit in free if lens.posterior is not None and quieter(fit, lens.posterior)]
            curved[:] = False
        else:
            known = [fit for fit in free if any(same_answer(other, fit.pose) for other in posteriors)]
            free = [fit for fit in free if fit not in known or much_quieter(fit, best)]
        certain = changed or photographs or curved.any() or free
        curved |= bool(free) or (not certain and hidden_by_planes(best, part, tight, wide, old))
        if not curved.any() and bent is not None and not bent.margin >= 0 and not changed:
            curved = curved_planes(bent.posterior)
            if not curved.any():
                bowed = curved_of(bent)
                starts = [fit.parameters.as_curved(bowed) for fit in posteriors]
                continue
        if not curved.any():
            break
        rays, few, homographies = _without_planes(curved, rays, few, homographies)
        bowed, searched = bowed[~curved], [start.without_planes(curved) for start in searched]
        starts = [fit.parameters.without_planes(curved) for fit in posteriors]
        starts += [Parameters.of(fit.pose) for fit in free]
        # Those poses were of planes that are none, and what is curved often leaves two that differ by little.
        fits = refined_poses(starting_poses(few.points, homographies, old, noise, rng), Support.of(few), rng)
        starts += [Parameters.of(fit.pose) for fit in foremost(fits, few.points)]
    if bent is not None and lens.verdict != "changed":
        rivals = (*rivals, bent)
    start = best.parameters
    if lens.verdict == "changed" and options.lens == "refit" and lens.posterior is not None:
        best, rivals = ranked([lens.posterior, *lens.others], measured, few, light, old, asides, rng)
        start, prior = best.parameters, Prior(wide, free=True)
    elif lens.verdict == "checked" or not prior.free:
        prior = Prior(lens.prior, free=best.prior.free and not prior.free)
    together = photographs if options.calibrated_together is None else options.calibrated_together
    if together and "lens_covariance" not in rig.evidence and not prior.free:
        distance = working_distance(best.fit, best.points, float(np.linalg.norm(rig.projector_from_camera.t)))
        follows = None if distance is None else pose_with_lenses(rig, distance, tight)
        prior = replace(prior, kept=lens.kept, together=follows)
    nobody = np.empty((len(rays), 0), dtype=np.int64)
    whole = _measured(rig, captures, rays, homographies, nobody, options.flatness_sigma, photographs)
    misfit = MISFIT_PX if photographs else 0.0  # of a projector's points, a slow error holds it
    whole = replace(
        whole, aside=turned if turned.any() else None, curved=bowed, misfit=misfit, noise_shape=uneven_of_all
    )
    answer = posterior_at(whole, start, prior)
    others = parts_apart(answer, part, whole.homography_residuals)
    for other in others:
        whole = set_aside(whole, other)
    answer = posterior_at(whole, start, prior) if others else answer
    if np.count_nonzero(answer.fit.explained) < options.min_points:  # no more of them agree than chance brings together
        share, level = float(np.mean(answer.fit.explained)), answer.fit.epipolar_noise.level
        if share >= 1 - options.max_outliers:
            raise Undecidable(TooFewPoints(int(np.count_nonzero(answer.fit.explained)), options.min_points))
        raise Undecidable(PointsDisagree(share, 1 - options.max_outliers, level, options.max_noise_px))
    answer = settled(answer)
    if pulled_away(answer, best):
        answer = settled(apart_as_chosen(posterior_at(whole, start, prior), rays, best, few))
    answer = without_strays(answer)
    whole, outside = answer.measured, unexplained(answer)
    others = [*parts_apart(answer, part, whole.homography_residuals), shifted_copy(answer, outside)]
    if turned.any() and (mirror := other_part(answer, outside, rng)) is not None:
        others.append(replace(mirror, name=IN_A_MIRROR))
    both = agreeing_with_both(answer, others)
    outside = outside & ~both
    named = [replace(other, rows=other.rows & ~both) for other in others if other is not None]
    named = [other for other in named if other.count]
    part = max(named, key=lambda one: one.count, default=None)
    if part is not None and part.name != IN_A_MIRROR:  # whatever else has an explanation of its own, is none of its
        part = replace(part, rows=np.any([one.rows for one in named if one.name != IN_A_MIRROR], axis=0))
    nearer = move_if_exchanged(rig, captures, answer, old, options)
    exchanged = None if nearer is None else (move_deg(answer.pose, old), nearer)
    differing = differing_capture(whole, rays, answer)
    loudest = loudest_px(captures, options.max_noise_px) if photographs else options.max_noise_px
    near = tuple(near_rivals(answer, rivals, rig, options))
    slow = taken_up(answer)
    covariance = answer.covariance + slow.covariance + spread(answer, near)
    return Judgement(
        rays, whole, answer, best, rivals, near, slow, covariance, lens, outside, part, differing, exchanged, loudest
    )


def objection(
    judgement: Judgement, sigma: PoseSigma | None, distance: float | None, options: RecalibrateOptions
) -> Reason | None:
    """Why the best explanation is still not to be trusted; None where nothing speaks against it. NaN refuses."""
    fit, lens = judgement.answer.fit, judgement.lens
    share = 1 - np.count_nonzero(judgement.outside) / len(judgement.outside)
    level = float(np.maximum(fit.epipolar_noise.level, fit.along_noise.level))
    if judgement.exchanged is not None:
        return DevicesExchanged(*judgement.exchanged)
    if lens.verdict == "changed" and options.lens != "refit":
        clearest = int(np.argmax(np.abs(lens.change) / lens.sigma))
        device, what = divmod(clearest, LENS_PARAMETERS)
        amount = float(lens.change[clearest])
        return LensChanged(
            ("camera", "projector")[device],
            LENS_NAMES[what],
            float(np.expm1(amount)) if what == 0 else amount,
            float(lens.sigma[clearest]),
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


def _measured(
    rig: Rig,
    captures: Sequence[Correspondences],
    rays: Rays,
    homographies: list[FloatArray],
    neighbours: IntArray,
    flatness: float,
    textured: bool,
) -> Measured:
    rows = [rays.row[rays.capture == index] for index in range(len(captures))]  # one capture after the other
    each = list(zip(captures, rows, strict=True))
    camera_px = np.concatenate([np.take(capture.camera_px, mine, axis=0) for capture, mine in each])
    projector_px = np.concatenate([np.take(capture.projector_px, mine, axis=0) for capture, mine in each])
    missed = homography_residuals(rays.points, homographies)
    shapes = bow_shapes(rays.points)
    return Measured(
        rig,
        camera_px,
        projector_px,
        Support.of(rays),
        shapes,
        flatness,
        neighbours,
        homography_residuals=missed,
        textured=textured,
    )


def _without_planes(
    gone: BoolArray, rays: Rays, few: Rays, homographies: list[FloatArray]
) -> tuple[Rays, Rays, list[FloatArray]]:
    left = [H for H, none in zip(homographies, gone, strict=True) if not none]
    return rays.without_planes(gone), few.without_planes(gone), left
