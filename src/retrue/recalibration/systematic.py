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
    points, fit = _thinned(points, fit)
    covariance = np.zeros((POSE_PARAMETERS, POSE_PARAMETERS))
    for name, device in (("camera_rays", rig.camera), ("projector_rays", rig.projector)):
        seen = getattr(points, name)
        shifts = np.diag([options.principal_point_sigma_px / device.K[0, 0]] * 2)
        for moved in (seen * (1 + options.focal_sigma), seen + shifts[0], seen + shifts[1]):
            step = _response(fit, points, replace(points, **{name: moved}))
            covariance += np.outer(step, step)
    for plane in range(len(fit.pose.planes)):
        for moved in _bowed(fit.pose, points, plane, options.flatness_sigma):
            step = _response(fit, points, moved)
            covariance += np.outer(step, step)
    return covariance


def focal_change(points: TwoViewPoints, fit: PoseFit, device: str) -> FocalChange:
    """Score test: would another focal length of that device ("camera" or "projector") explain what no pose does?"""
    name, small = f"{device}_rays", 1e-4
    change = _change(fit, replace(points, **{name: getattr(points, name) * (1 + small)}))
    epipolar_weights, along_weights = _weights(fit)
    _, cross = normal_equations(fit.pose, points, change, epipolar_weights, along_weights)
    own = (epipolar_weights * change.epipolar**2).sum() + (along_weights * change.along**2).sum()
    slope = (epipolar_weights * change.epipolar * fit.found.epipolar).sum()
    slope += (along_weights * change.along * fit.found.along).sum()
    # Schur complement: what of the change the pose and the planes cannot take up themselves.
    left = own - cross @ solve_normal_equations(fit.information, cross)
    if not left > 1e-9 * own:
        return FocalChange(0.0, np.inf)
    return FocalChange(float(-small * slope / left), float(small / np.sqrt(left)))


def _thinned(points: TwoViewPoints, fit: PoseFit) -> tuple[TwoViewPoints, PoseFit]:
    """Every k-th point: what is smooth over the picture needs no more."""
    stride = len(points) // ENOUGH_POINTS
    if stride < 2:
        return points, fit
    kept = np.zeros(len(points), dtype=np.bool_)
    kept[::stride] = True
    along = kept[fit.found.rows]
    few = points.select(kept)
    found = Residuals(
        fit.found.epipolar[kept],
        fit.found.epipolar_jacobian[:, kept],
        (np.cumsum(kept) - 1)[fit.found.rows[along]],
        fit.found.along[along],
        fit.found.along_jacobian[:, along],
    )
    thinned = replace(
        fit,
        found=found,
        epipolar_weights=fit.epipolar_weights[kept],
        along_weights=fit.along_weights[along],
        epipolar_noise=replace(fit.epipolar_noise, variance=fit.epipolar_noise.variance[kept]),
        along_noise=replace(fit.along_noise, variance=fit.along_noise.variance[along]),
    )
    information, gradient = normal_equations(fit.pose, few, found, *_weights(thinned))
    return few, replace(thinned, information=information, gradient=gradient)


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


def _response(fit: PoseFit, points: TwoViewPoints, moved: TwoViewPoints) -> FloatArray:
    """(5,) how far the fitted pose follows points that move."""
    _, gradient = normal_equations(fit.pose, points, _change(fit, moved), *_weights(fit))
    return solve_normal_equations(fit.information, -gradient)[:POSE_PARAMETERS]


def _change(fit: PoseFit, moved: TwoViewPoints) -> Residuals:
    found = residuals(fit.pose, moved, jacobian=False)
    return replace(fit.found, epipolar=found.epipolar - fit.found.epipolar, along=found.along - fit.found.along)


def _weights(fit: PoseFit) -> tuple[FloatArray, FloatArray]:
    return (
        fit.epipolar_weights / fit.epipolar_noise.variance,
        fit.along_weights / fit.along_noise.variance,
    )
