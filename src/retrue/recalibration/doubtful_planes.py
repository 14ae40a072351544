"""Planes that are none: curved or loose, or such as points by themselves contradict, or do not need."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from retrue.errors import DegenerateError
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.robust import CUTOFF, MAD_TO_SIGMA, quantile
from retrue.geometry.two_view import FREE, epipolar_residuals
from retrue.recalibration.candidates import FEWEST_FREE, MOST, of_five_points
from retrue.recalibration.fit import carried, refine, squared_sigmas
from retrue.recalibration.measured import MISFIT_PX
from retrue.recalibration.parameters import Parameters, Prior
from retrue.recalibration.parts import A_COPY, plane_around
from retrue.recalibration.posterior import Posterior, fit_posterior, improved, posterior_at
from retrue.recalibration.result import sigma_at, working_distance

MOST_BOW = 3.5  # of the usual bow of a wall
MOST_SCATTER, SCATTER_PX = 4.0, 1.0  # along the epipolar line, of the noise across it, and at least
FEWEST_ELSEWHERE = 12  # points off a plane, below which it is all that tells the pose
MISLED = 20.5  # of chi-square with five degrees of freedom: once in a thousand by chance
MUCH_LOUDER = 2.0
CLOSE = 2e-3  # of the distance: a drift so small is called improvable
WORTH_A_PLANE = 1.2  # of the variance of the pose in some direction, without planes: a tenth of sigma


def curved_planes(posterior: Posterior) -> BoolArray:
    """(P,) planes that the points do not believe: bowed by more than walls are, or scattered about themselves."""
    fit, plane = posterior.fit, posterior.points.plane_index
    gone = np.abs(posterior.parameters.bows).max(axis=1, initial=0.0) > MOST_BOW
    across = fit.epipolar_noise.total
    for index in np.flatnonzero(~gone):
        along = np.abs(fit.found.along[(plane == index) & (fit.robust_weights[0] > 0)])
        gone[index] = len(along) > 0 and MAD_TO_SIGMA * quantile(along, 0.5) > max(MOST_SCATTER * across, SCATTER_PX)
    return gone


def planes_between(plane: IntArray, neighbours: IntArray, planes: int) -> BoolArray:
    """(P,) planes most of whose points lie between points of another one, each by itself.

    Surfaces are opaque: these are the other's noise, copies of it, or things as small as a point. `plane` (N,) is that
    of each point, `neighbours` (N, 4) the nearest; of the `planes`, some may have none of the points.
    """
    if not neighbours.size:
        return np.zeros(planes, dtype=np.bool_)
    around = plane_around(plane, neighbours)
    between = (around != FREE) & (around != plane) & (plane != FREE)
    counts = np.bincount(plane[plane != FREE], minlength=planes)
    return 2 * np.bincount(plane[between], minlength=planes) > counts


def misleading_plane(posterior: Posterior, lenses: FloatArray) -> BoolArray:
    """(P,) the plane, at most one, without which all points together tell another pose: it was none.

    A plane adds to what points tell of the pose without it. Where both answers differ by more than what the points
    alone leave open (Hausman 1978), it is the plane that is not true. Both were seen through the same lenses, whose
    errors, of second moment `lenses` (8, 8), tell them apart only as far as the two poses follow them differently.
    """
    pose, plane = posterior.pose, posterior.points.plane_index
    deviations = np.zeros(len(pose.planes))
    for index in range(len(pose.planes)):
        gone = np.arange(len(pose.planes)) == index
        if np.count_nonzero((plane != index) & posterior.fit.explained) < FEWEST_ELSEWHERE:
            continue
        try:
            measured = posterior.measured.without_planes(gone)
            alone = fit_posterior(measured, posterior.parameters.without_planes(gone), posterior.prior, 6)
            deviations[index] = squared_sigmas(pose, alone.pose, _of_difference(posterior, alone, lenses))
        except DegenerateError:
            continue
    return (deviations > MISLED) & (deviations == deviations.max(initial=0.0))


def needless_planes(posterior: Posterior, lenses: FloatArray) -> BoolArray:
    """(P,) all planes or none: those that tell nothing of the pose, or not the truth, which no single one shows.

    Of photographs, whose sheets, hedges and sidings pass for planes. Such a plane bends the pose, and nothing is gained
    by it where points alone know the pose as well in every direction, or so well that it matters no more. Where points
    alone tell another pose, but leave more across their epipolar lines than with the planes, it is not planes that
    mislead: a part of the scene has moved.
    """
    nothing = np.zeros(len(posterior.pose.planes), dtype=np.bool_)
    explained = int(np.count_nonzero(posterior.fit.explained))
    if not len(nothing) or explained < FEWEST_FREE or explained < MOST * len(posterior.points):
        return nothing  # what few points share, planes may hold together
    try:
        measured = posterior.measured.without_planes(~nothing)
        alone = fit_posterior(measured, posterior.parameters.without_planes(~nothing), posterior.prior, 6)
        worth = max(
            _largest_ratio(alone.covariance, posterior.covariance),
            _largest_ratio(alone.statistical_covariance, posterior.statistical_covariance),
        )
    except (DegenerateError, np.linalg.LinAlgError):
        return nothing
    pose, rig = posterior.pose, measured.rig
    if squared_sigmas(pose, alone.pose, _of_difference(posterior, alone, lenses)) > MISLED:
        return nothing | (alone.losses[0].sum() < posterior.losses[0].sum())
    distance = working_distance(alone.fit, alone.points, float(np.linalg.norm(rig.projector_from_camera.t)))
    off = sigma_at(distance, alone.statistical_covariance, alone.pose, rig).displacement
    close = distance is not None and off is not None and off < CLOSE * distance
    return nothing | (worth < WORTH_A_PLANE) | close


def _largest_ratio(covariance: FloatArray, other: FloatArray) -> float:
    """Of the variances of both, in whichever direction."""
    root = np.linalg.cholesky(other)
    return float(np.linalg.eigvalsh(np.linalg.solve(root, np.linalg.solve(root, covariance).T))[-1])


def _of_difference(posterior: Posterior, alone: Posterior, lenses: FloatArray) -> FloatArray:
    """(5, 5) covariance of the difference between a pose and that of a part of its points, in the frame of that."""
    if posterior.prior.free:
        return alone.covariance
    apart = alone.follows - carried(posterior.pose, alone.pose) @ posterior.follows
    return alone.statistical_covariance + apart @ lenses @ apart.T


def better_without_planes(posterior: Posterior, noise: float, rng: np.random.Generator) -> list[Posterior]:
    """Poses that the points tell if none is on a plane, where that contradicts the planes; else none.

    A ball, a pipe or a hill passes for a few bowed planes, from a pose far off. It is the test of `misleading_plane`
    for all planes together: what a real lens leaves over, which a pose without planes is free to follow, is noise. A
    curled sheet passes for a plane from a pose that fits the sheet alone, while more points have one without it.

    What is curved leaves an error that neighbours share. Of planes that leave none, noise by itself makes the pose of
    one or of its twin quieter across the lines, and louder along them, where without planes nothing is asked of it.
    """
    if not len(posterior.pose.planes):
        return []
    shares = any(noise.shared > 0 for noise in posterior.fit.noises)
    posterior = posterior.eased
    pose, points = posterior.pose, posterior.points
    none = np.ones(len(pose.planes), dtype=np.bool_)
    measured = replace(posterior.measured.without_planes(none), misfit=MISFIT_PX)
    starts = [replace(pose, planes=np.empty((0, 3)))]
    starts += of_five_points(measured.support.points, np.arange(len(points)), [], noise, rng)

    def better(alone: Posterior) -> bool:
        quiet = quieter if shares else much_quieter
        return quiet(alone, posterior) or _explains_more(alone, posterior)

    found: list[Posterior] = []
    for start in starts:
        try:
            near = refine(start, measured.support, iterations=4)
            alone = posterior_at(measured, Parameters.of(near.pose), Prior(posterior.prior.lens))
            if not better(alone):
                continue
            alone = improved(alone, 10)
            deviations = squared_sigmas(pose, alone.pose, alone.covariance)
        except DegenerateError:
            continue
        if (deviations > MISLED or much_quieter(alone, posterior)) and better(alone):
            found.append(alone)
    return found


def _explains_more(alone: Posterior, posterior: Posterior) -> bool:
    """Whether more points share the pose without planes, most of them, hardly louder.

    Copies of planes have another: of codes, where the plane has them in both axes.
    """
    level = posterior.fit.epipolar_noise.level
    near = np.abs(epipolar_residuals(posterior.pose, posterior.points)) < CUTOFF * level
    aside = posterior.measured.aside
    copies = [part for part in posterior.parts if part.name == A_COPY and part.missed.shape[1] == 2]
    copied = [part.rows for part in copies if part.seldom < 1]  # of what is there
    explained = int(np.count_nonzero(np.any([near if aside is None else near & ~aside, *copied], axis=0)))
    enough = max(explained + FEWEST_ELSEWHERE, MOST * len(near))
    return int(np.count_nonzero(alone.fit.explained)) >= enough and alone.fit.epipolar_noise.level < MUCH_LOUDER * level


def quieter(alone: Posterior, posterior: Posterior) -> bool:
    """Whether noise across the epipolar lines is less by more than a pose makes it that is free to follow errors.

    What the other asks of lenses and planes to be as quiet as it is, counts with it.
    """
    noise, explained = alone.fit.epipolar_noise, alone.fit.explained
    worth = float((noise.level**2 / noise.variance[explained]).sum())
    gained = 2 * worth * float(np.log(posterior.fit.even_levels[0] / alone.fit.even_levels[0]))
    return gained + posterior.prior_cost - alone.prior_cost > MISLED


def much_quieter(alone: Posterior, posterior: Posterior) -> bool:
    """Whether the other's noise is so loud that no real lens or wall makes it."""
    return alone.fit.even_levels[0] * MUCH_LOUDER < posterior.fit.even_levels[0]
