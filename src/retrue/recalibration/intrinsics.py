"""How far the pose is off where the intrinsics are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from retrue.geometry.arrays import FloatArray
from retrue.geometry.two_view import POSE_PARAMETERS, TwoViewPoints, normal_equations, residuals
from retrue.recalibration.fit import PoseFit, solve_normal_equations
from retrue.recalibration.options import RecalibrateOptions
from retrue.rig import Rig


def intrinsics_covariance(rig: Rig, points: TwoViewPoints, fit: PoseFit, options: RecalibrateOptions) -> FloatArray:
    """(5, 5) what uncertain focal lengths and principal points of both devices do to a fitted pose, to first order.

    To be added to the covariance of the fit, which takes the intrinsics for exact. On a single plane
    it is the larger part.
    """
    covariance = np.zeros((POSE_PARAMETERS, POSE_PARAMETERS))
    for name, device in (("camera_rays", rig.camera), ("projector_rays", rig.projector)):
        seen = getattr(points, name)
        shift = options.principal_point_sigma_px / device.K[0, 0]
        shifts = np.array([[shift, 0.0], [0.0, shift]])
        for moved in (seen * (1 + options.focal_sigma), seen + shifts[0], seen + shifts[1]):
            step = _response(fit, points, replace(points, **{name: moved}))
            covariance += np.outer(step, step)
    return covariance


def _response(fit: PoseFit, points: TwoViewPoints, moved: TwoViewPoints) -> FloatArray:
    """(5,) how far the fitted pose follows points that move."""
    found = residuals(fit.pose, moved, jacobian=False)
    change_of_residuals = replace(
        fit.found, epipolar=found.epipolar - fit.found.epipolar, along=found.along - fit.found.along
    )
    _, gradient = normal_equations(
        fit.pose,
        points,
        change_of_residuals,
        fit.epipolar_weights / fit.epipolar_noise.variance,
        fit.along_weights / fit.along_noise.variance,
    )
    return solve_normal_equations(fit.information, -gradient)[:POSE_PARAMETERS]
