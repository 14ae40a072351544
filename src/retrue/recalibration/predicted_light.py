"""What a candidate says of the projector's light, to be shown beside what was measured."""

from __future__ import annotations

import numpy as np

from retrue.correspondences import Correspondences
from retrue.geometry.arrays import FloatArray
from retrue.geometry.homography import apply_homography
from retrue.recalibration.light import GAMMAS, log_irradiance
from retrue.recalibration.result import PoseCandidate
from retrue.rig import Rig

ON_PLANE_PX = 5.0


def measured_light(points: Correspondences) -> FloatArray:
    """(N,) log of the light, around the median of its class: how much brighter a point is than others of its colour.

    NaN where nothing is known.
    """
    if points.light is None:
        return np.full(len(points), np.nan)
    log_light = np.log(np.where(points.light > 0, points.light, np.nan))
    classes = np.zeros(len(points), dtype=np.int64) if points.light_class is None else points.light_class
    for one in np.unique(classes):
        mine = (classes == one) & np.isfinite(log_light)
        if mine.any():
            log_light[mine] -= np.median(log_light[mine])
    return log_light


def predicted_light(rig: Rig, candidate: PoseCandidate, points: Correspondences) -> FloatArray:
    """(N,) log of the light that falls on each point under a candidate, up to a constant; NaN on none of its planes.

    A point is on the plane that transfers its pixel nearest to where it was matched.
    """
    pose = candidate.projector_from_camera
    x, y = rig.camera.unproject(points.camera_px), rig.projector.unproject(points.projector_px)
    nearest, planes = np.full(len(points), ON_PLANE_PX / rig.projector.K[0, 0]), np.full((len(points), 3), np.nan)
    for plane in candidate.planes:
        with np.errstate(invalid="ignore", divide="ignore"):
            missed = np.linalg.norm(apply_homography(pose.R + np.outer(pose.t, plane.n), x) - y, axis=1)
            on = missed < nearest
        nearest[on], planes[on] = missed[on], plane.n
    with np.errstate(invalid="ignore"):
        return log_irradiance(y, pose.R, pose.t, planes)


def in_the_cameras_curve(measured: FloatArray, predicted: FloatArray) -> FloatArray:
    """The prediction as the camera's curve shows it, the one that fits best, around what was measured; (N,).

    NaN of a pose that has all of the surface turned away from the projector.
    """
    if not np.isfinite(measured - predicted).any():
        return np.full(len(measured), np.nan)
    shown = [gamma * predicted + np.nanmedian(measured - gamma * predicted) for gamma in GAMMAS]
    return min(shown, key=lambda curve: float(np.nanmedian(np.abs(measured - curve))))
