"""Fit one pose to all points of all captures, robustly, with noise that is measured, not assumed.

Each residual is modelled as independent noise plus a slow error that neighbours share (a bowed
plane, what a lens model leaves over, a smoothed code). Both levels are estimated from the residuals: a
thousand neighbours with one common error then weigh like one, and the reported sigma says so.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.errors import DegenerateError
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.two_view import (
    FREE,
    POSE_PARAMETERS,
    Residuals,
    TwoViewPoints,
    TwoViewPose,
    normal_equations,
    pose_covariance,
    residuals,
)

CUTOFF = 6.0  # of the noise; Tukey's biweight there keeps 98 % of the efficiency of least squares
CONSISTENCY = 0.8924  # E[w r^2] / E[w] of a standard normal under that biweight
COVARIANCE_FACTOR = 0.9651  # E[w] E[psi^2] / E[psi']^2 likewise: inverse information to covariance
BLOCKS = 6  # per side: a slow error is common to 1/36 of the picture, or of a plane
SMALLEST_LEVEL = 1e-9  # of the nominal sigma: exact points


@dataclass(frozen=True, slots=True, eq=False)
class Noise:
    """One family of residuals: its level as a multiple of the nominal sigma, and each residual's variance.

    Attributes
    ----------
    level : standard deviation of the independent part.
    shared : standard deviation of the part that the points of a block share.
    variance : (N,) effective variance: sums of squares over it are chi-square.
    """

    level: float
    shared: float
    variance: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class PoseFit:
    """A pose, and what it rests on there.

    Attributes
    ----------
    pose : R, unit t, planes.
    found : residuals at the pose.
    epipolar_noise, along_noise : levels of both families.
    epipolar_weights, along_weights : robust weights, 0 .. 1.
    information, gradient : normal equations at the pose.
    """

    pose: TwoViewPose
    found: Residuals
    epipolar_noise: Noise
    along_noise: Noise
    epipolar_weights: FloatArray
    along_weights: FloatArray
    information: FloatArray
    gradient: FloatArray

    @property
    def covariance(self) -> FloatArray:
        """(5, 5) of the pose, see `pose_covariance`."""
        return pose_covariance(self.information) * COVARIANCE_FACTOR

    @property
    def explained(self) -> BoolArray:
        """(N,) points that agree with the epipolar geometry of this pose."""
        return self.epipolar_weights > 0

    def improved(self) -> TwoViewPose:
        """One Gauss-Newton step further."""
        return self.pose.moved(solve_normal_equations(self.information, -self.gradient))


def refine(start: TwoViewPose, points: TwoViewPoints, blocks: IntArray, iterations: int) -> PoseFit:
    """Robust Gauss-Newton on all points.

    Parameters
    ----------
    start : pose and planes to start from; near enough that most points agree.
    points : of all captures; `plane_index` runs over the planes of all.
    blocks : (N,) block of a picture that each point lies in, see `picture_blocks`.

    Raises DegenerateError where the points do not determine a pose.
    """
    fit = evaluate(start, points, blocks)
    for _ in range(iterations):
        fit = evaluate(fit.improved(), points, blocks)
    return fit


def gather(start: TwoViewPose, points: TwoViewPoints) -> TwoViewPose:
    """Draw in the points that a start from one plane misses: a wide reach for them, halved at each step.

    Each plane, and the points on none, have a scale of their own, so that the plane which the start
    comes from holds the pose while the others pull it right.
    """
    pose, reach = start, np.inf
    free = points.plane_index == FREE
    for _ in range(12):
        found = residuals(pose, points)
        scale = np.empty(len(points))
        plane_of_row = points.plane_index[found.rows]
        levels: list[float] = []
        for plane in range(len(pose.planes)):
            along = found.along[plane_of_row == plane]
            mine = points.plane_index == plane
            levels.append(robust_level(np.concatenate([found.epipolar[mine], along])))
            scale[mine] = levels[-1]
        floor = min(levels)
        reach = max(floor, min(reach / 2, robust_level(found.epipolar[free]))) if free.any() else floor
        scale[free] = reach
        along_scale = scale[found.rows]
        information, gradient = normal_equations(
            pose,
            points,
            found,
            biweight(found.epipolar / scale) / scale**2,
            biweight(found.along / along_scale) / along_scale**2,
        )
        step = solve_normal_equations(information, -gradient)
        pose = pose.moved(step)
        if reach <= floor and np.abs(step[:POSE_PARAMETERS]).max() < 1e-4:
            break
    return pose


def evaluate(pose: TwoViewPose, points: TwoViewPoints, blocks: IntArray) -> PoseFit:
    """Residuals, noise, weights and normal equations at a pose."""
    found = residuals(pose, points)
    parameters = POSE_PARAMETERS + 3 * len(pose.planes)
    freedom = len(points) + len(found.rows) - parameters
    if freedom < 1:
        raise DegenerateError("pose: fewer measurements than unknowns; more correspondences are needed")
    epipolar_level, along_level = _levels(found, freedom)
    plane_blocks = plane_block_index(points, found.rows)
    epipolar_weights = biweight(found.epipolar / epipolar_level)
    along_weights = biweight(found.along / along_level)
    epipolar_noise = _with_shared_part(found.epipolar, epipolar_weights, epipolar_level, blocks)
    along_noise = _with_shared_part(found.along, along_weights, along_level, plane_blocks)
    information, gradient = normal_equations(
        pose,
        points,
        found,
        epipolar_weights / epipolar_noise.variance,
        along_weights / along_noise.variance,
    )
    return PoseFit(pose, found, epipolar_noise, along_noise, epipolar_weights, along_weights, information, gradient)


def chi_square(fit: PoseFit, reference: PoseFit) -> tuple[FloatArray, FloatArray]:
    """Saturating chi-square of each epipolar (N,) and along (M,) residual, in the noise of `reference`."""
    epipolar, along = reference.epipolar_noise, reference.along_noise
    return (
        biweight_loss(fit.found.epipolar / epipolar.level) * (epipolar.level**2 / epipolar.variance),
        biweight_loss(fit.found.along / along.level) * (along.level**2 / along.variance),
    )


def biweight(relative: FloatArray) -> FloatArray:
    """Tukey's weight (1 - (r / 6)^2)^2; zero from 6 on, and for NaN.

    >>> biweight(np.array([0.0, 3.0, 7.0, np.nan])).tolist()
    [1.0, 0.5625, 0.0, 0.0]
    """
    inside = 1 - (relative / CUTOFF) ** 2
    return np.fmax(inside, 0.0) ** 2


def biweight_loss(relative: FloatArray) -> FloatArray:
    """Tukey's loss: r^2 near zero, 12 from 6 on, and for NaN.

    >>> biweight_loss(np.array([0.1, 7.0, np.nan])).round(6).tolist()
    [0.009997, 12.0, 12.0]
    """
    inside = 1 - (relative / CUTOFF) ** 2
    return CUTOFF**2 / 3 * (1 - np.fmax(inside, 0.0) ** 3)


def robust_level(values: FloatArray) -> float:
    """Standard deviation from the median absolute value; not below that of exact points."""
    return max(1.4826 * float(np.median(np.abs(values))), SMALLEST_LEVEL)


def picture_blocks(camera_rays: FloatArray, capture: IntArray) -> IntArray:
    """(N,) number of the block, one of 6 x 6 over each capture's points, that each point lies in."""
    blocks = np.empty(len(camera_rays), dtype=np.int64)
    for index in range(int(capture.max()) + 1):
        mine = capture == index
        blocks[mine] = _grid_cell(camera_rays[mine]) + index * BLOCKS**2
    return blocks


def plane_block_index(points: TwoViewPoints, rows: IntArray) -> IntArray:
    """(M,) the same over each plane's own points."""
    plane = points.plane_index[rows]
    blocks = np.empty(len(rows), dtype=np.int64)
    for index in range(int(plane.max(initial=-1)) + 1):
        mine = plane == index
        if mine.any():
            blocks[mine] = _grid_cell(points.camera_rays[rows[mine]]) + index * BLOCKS**2
    return blocks


def _grid_cell(rays: FloatArray) -> IntArray:
    low, high = rays.min(axis=0), rays.max(axis=0)
    cell = ((rays - low) * (BLOCKS / np.maximum(high - low, 1e-300))).astype(np.int64)
    cell = np.minimum(cell, BLOCKS - 1)
    return cell[:, 1] * BLOCKS + cell[:, 0]


def _levels(found: Residuals, freedom: int) -> tuple[float, float]:
    """Level of each family; one for both unless they clearly differ."""
    count = len(found.epipolar) + len(found.along)
    correction = count / freedom
    pooled = _level(np.concatenate([found.epipolar, found.along]), correction)
    if min(len(found.epipolar), len(found.along)) < 20:
        return pooled, pooled
    epipolar, along = _level(found.epipolar, correction), _level(found.along, correction)
    spread = np.sqrt(2 / len(found.epipolar) + 2 / len(found.along))
    if abs(2 * np.log(along / epipolar)) > 4 * spread:
        return epipolar, along
    return pooled, pooled


def _level(values: FloatArray, correction: float) -> float:
    # From the nearest quarter (0.3186 sigma where all are good), so that half may be wrong, and more.
    level, squared = max(float(np.quantile(np.abs(values), 0.25)) / 0.3186, SMALLEST_LEVEL), values**2
    for _ in range(4):
        weights = biweight(values / level)
        squares = float((weights * squared).sum()) * correction
        level = max(float(np.sqrt(squares / (CONSISTENCY * max(float(weights.sum()), 1e-300)))), SMALLEST_LEVEL)
    return level


def _with_shared_part(values: FloatArray, weights: FloatArray, level: float, blocks: IntArray) -> Noise:
    """Split the scatter of block means into what independent noise explains and what it does not.

    With n points of independent level s in each block, Q = sum n mean^2 / s^2 is chi-square with one degree
    of freedom a block; what it exceeds that by is the shared part (DerSimonian and Laird 1986).
    """
    variance = np.full(len(values), level**2)
    if len(values) == 0:
        return Noise(level, 0.0, variance)
    number = np.bincount(blocks, weights)
    used = number > 3
    total = np.bincount(blocks, weights * values)
    count = int(np.count_nonzero(used))
    if count < 4:
        return Noise(level, 0.0, variance)
    excess = float((total[used] ** 2 / number[used]).sum() / level**2) - count
    if not excess > 4 * np.sqrt(2 * count):
        return Noise(level, 0.0, variance)
    shared = level**2 * excess / float(number[used].sum())
    variance += shared * number[blocks]
    return Noise(level, float(np.sqrt(shared)), variance)


def solve_normal_equations(information: FloatArray, right: FloatArray) -> FloatArray:
    """The step for a right-hand side; DegenerateError where the points do not determine one."""
    scale = np.sqrt(np.diag(information))
    if not (scale > 0).all():
        raise DegenerateError("pose: the points do not determine it; show a plane that fills more of the picture")
    try:
        step = np.linalg.solve(information / np.outer(scale, scale), right / scale) / scale
    except np.linalg.LinAlgError:
        step = np.full(len(right), np.nan)
    if not np.isfinite(step).all():
        raise DegenerateError("pose: the points do not determine it; show a plane that fills more of the picture")
    return step
