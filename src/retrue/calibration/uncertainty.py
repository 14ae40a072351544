"""How well the parameters are known, and what that means in the scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from retrue.calibration.bundle import Adjusted
from retrue.calibration.jacobians import on_plane_of, triangulated
from retrue.calibration.setup import INTRINSICS
from retrue.geometry.arrays import FloatArray
from retrue.geometry.two_view import tangent_basis

LENS = ("fx", "fy", "cx", "cy", "k1")
"""The intrinsics behind the four numbers of `lens_covariance`."""
POSE = 6
"""Numbers of the pose in `rig_covariance`: rotation, direction of t, and log |t|."""
FLOOR = (1e-5, 1e-2, 1e-2, 1e-5)
"""Sigmas added to those numbers: no lens is known better, and the covariance stays positive definite."""
STATED = (2e-3, 1.0, 1.0, 1e-3)
"""Sigmas of a lens that was handed in and held: the calibration measures none of it, so that they are what
recalibration takes for any rig that states nothing."""


@dataclass(frozen=True, slots=True)
class PredictedError:
    """How far triangulated points are off through the calibration's own uncertainty, one sigma.

    Attributes
    ----------
    length : RMS over the picture, in the rig's unit; of the whole vector.
    distance : for points at this depth, the middle of the captured boards.
    allowance : how many times as much these devices may err as two that stand half of the distance apart, of both
        coordinates. What a pixel is worth in depth grows with distance over baseline, so that devices that stand
        closer, as pairs of cameras do, are not worse calibrated for it; one coordinate is half of what both tell.
    """

    length: float
    distance: float
    allowance: float = 1.0

    @property
    def relative(self) -> float:
        """Of the distance, over the allowance; NaN where nothing is seen by both devices."""
        return self.length / self.distance / self.allowance


def parameter_sigmas(fit: Adjusted) -> dict[str, dict[str, float]]:
    """One sigma of every free parameter: of the camera, the projector, and the pose between them.

    Pixels; distortion in its own units; rotation in degrees about the projector's axes, translation in the rig's unit.
    """
    columns = fit.setup.columns
    sigma = np.sqrt(np.maximum(np.diag(fit.covariance), 0))
    sigma[columns.rotation] = np.degrees(sigma[columns.rotation])
    blocks = (
        ("camera", INTRINSICS, columns.intrinsics(0)),
        ("projector", INTRINSICS, columns.intrinsics(1)),
        ("projector_from_camera", ("rx_deg", "ry_deg", "rz_deg", "tx", "ty", "tz"), columns.pose),
    )
    return {
        what: {name: float(size) for name, size, free in zip(names, sigma[own], fit.active[own], strict=True) if free}
        for what, names, own in blocks
    }


def rig_covariance(fit: Adjusted, fixed: Sequence[bool]) -> FloatArray:
    """(14, 14) of the pose (5), log |t|, and the lenses (8), with all that they share; everything else is free.

    The pose in the parameters of `geometry.two_view.pose_covariance`: R <- exp([w]x) R as in `Setup`; of t <- t + v the
    direction changes by B^T v / |t|, B its `tangent_basis`, and log |t| by t . v / |t|^2. Of each lens
    log sqrt(fx fy), cx, cy in pixels, and k1. A k1 that was left out of the fit for not paying for itself has the
    variance that the captures leave it; a lens that was `fixed` has `STATED`.
    """
    setup, t = fit.setup, fit.setup.second_from_first.t
    length, columns = np.linalg.norm(t), fit.setup.columns
    by_shared = np.zeros((POSE + 8, columns.shared))
    by_shared[:3, columns.rotation] = np.eye(3)
    by_shared[3:5, columns.translation] = tangent_basis(t / length).T / length
    by_shared[5, columns.translation] = t / length**2
    variance = np.zeros(len(by_shared))
    variance[POSE:] = np.tile(FLOOR, 2) ** 2
    for device, camera in enumerate(setup.devices):
        own = slice(POSE + 4 * device, POSE + 4 * device + 4)
        if fixed[device]:
            variance[own] += np.square(STATED)
            continue
        fx, fy = camera.K[0, 0], camera.K[1, 1]
        lens = [columns.intrinsic(device, name) for name in LENS]
        by_shared[own, lens] = [[0.5 / fx, 0.5 / fy, 0, 0, 0], *np.eye(5)[2:]]
    return _symmetric(by_shared @ fit.covariance @ by_shared.T) + np.diag(variance)


def lens_covariance(rig: FloatArray) -> FloatArray:
    """(8, 8) of the lenses, the marginal of `rig_covariance`."""
    return rig[POSE:, POSE:]


def pose_covariance(rig: FloatArray) -> FloatArray:
    """(5, 5) of the pose up to scale, the marginal of `rig_covariance`."""
    return rig[: POSE - 1, : POSE - 1]


def predicted_error(fit: Adjusted) -> PredictedError:
    """The error of triangulation, over the part of the picture that both devices see, from the full covariance."""
    setup = fit.setup
    camera, projector = setup.devices
    distance = float(np.median([pose.t[2] for pose in setup.first_from_board]))
    unknown = ~fit.active[setup.columns.translation][:2]  # of a code of one coordinate
    allowance = max(1.0, 0.5 * distance / float(np.linalg.norm(setup.second_from_first.t))) * (1 + unknown.any())
    x, y = np.meshgrid(*(np.linspace(0.05, 0.95, 7) * (side - 1) for side in camera.size))
    camera_px = np.stack([x.ravel(), y.ravel()], axis=-1)
    rays = camera.unproject(camera_px)
    points = np.concatenate([rays, np.ones((len(rays), 1))], axis=1) * distance
    there = setup.second_from_first.apply(points)
    projector_px, both = projector.project(there), projector.sees(there) & np.isfinite(rays).all(axis=1)
    if not both.any():
        return PredictedError(float("nan"), distance, allowance)
    camera_px, projector_px = camera_px[both], projector_px[both]
    squares = np.zeros(len(camera_px))
    values, vectors = np.linalg.eigh(fit.covariance[np.ix_(fit.active, fit.active)])
    for value, vector in zip(values, vectors.T, strict=True):
        change = np.zeros(len(fit.active))
        change[fit.active] = 1e-3 * np.sqrt(max(value, 0.0)) * vector  # small, so that the step is linear
        shifted = setup.moved(change)
        if shifted is None:
            return PredictedError(float("nan"), distance, allowance)
        moved = shifted.devices[0].unproject(camera_px)
        if unknown.any():
            there = on_plane_of(shifted, moved, projector_px, int(np.argmin(unknown)))
        else:
            there = triangulated(shifted, moved, projector_px)
        squares += np.sum((there - points[both]) ** 2, axis=1) / 1e-6
    return PredictedError(float(np.sqrt(np.mean(squares))), distance, allowance)


def normal_spread_deg(fit: Adjusted) -> float:
    """The largest angle between two boards, in degrees."""
    normals = np.stack([pose.R[:, 2] for pose in fit.setup.first_from_board])
    return float(np.degrees(np.arccos(np.clip(normals @ normals.T, -1, 1)).max()))


def depth_spread(fit: Adjusted) -> float:
    """The range of the boards' depths over their mean."""
    depths: FloatArray = np.array([pose.t[2] for pose in fit.setup.first_from_board])
    return float(np.ptp(depths) / depths.mean())


def _symmetric(matrix: FloatArray) -> FloatArray:
    return (matrix + matrix.T) / 2
