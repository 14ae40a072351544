"""Put what was found into the words and units of the user."""

from __future__ import annotations

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray
from retrue.geometry.plane import Plane
from retrue.geometry.transform import RigidTransform, direction_angle, rotation_angle
from retrue.geometry.two_view import FREE, TwoViewPoints
from retrue.recalibration.fit import PoseFit
from retrue.recalibration.result import PoseCandidate, PoseChange, PoseSigma


def candidate(fit: PoseFit, points: TwoViewPoints, scored: BoolArray, length: float, *, chosen: bool) -> PoseCandidate:
    """One pose with t of that length; `scored` (N,) are the points that any of the poses explains."""
    planes = points.plane_index
    largest = int(np.argmax(np.bincount(planes[planes != FREE])))
    off_plane = scored & (planes != largest)
    return PoseCandidate(
        RigidTransform(fit.pose.R, fit.pose.t * length),
        tuple(Plane.from_n(n / length) for n in fit.pose.planes),
        rms(fit.found.epipolar[scored]),
        rms(fit.found.epipolar[off_plane]) if off_plane.any() else None,
        chosen,
    )


def change(old: RigidTransform, new: RigidTransform) -> PoseChange:
    """From the old pose to the new one."""
    return PoseChange(
        float(np.degrees(rotation_angle(new.R @ old.R.T))),
        float(np.degrees(direction_angle(old.t, new.t))),
        float(np.linalg.norm(new.t) - np.linalg.norm(old.t)),
    )


def sigma(covariance: FloatArray) -> PoseSigma:
    """Standard deviations of the angle of rotation and of the angle of t from a (5, 5) covariance."""
    return PoseSigma(
        float(np.degrees(np.sqrt(np.trace(covariance[:3, :3])))),
        float(np.degrees(np.sqrt(np.trace(covariance[3:, 3:])))),
    )


def rms(values: FloatArray) -> float:
    """Root mean square; NaN of nothing.

    >>> rms(np.array([3.0, 4.0])).__round__(6)
    3.535534
    """
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")
