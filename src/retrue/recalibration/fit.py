"""Fit one pose to all points of all captures, robustly, with noise that is measured, not assumed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import log, sqrt

import numpy as np

from retrue.errors import DegenerateError
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.robust import (
    COVARIANCE_FACTOR,
    Noise,
    biweight_level,
    biweight_loss,
    gather_weights,
    grid_blocks,
    noises_and_weights,
    reweighted_level,
)
from retrue.geometry.two_view import (
    FREE,
    NO_BOWS,
    POSE_PARAMETERS,
    PlaneBows,
    Residuals,
    TwoViewPoints,
    TwoViewPose,
    pose_covariance,
    pose_difference,
    residuals,
    solve_normal_equations,
    step_equations,
    tangent_basis,
)
from retrue.recalibration.rays import Rays
from retrue.recalibration.uneven_noise import LineNoise, NoiseShape, line_noise
from retrue.rig import Rig

BLOCKS = 6  # per side: a slow error is common to 1/36 of the picture, or of a plane
FEWEST_OF_A_FAMILY = 20  # residuals that tell its level
SAME_POSE = np.radians(0.5)
NEAR = 1e-3  # radians of a last step, before a start is refined on all points


@dataclass(frozen=True, eq=False)
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

    @property
    def captures(self) -> int:
        """How many the blocks are of."""
        return int(self.blocks[0].max(initial=0)) // BLOCKS**2 + 1

    @cached_property
    def usual_points(self) -> list[FloatArray]:
        """How many points of usual sigma u share each one's block: the sum of (u / s)^2 over its points, by family."""
        sigma = np.hypot(self.points.camera_sigma, self.points.projector_sigma)
        worth = (np.median(sigma) / sigma) ** 2
        return [np.asarray(np.bincount(block + 1, worth)[block + 1], dtype=np.float64) for block in self.blocks]

    def each_alone(self) -> Support:
        """The same with a block for each point: none shares its error."""
        return replace(self, blocks=np.where(self.blocks < 0, -1, np.arange(len(self.points))))


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
    noise_shape : of a match, up to a factor; None where it is alike along all axes.
    """

    pose: TwoViewPose
    points: TwoViewPoints
    found: Residuals
    epipolar_noise: Noise
    along_noise: Noise
    robust_weights: FloatArray
    noise_shape: NoiseShape | None = None

    @cached_property
    def covariance(self) -> FloatArray:
        """(5, 5) of the pose, see `pose_covariance`."""
        return pose_covariance(self._equations[0]) * COVARIANCE_FACTOR

    @property
    def noises(self) -> tuple[Noise, Noise]:
        """Of both families."""
        return self.epipolar_noise, self.along_noise

    @property
    def even_levels(self) -> tuple[float, float]:
        """Of both, in what they are about these lines where noise is louder along one axis than across it."""
        across, along = self.levels_alike
        usual = (1.0, 1.0) if self.uneven is None else np.sqrt(self.uneven.usual / self.uneven.even).tolist()
        return across / usual[0], along / usual[1]

    @property
    def explained(self) -> BoolArray:
        """(N,) points that agree with the epipolar geometry of this pose."""
        return self.robust_weights[0] > 0

    @cached_property
    def weights(self) -> FloatArray:
        """(2, N) of the normal equations: robust weights over effective variances."""
        weights = np.empty(self.robust_weights.shape)
        for family, noise, own in zip(self.robust_weights, self.noises, weights, strict=True):
            np.divide(family, noise.variance, out=own)
        return weights

    @cached_property
    def uneven(self) -> LineNoise | None:
        """How loud each is about its own line, where noise is louder along one axis than across it."""
        return None if self.noise_shape is None else line_noise(self.pose, self.points, self.noise_shape)

    @cached_property
    def alike(self) -> FloatArray:
        """(2, N) both residuals, those that are louder than usual scaled to the others."""
        return self.found.both if self.uneven is None else self.found.both / self.uneven.relative

    @cached_property
    def levels_alike(self) -> tuple[float, float]:
        """Of both, so scaled: the level of a mixture is none of its usual residual."""
        levels = self.epipolar_noise.level, self.along_noise.level
        if self.uneven is None:
            return levels
        across, along = (
            level * biweight_level(alike) / biweight_level(values)
            for level, alike, values in zip(levels, self.alike, self.found.both, strict=True)
        )
        return across, along

    def improved(self) -> TwoViewPose:
        """One Gauss-Newton step further."""
        information, gradient = self._equations
        return self.pose.moved(solve_normal_equations(information, -gradient))

    @cached_property
    def _equations(self) -> tuple[FloatArray, FloatArray]:
        return step_equations(self.pose, self.points, self.weights, self.found)


def refine(start: TwoViewPose, support: Support, iterations: int) -> PoseFit:
    """Robust Gauss-Newton on all points, from a start near enough that most points agree.

    Raises DegenerateError where the points do not determine a pose.
    """
    fit = evaluate(start, support)
    for _ in range(iterations):
        fit = evaluate(fit.improved(), support)
    return fit


def gather(start: TwoViewPose, points: TwoViewPoints, known: Sequence[TwoViewPose] = ()) -> TwoViewPose:
    """Draw in the points that a start from one plane misses: a wide reach for them, a third at each step.

    Each plane, and the points on none, have a scale of their own, so that the plane which the start
    comes from holds the pose while the others pull it right. On the way to a known pose it goes no further.
    """
    pose, reach, planes = start, np.inf, len(start.planes)
    plane_index = np.ascontiguousarray(points.plane_index)
    for _ in range(12):
        found = residuals(pose, points)
        floor = np.inf if planes else biweight_level(found.epipolar)
        weights, floor, reach = gather_weights(found.both, plane_index, planes, floor, reach)
        information, gradient = step_equations(pose, points, weights, found)
        step = solve_normal_equations(information, -gradient)
        pose, length = pose.moved(step), float(np.abs(step[:POSE_PARAMETERS]).max())
        if length < NEAR and reach <= floor:
            break
        if length < SAME_POSE and any(same_pose(pose, other) for other in known):
            break
    return pose


def evaluate(
    pose: TwoViewPose,
    support: Support,
    bows: PlaneBows = NO_BOWS,
    aside: BoolArray | None = None,
    noise_shape: NoiseShape | None = None,
) -> PoseFit:
    """Residuals, noise and weights at a pose; rows (N,) set aside leave no residual."""
    found = residuals(pose, support.points, bows)
    if aside is not None:
        found.both[:, aside] = np.nan
    on_plane = int(np.count_nonzero(support.points.plane_index != FREE))
    count = len(support.points) + on_plane
    freedom = count - POSE_PARAMETERS - 3 * len(pose.planes)
    if freedom < 1:
        raise DegenerateError("pose: fewer measurements than unknowns; more correspondences are needed")
    levels = _levels(found, on_plane, count / freedom)
    (across, along), robust_weights = noises_and_weights(found.both, levels, support.blocks, BLOCKS)
    return PoseFit(pose, support.points, found, across, along, robust_weights, noise_shape)


def chi_square(fit: PoseFit, reference: PoseFit) -> FloatArray:
    """(N,) saturating chi-square of both residuals of each point, in the noise of `reference`."""
    epipolar, along = (
        biweight_loss(values / noise.level) * (noise.level**2 / noise.variance)
        for values, noise in zip(fit.found.both, (reference.epipolar_noise, reference.along_noise), strict=True)
    )
    return epipolar + along


def own_pose(rig: Rig) -> TwoViewPose:
    """As the rig has it, t of length 1."""
    pose = rig.projector_from_camera
    return TwoViewPose(pose.R, pose.t / np.linalg.norm(pose.t))


def same_pose(a: TwoViewPose, b: TwoViewPose) -> bool:
    """Whether two poses are one solution, found twice."""
    near = np.cos(SAME_POSE)  # tr(A B^T) = 1 + 2 cos of the angle between
    return bool(np.vdot(a.R, b.R) > 1 + 2 * near and a.t @ b.t > near)


def carried(start: TwoViewPose, end: TwoViewPose) -> FloatArray:
    """(5, 5) what changes of one pose are in the frame of another: each t has a tangent basis of its own.

    Along the great circle from t to t', a tangent v becomes v - (v . t') (t + t') / (1 + t . t'). Two bases may be a
    quarter turn apart though their t are hardly.
    """
    tangent, both = tangent_basis(start.t), start.t + end.t
    moved = tangent - np.outer(both, end.t @ tangent) / max(float(1 + start.t @ end.t), 1e-12)
    rows = np.eye(POSE_PARAMETERS)
    rows[3:, 3:] = tangent_basis(end.t).T @ moved
    return rows


def squared_sigmas(pose: TwoViewPose, other: TwoViewPose, covariance: FloatArray) -> float:
    """How far a pose is from another, as a square of sigma (5, 5) of that: chi-square, five degrees of freedom."""
    difference = pose_difference(pose, other)
    return float(difference @ np.linalg.solve(covariance, difference))


def inverse_information(information: FloatArray) -> FloatArray:
    """DegenerateError where the points do not determine the parameters."""
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    if not values[0] > 1e-13 * values[-1]:
        raise DegenerateError("pose: the points do not determine it; show a plane that fills more of the picture")
    root = vectors / np.sqrt(values) / scale[:, None]
    return root @ root.T


def _levels(found: Residuals, on_plane: int, correction: float) -> tuple[float, float]:
    """Level of each family; one for both unless they clearly differ."""
    across = len(found.epipolar)
    if min(across, on_plane) < FEWEST_OF_A_FAMILY:
        pooled = biweight_level(found.both.ravel(), correction)
        return pooled, pooled
    epipolar, along = biweight_level(found.epipolar, correction), biweight_level(found.along, correction)
    spread = sqrt(2 / across + 2 / on_plane)
    if abs(2 * log(along / epipolar)) > 4 * spread:
        return epipolar, along
    between = (across * epipolar + on_plane * along) / (across + on_plane)
    pooled = reweighted_level(found.both.ravel(), between, correction)
    return pooled, pooled
