"""How far the pose is off where what the fit takes for exact is not: the intrinsics, and the flatness of planes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from retrue.geometry.arrays import FloatArray
from retrue.geometry.two_view import (
    POSE_PARAMETERS,
    Residuals,
    TwoViewPoints,
    TwoViewPose,
    normal_equations,
    residuals,
)
from retrue.recalibration.fit import PoseFit, solve_normal_equations
from retrue.recalibration.options import RecalibrateOptions
from retrue.rig import Rig

ENOUGH_POINTS = 1000


@dataclass(frozen=True, slots=True)
class FocalChange:
    """The relative change of a device's focal length that the residuals ask for, and its sigma."""

    amount: float
    sigma: float


def systematic_covariance(rig: Rig, points: TwoViewPoints, fit: PoseFit, options: RecalibrateOptions) -> FloatArray:
    """(5, 5) what uncertain intrinsics and planes that are not quite flat do to a fitted pose, to first order.

    To be added to the covariance of the fit. On a single plane it is by far the larger part.
    """
    points, weights = _thinned(points, fit.weights)
    pose, found = fit.pose, residuals(fit.pose, points)

    def squares(moved: list[TwoViewPoints]) -> FloatArray:
        """Outer products of how far the fitted pose follows points that move."""
        information, cross, _ = normal_equations(pose, points, weights, _changes(pose, found, moved))
        steps = solve_normal_equations(information, cross)[:POSE_PARAMETERS]
        return steps @ steps.T

    intrinsics: list[TwoViewPoints] = []
    for name, device in (("camera_rays", rig.camera), ("projector_rays", rig.projector)):
        seen = getattr(points, name)
        shifts = np.diag([options.principal_point_sigma_px / device.K[0, 0]] * 2)
        moves = seen * (1 + options.focal_sigma), seen + shifts[0], seen + shifts[1]
        intrinsics += [replace(points, **{name: moved}) for moved in moves]
    covariance = squares(intrinsics)
    for plane in range(len(pose.planes)):
        covariance += squares(_bowed(pose, points, plane, options.flatness_sigma))
    return covariance


def focal_changes(points: TwoViewPoints, fit: PoseFit) -> dict[str, FocalChange]:
    """Score test for "camera" and "projector": would another focal length explain what no pose does?"""
    small = 1e-4
    names = {device: f"{device}_rays" for device in ("camera", "projector")}
    moved = [replace(points, **{name: getattr(points, name) * (1 + small)}) for name in names.values()]
    columns = np.concatenate([_changes(fit.pose, fit.found, moved), fit.found.both[None]])
    information, cross, among = normal_equations(fit.pose, points, fit.weights, columns)
    changes: dict[str, FocalChange] = {}
    for k, device in enumerate(names):
        # Schur complement: what of the change the pose and the planes cannot take up themselves.
        own = among[k, k]
        left = own - cross[:, k] @ solve_normal_equations(information, cross[:, k])
        told = bool(left > 1e-9 * own)
        amount, sigma = (-small * among[k, -1] / left, small / np.sqrt(left)) if told else (0.0, np.inf)
        changes[device] = FocalChange(float(amount), float(sigma))
    return changes


def _thinned(points: TwoViewPoints, weights: FloatArray) -> tuple[TwoViewPoints, FloatArray]:
    """Every k-th point: what is smooth over the picture needs no more."""
    kept = np.arange(0, len(points), max(1, len(points) // ENOUGH_POINTS))
    return points.select(kept), weights[:, kept]


def _bowed(pose: TwoViewPose, points: TwoViewPoints, plane: int, flatness: float) -> list[TwoViewPoints]:
    """The points of one plane moved as by each of three bows, together of that RMS relative to the distance."""
    mine = np.flatnonzero(points.plane_index == plane)
    if len(mine) < 6:
        return []
    x = points.camera_rays[mine]
    linear = np.concatenate([x, np.ones((len(x), 1))], axis=1)
    disparity = linear @ pose.planes[plane]
    scaled = (x - x.mean(axis=0)) / x.std(axis=0)
    shapes = np.stack([scaled[:, 0] ** 2, scaled[:, 0] * scaled[:, 1], scaled[:, 1] ** 2], axis=1)
    shapes = shapes - linear @ np.linalg.lstsq(linear, shapes, rcond=None)[0]  # what a tilt does not take up
    shapes = shapes / np.maximum(shapes.std(axis=0) * np.sqrt(shapes.shape[1]), 1e-300)
    v = linear @ pose.R.T
    moved: list[TwoViewPoints] = []
    before = v + disparity[:, None] * pose.t
    for shape in shapes.T:
        after = before + (disparity * flatness * shape)[:, None] * pose.t
        rays = points.projector_rays.copy()
        rays[mine] += after[:, :2] / after[:, 2:] - before[:, :2] / before[:, 2:]
        moved.append(replace(points, projector_rays=rays))
    return moved


def _changes(pose: TwoViewPose, found: Residuals, moved: list[TwoViewPoints]) -> FloatArray:
    """(K, 2, N) by how much the residuals change where the points move."""
    return np.array([residuals(pose, points).both - found.both for points in moved]).reshape(len(moved), 2, -1)
