"""One bundle adjustment over intrinsics, relative pose and board poses.

Levenberg-Marquardt with a robust loss. Each view has eight unknowns of its own, which are eliminated (Schur
complement), so that a step solves one system of at most twenty-seven unknowns, however many views there are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from retrue.calibration.jacobians import Setup, linearise
from retrue.calibration.normal_equations import HUBER, Linearised, NormalEquations, shift_precision, size_in_sigmas
from retrue.calibration.observations import Group
from retrue.errors import DegenerateError
from retrue.geometry.arrays import BoolArray, FloatArray
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform, rotation_from_vector

SETTLED = 0.02
"""Fall of chi-square below which a fit has settled: far less than one sigma of anything."""


@dataclass(frozen=True, slots=True, eq=False)
class Adjusted:
    """The best fit.

    Attributes
    ----------
    setup : the estimate.
    active : (globals,) which of the columns before those of the view were free.
    scales : of each group (2,), the noise of both coordinates in units of the observations' own sigma.
    errors : of each group, predicted minus measured pixels (N, 2), as `linearise` gives them.
    weights : of each group (N, 2), robust weights; 1 for what fits.
    covariance : (free, free) of the free global parameters.
    normal : (globals, globals) normal matrix of all global parameters, the views' own eliminated.
    gradient : (globals,) of half the cost, by all global parameters; zero for the free ones.
    """

    setup: Setup
    active: BoolArray
    scales: tuple[FloatArray, ...]
    errors: tuple[FloatArray, ...]
    weights: tuple[FloatArray, ...]
    covariance: FloatArray
    normal: FloatArray
    gradient: FloatArray


def adjust(
    setup: Setup,
    groups: tuple[Group, ...],
    active: BoolArray,
    *,
    robust: bool = True,
    scales: tuple[FloatArray, ...] | None = None,
) -> Adjusted:
    """Minimise the residuals of all groups over the active columns and all board poses.

    The groups' noise levels are estimated with the rest (variance components), from `scales` in one round, or from
    nothing in three. Not `robust`: plain least squares, every pixel weighing the same, which is what OpenCV minimises.
    Raises `DegenerateError` where the observations do not determine the unknowns.
    """
    if not robust:
        groups = tuple(replace(group, sigma=np.ones(len(group.sigma))) for group in groups)
    linearised = _linearised(setup, groups)
    if not all(np.isfinite(error).all() for error, _ in linearised):
        raise DegenerateError("calibration: the starting point puts part of the board behind a device")
    rounds = 3 if scales is None and robust else 1
    if scales is None:
        pairs = zip(linearised, groups, strict=True)
        scales = tuple(_robust_scale(error, group) if robust else np.ones(2) for (error, _), group in pairs)
    for _ in range(rounds):
        setup, linearised = _minimise(setup, groups, linearised, active, scales, robust)
        before, scales = scales, NormalEquations(setup, groups, linearised, active, scales, robust).rescaled()
        if not robust:
            common = float(np.sqrt(np.mean(np.concatenate(scales) ** 2)))
            scales = tuple([np.full(2, common) for _ in groups])
        if np.allclose(np.concatenate(scales), np.concatenate(before), rtol=0.05):
            break
    equations = NormalEquations(setup, groups, linearised, active, scales, robust)
    return Adjusted(
        setup,
        active,
        scales,
        tuple(equations.errors),
        tuple(equations.weights),
        equations.covariance(),
        *equations.reduced(np.ones_like(active)),
    )


def _minimise(
    setup: Setup,
    groups: tuple[Group, ...],
    linearised: Linearised,
    active: BoolArray,
    scales: tuple[FloatArray, ...],
    robust: bool,
) -> tuple[Setup, Linearised]:
    damping, cost = 1e-10, _cost(setup, groups, linearised, scales, robust)
    for _ in range(50):
        equations = NormalEquations(setup, groups, linearised, active, scales, robust)
        while damping < 1e12:
            if (candidate := moved(setup, *equations.step(damping))) is not None:
                there = _linearised(candidate, groups)
                new_cost = _cost(candidate, groups, there, scales, robust)
                if new_cost < cost:
                    setup, linearised, damping = candidate, there, max(damping / 10, 1e-12)
                    break
            damping *= 10
        else:
            return setup, linearised
        if cost - new_cost < (SETTLED if robust else 1e-12 * cost):
            return setup, linearised
        cost = new_cost
    return setup, linearised


def _linearised(setup: Setup, groups: tuple[Group, ...]) -> Linearised:
    return tuple(linearise(setup, group) for group in groups)


def moved(setup: Setup, change: FloatArray, boards: FloatArray) -> Setup | None:
    """The setup after a step; None where it is none (a focal length below zero)."""
    devices: list[Camera] = []
    for index, camera in enumerate(setup.devices):
        own = change[9 * index : 9 * index + 9]
        if not own.any():
            devices.append(camera)
            continue
        K, distortion = camera.K.copy(), camera.distortion.copy()
        K[[0, 1, 0, 1], [0, 1, 2, 2]] += own[:4]
        distortion[:5] += own[4:]
        if not (K[0, 0] > 0 and K[1, 1] > 0 and np.isfinite(K).all() and np.isfinite(distortion).all()):
            return None
        devices.append(Camera(camera.size, K, distortion))
    second = setup.second_from_first
    if len(devices) == 2:
        second = _turned(second, change[18:24])
    first_from_board = tuple(_turned(pose, own) for pose, own in zip(setup.first_from_board, boards, strict=True))
    return Setup(tuple(devices), second, first_from_board, setup.bend + change[-3:], setup.shifts + boards[:, 6:])


def _turned(pose: RigidTransform, change: FloatArray) -> RigidTransform:
    return RigidTransform(rotation_from_vector(change[:3]) @ pose.R, pose.t + change[3:6])


def _cost(
    setup: Setup, groups: tuple[Group, ...], linearised: Linearised, scales: tuple[FloatArray, ...], robust: bool
) -> float:
    total = float(shift_precision(robust) * np.sum(setup.shifts**2))
    for group, scale, (error, _) in zip(groups, scales, linearised, strict=True):
        size = size_in_sigmas(error, group, scale)
        if not np.isfinite(size).all():
            return np.inf
        loss = np.where(size > HUBER, HUBER * (2 * size - HUBER), size**2) if robust else size**2
        total += float(loss.sum())
    return total


def _robust_scale(error: FloatArray, group: Group) -> FloatArray:
    """The noise of both coordinates, from the median."""
    size = np.abs(error) / group.sigma[:, None]
    return np.maximum(np.median(size, axis=0) / 0.6745, 1e-6) if len(size) else np.ones(2)
