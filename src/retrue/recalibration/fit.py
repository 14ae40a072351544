"""Fit one pose to all points of all captures, robustly, with noise that is measured, not assumed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from retrue.errors import DegenerateError
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.robust import (
    COVARIANCE_FACTOR,
    Noise,
    biweight,
    biweight_level,
    biweight_loss,
    biweights,
    grid_blocks,
    median_level,
    reweighted_level,
    with_shared_part,
)
from retrue.geometry.two_view import (
    FREE,
    NO_BOWS,
    POSE_PARAMETERS,
    PlaneBows,
    Residuals,
    TwoViewPoints,
    TwoViewPose,
    normal_equations,
    pose_covariance,
    residuals,
)
from retrue.recalibration.rays import Rays

BLOCKS = 6  # per side: a slow error is common to 1/36 of the picture, or of a plane
FEWEST_OF_A_FAMILY = 20  # residuals that tell its level


@dataclass(frozen=True, slots=True, eq=False)
class Support:
    """The points that a pose is fitted to, and whom each shares a slow error with.

    Attributes
    ----------
    points : of all captures; `plane_index` runs over the planes of all.
    blocks : (2, N) block of its picture, one of 6 x 6, and of its plane, that each point lies in; -1 on no plane.
    """

    points: TwoViewPoints
    blocks: IntArray

    @classmethod
    def of(cls, rays: Rays) -> Support:
        """Number the blocks over the points of each capture, and over those of each plane."""
        x, plane = rays.points.camera_rays, rays.points.plane_index
        return cls(rays.points, np.stack([grid_blocks(x, rays.capture, BLOCKS), grid_blocks(x, plane, BLOCKS)]))


@dataclass(frozen=True, eq=False)
class PoseFit:
    """A pose, and what it rests on there.

    Attributes
    ----------
    pose : R, unit t, planes.
    points : that it was evaluated on.
    found : residuals at the pose.
    epipolar_noise, along_noise : levels of both families.
    robust_weights : (2, N) of both, 0 .. 1.
    """

    pose: TwoViewPose
    points: TwoViewPoints
    found: Residuals
    epipolar_noise: Noise
    along_noise: Noise
    robust_weights: FloatArray

    @cached_property
    def covariance(self) -> FloatArray:
        """(5, 5) of the pose, see `pose_covariance`."""
        return pose_covariance(self._normal_equations[0]) * COVARIANCE_FACTOR

    @property
    def explained(self) -> BoolArray:
        """(N,) points that agree with the epipolar geometry of this pose."""
        return self.robust_weights[0] > 0

    @cached_property
    def weights(self) -> FloatArray:
        """(2, N) of the normal equations: robust weights over effective variances."""
        return self.robust_weights / np.stack([self.epipolar_noise.variance, self.along_noise.variance])

    def improved(self) -> TwoViewPose:
        """One Gauss-Newton step further."""
        information, gradient = self._normal_equations
        return self.pose.moved(solve_normal_equations(information, -gradient))

    @cached_property
    def _normal_equations(self) -> tuple[FloatArray, FloatArray]:
        information, cross, _ = normal_equations(self.pose, self.points, self.weights, self.found.both[None])
        return information, cross[:, 0]


def refine(start: TwoViewPose, support: Support, iterations: int) -> PoseFit:
    """Robust Gauss-Newton on all points, from a start near enough that most points agree.

    Raises DegenerateError where the points do not determine a pose.
    """
    fit = evaluate(start, support)
    for _ in range(iterations):
        fit = evaluate(fit.improved(), support)
    return fit


def gather(start: TwoViewPose, points: TwoViewPoints) -> TwoViewPose:
    """Draw in the points that a start from one plane misses: a wide reach for them, a third at each step.

    Each plane, and the points on none, have a scale of their own, so that the plane which the start
    comes from holds the pose while the others pull it right.
    """
    pose, reach = start, np.inf
    free = points.plane_index == FREE
    members = [np.flatnonzero(points.plane_index == plane) for plane in range(len(start.planes))]
    for _ in range(12):
        found = residuals(pose, points)
        levels = np.array([median_level(found.both[:, mine].ravel()) for mine in members])
        floor = float(levels.min()) if members else biweight_level(found.epipolar)
        reach = max(floor, min(reach / 3, median_level(found.epipolar[free]))) if free.any() else floor
        scale = np.append(levels, reach)[points.plane_index]  # that of FREE is the last
        weights = biweight(found.both / scale) / scale**2
        information, cross, _ = normal_equations(pose, points, weights, found.both[None])
        step = solve_normal_equations(information, -cross[:, 0])
        pose = pose.moved(step)
        if reach <= floor and np.abs(step[:POSE_PARAMETERS]).max() < 1e-4:
            break
    return pose


def evaluate(pose: TwoViewPose, support: Support, bows: PlaneBows = NO_BOWS) -> PoseFit:
    """Residuals, noise and weights at a pose."""
    found = residuals(pose, support.points, bows)
    on_plane = int(np.count_nonzero(support.points.plane_index != FREE))
    count = len(support.points) + on_plane
    freedom = count - POSE_PARAMETERS - 3 * len(pose.planes)
    if freedom < 1:
        raise DegenerateError("pose: fewer measurements than unknowns; more correspondences are needed")
    levels = _levels(found, on_plane, count / freedom)
    robust_weights = np.stack([biweights(*family) for family in zip(found.both, levels, strict=True)])
    epipolar_noise, along_noise = (
        with_shared_part(*family) for family in zip(found.both, robust_weights, levels, support.blocks, strict=True)
    )
    return PoseFit(pose, support.points, found, epipolar_noise, along_noise, robust_weights)


def chi_square(fit: PoseFit, reference: PoseFit) -> FloatArray:
    """(N,) saturating chi-square of both residuals of each point, in the noise of `reference`."""
    epipolar, along = (
        biweight_loss(values / noise.level) * (noise.level**2 / noise.variance)
        for values, noise in zip(fit.found.both, (reference.epipolar_noise, reference.along_noise), strict=True)
    )
    return epipolar + along


def solve_normal_equations(information: FloatArray, right: FloatArray) -> FloatArray:
    """The step for one right-hand side (S,), or steps for many (S, K); DegenerateError where nothing determines one."""
    scale = np.sqrt(np.diag(information))
    if not (scale > 0).all():
        raise DegenerateError("pose: the points do not determine it; show a plane that fills more of the picture")
    try:
        step = (np.linalg.solve(information / np.outer(scale, scale), (right.T / scale).T).T / scale).T
    except np.linalg.LinAlgError:
        step = np.full(right.shape, np.nan)
    if not np.isfinite(step).all():
        raise DegenerateError("pose: the points do not determine it; show a plane that fills more of the picture")
    return step


def _levels(found: Residuals, on_plane: int, correction: float) -> tuple[float, float]:
    """Level of each family; one for both unless they clearly differ."""
    across = len(found.epipolar)
    if min(across, on_plane) < FEWEST_OF_A_FAMILY:
        pooled = biweight_level(found.both.ravel(), correction)
        return pooled, pooled
    epipolar, along = biweight_level(found.epipolar, correction), biweight_level(found.along, correction)
    spread = np.sqrt(2 / across + 2 / on_plane)
    if abs(2 * np.log(along / epipolar)) > 4 * spread:
        return epipolar, along
    between = (across * epipolar + on_plane * along) / (across + on_plane)
    pooled = reweighted_level(found.both.ravel(), between, correction)
    return pooled, pooled
