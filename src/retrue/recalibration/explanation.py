"""The explanation that beats all others, and the planes that are left when they have been doubted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from retrue.geometry.arrays import BoolArray
from retrue.geometry.two_view import TwoViewPose
from retrue.recalibration.bent_planes import bent_planes
from retrue.recalibration.consensus import quieter_majorities
from retrue.recalibration.costs import copies_that_pay
from retrue.recalibration.curved_surfaces import curved_of, curved_rival, surfaces_of
from retrue.recalibration.doubtful_planes import (
    better_without_planes,
    curved_planes,
    misleading_plane,
    much_quieter,
    needless_planes,
    quieter,
)
from retrue.recalibration.fit import own_pose
from retrue.recalibration.hypotheses import hypotheses_of, without_parts
from retrue.recalibration.lens import LensPrior, stated_prior, wide_prior
from retrue.recalibration.lens_evidence import BEATS, LensEvidence, held_instead, hidden_by_planes, lens_evidence
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.parameters import Parameters, Prior
from retrue.recalibration.parts import Part, belongs_to, most_unexplained, other_parts
from retrue.recalibration.posterior import Posterior, same_answer
from retrue.recalibration.rivals import Rival, ranked, rivals_of
from retrue.recalibration.scene import Scene
from retrue.rig import Rig

MOST_UNBEATEN = 2  # rivals from which free lenses begin, too


@dataclass(frozen=True, slots=True, eq=False)
class Beliefs:
    """What is believed before a capture is seen.

    Attributes
    ----------
    old : the pose where the rig was.
    tight, wide : of lenses as they were calibrated, and of such as may have changed.
    prior : of those two, the one that was asked for.
    """

    old: TwoViewPose
    tight: LensPrior
    wide: LensPrior
    prior: Prior

    @classmethod
    def of(cls, rig: Rig, options: RecalibrateOptions) -> Beliefs:
        """Those of a rig."""
        tight = stated_prior(rig, options.focal_sigma, options.principal_point_sigma_px, options.k1_sigma)
        wide = wide_prior(rig, tight)
        prior = Prior(wide, free=True) if options.lens == "may-have-changed" else Prior(tight)
        return cls(own_pose(rig), tight, wide, prior)


@dataclass(frozen=True, slots=True, eq=False)
class Explanation:
    """The best hypothesis, and what it beats.

    Attributes
    ----------
    best, rivals : itself, and the others.
    posteriors : all that were compared, without those that leave parts out; places to start from again.
    asides, part : parts of the points that share another pose, and the largest that the best leaves unexplained.
    lens : what the points say of the lenses.
    """

    best: Posterior
    rivals: tuple[Rival, ...]
    posteriors: list[Posterior]
    asides: list[Part]
    part: Part | None
    lens: LensEvidence


@dataclass(frozen=True, slots=True, eq=False)
class Again:
    """A scene with curved planes, or without those that are `gone`, and where to start in it."""

    scene: Scene
    starts: list[Parameters]
    gone: BoolArray


def explained(scene: Scene, beliefs: Beliefs, rng: np.random.Generator) -> tuple[Scene, Explanation]:
    """Compare all hypotheses, and doubt the planes that the best rests on, until nothing is left to doubt.

    Raises DegenerateError where no pose is determined.
    """
    starts = scene.starts(beliefs.old, rng)
    searched: list[Parameters] = []
    changed: list[Parameters] = []
    while True:
        found = _compared(scene, beliefs, starts, searched, changed, rng)
        if found.lens.verdict == "changed" and not searched:
            # What was not found through the rig's own lenses is no proof that there is nothing.
            searched = scene.starts_of_no_plane(rng)
            if searched:
                changed = [] if found.lens.posterior is None else [found.lens.posterior.parameters]
                starts = [*(fit.parameters for fit in found.posteriors), *searched]
                continue
        again = _doubted(scene, beliefs, found, rng)
        if isinstance(again, Explanation):
            return scene, again
        scene, starts = again.scene, again.starts
        searched, changed = ([start.without_planes(again.gone) for start in some] for some in (searched, changed))


def _compared(
    scene: Scene,
    beliefs: Beliefs,
    starts: Sequence[Parameters],
    searched: Sequence[Parameters],
    changed: Sequence[Parameters],
    rng: np.random.Generator,
) -> Explanation:
    """Each hypothesis with all points and without parts, and what points say of the lenses from the best."""
    measured, few, old, light, homographies = scene.measured(), scene.few, beliefs.old, scene.light, scene.homographies
    prior, tight, wide = beliefs.prior, beliefs.tight, beliefs.wide
    hypotheses = hypotheses_of(measured, starts, prior, tight, homographies)
    posteriors = [one.better() for one in hypotheses]
    noises = scene.noise, scene.local
    majorities = quieter_majorities(measured, posteriors, *noises, prior, tight, homographies, rng)
    posteriors += [one.better() for one in majorities]
    hypotheses += majorities
    best, rivals = ranked(posteriors, measured, few, light, old, (), rng)
    asked = [best, *(one.fixed for one in hypotheses if one.moved is best)]
    asked += [*(one.better() for one in majorities), *(rival.posterior for rival in rivals)]
    asides = other_parts(asked, rng)
    alone = len(scene.captures) == 1
    hypotheses += without_parts(hypotheses, best, asides, homographies, tight, alone=alone)
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
    unbeaten = [rival.posterior for rival in rivals[:MOST_UNBEATEN] if 2 * rival.margin < BEATS]
    lens = lens_evidence(measured, homographies, best, unbeaten, part, tight, wide, old, searched, changed)
    if (held := held_instead(lens, compared, asides)) is not None:
        lens = replace(lens, verdict="unchecked")
        if held is not best:
            best, rivals = held, rivals_of(held, compared, measured, few, light, old, asides, rng)
    return Explanation(best, rivals, posteriors, asides, part, lens)


def _doubted(scene: Scene, beliefs: Beliefs, found: Explanation, rng: np.random.Generator) -> Again | Explanation:
    """The scene without planes that are none, or with them as curved surfaces; the explanation where all planes hold.

    Through another lens planes look curved, but curved scenes do not ask for one.
    """
    best, lens, changed = found.best, found.lens, found.lens.verdict == "changed"
    undecided = [best, *(rival.posterior for rival in found.rivals if rival.margin < 0)]  # each beats another in turn
    gone = np.all([curved_planes(fit) for fit in undecided], axis=0)
    if not (scene.photographs or changed) and (curved := surfaces_of(best, gone & ~scene.curved)).any():
        return _curved(scene, found, curved)
    if not gone.any():
        gone = misleading_plane(best, lens.kept)
    if scene.photographs and not gone.any():
        gone = bent_planes(best)
    bent = None
    if not (scene.photographs or gone.any() or scene.curved.any()):
        bent = curved_rival(best, beliefs.old)
    if scene.photographs and not gone.any() and not copies_that_pay(best):
        gone = needless_planes(best, lens.kept)  # without its plane, a copy would be another surface
    free = [] if gone.any() and not changed else better_without_planes(best, scene.noise, rng)
    if changed:
        free = [fit for fit in free if lens.posterior is not None and quieter(fit, lens.posterior)]
        gone[:] = False
    else:
        known = [fit for fit in free if any(same_answer(other, fit.pose) for other in found.posteriors)]
        free = [fit for fit in free if fit not in known or much_quieter(fit, best)]
    certain = changed or scene.photographs or gone.any() or free
    hidden = not certain and hidden_by_planes(best, found.part, beliefs.tight, beliefs.wide, beliefs.old)
    gone |= bool(free) or hidden
    if not gone.any() and bent is not None and not bent.margin >= 0 and not changed:
        gone = curved_planes(bent.posterior)
        if not gone.any():
            return _curved(scene, found, curved_of(bent))
    if not gone.any():
        rivals = found.rivals if bent is None or changed else (*found.rivals, bent)
        return replace(found, rivals=rivals)
    scene = scene.without_planes(gone)
    starts = [fit.parameters.without_planes(gone) for fit in found.posteriors]
    starts += [Parameters.of(fit.pose) for fit in free]
    # Those poses were of planes that are none, and what is curved often leaves two that differ by little.
    return Again(scene, starts + scene.starts(beliefs.old, rng), gone)


def _curved(scene: Scene, found: Explanation, planes: BoolArray) -> Again:
    """The same places where those planes (P,), which were flat, may be curved."""
    starts = [fit.parameters.as_curved(planes) for fit in found.posteriors]
    return Again(replace(scene, curved=scene.curved | planes), starts, np.zeros_like(planes))
