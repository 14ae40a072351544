"""Put what was found into the words and units of the user."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray
from retrue.geometry.plane import Plane
from retrue.geometry.transform import RigidTransform
from retrue.geometry.two_view import FREE, POSE_PARAMETERS, TwoViewPoints, TwoViewPose
from retrue.recalibration.fit import PoseFit
from retrue.recalibration.result import PoseCandidate, PoseChange, PoseSigma
from retrue.recalibration.scale import inverse_depths
from retrue.rig import Rig
from retrue.rig_difference import rig_difference


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


def working_distance(fit: PoseFit, points: TwoViewPoints, length: float) -> float | None:
    """Median depth in the camera frame of the points that agree, for t of that length; None where none is in front."""
    disparity = inverse_depths(fit.pose, points.select(fit.explained))
    disparity = disparity[disparity > 0]
    return length / float(np.median(disparity)) if len(disparity) else None


def change(rig: Rig, new: RigidTransform, distance: float | None) -> PoseChange:
    """From the rig's pose to the new one; points at that distance are seen by the new rig and measured with the old."""
    found = rig_difference(replace(rig, projector_from_camera=new), rig, distance)
    return PoseChange(found.rotation_deg, found.translation_deg, -found.length, found.displacement)


def sigma(covariance: FloatArray) -> PoseSigma:
    """Standard deviations of the angle of rotation and of the angle of t from a (5, 5) covariance."""
    return PoseSigma(
        float(np.degrees(np.sqrt(np.trace(covariance[:3, :3])))),
        float(np.degrees(np.sqrt(np.trace(covariance[3:, 3:])))),
    )


def sigma_at(distance: float | None, covariance: FloatArray, pose: TwoViewPose, rig: Rig) -> PoseSigma:
    """The same, and what it does to points at that distance: the displacements of independent errors, added up."""
    angles = sigma(covariance)
    if distance is None:
        return angles
    length = float(np.linalg.norm(rig.projector_from_camera.t))
    true = replace(rig, projector_from_camera=RigidTransform(pose.R, pose.t * length))
    values, vectors = np.linalg.eigh(covariance)
    steps: FloatArray = vectors * np.sqrt(np.maximum(values, 0.0))
    squares = 0.0
    for k in range(POSE_PARAMETERS):
        off = TwoViewPose(pose.R, pose.t).moved(steps[:, k])
        wrong = replace(rig, projector_from_camera=RigidTransform(off.R, off.t * length))
        squares += (rig_difference(true, wrong, distance).displacement or 0.0) ** 2
    return replace(angles, displacement=float(np.sqrt(squares)))


def share_behind(fit: PoseFit, points: TwoViewPoints) -> float:
    """Share of the points on planes, as far as they agree with the pose, that it has behind a device."""
    rows = fit.found.rows[fit.along_weights > 0]
    if len(rows) == 0:
        return 0.0
    x: FloatArray = np.column_stack([points.camera_rays[rows], np.ones(len(rows))])
    in_camera: FloatArray = (x * fit.pose.planes[points.plane_index[rows]]).sum(axis=1)  # |t| / depth
    in_projector = x @ fit.pose.R[2] + in_camera * fit.pose.t[2]  # projector depth / camera depth
    in_front = np.count_nonzero((in_camera > 0) & (in_projector > 0))
    return 1 - in_front / len(rows)


def rms(values: FloatArray) -> float:
    """Root mean square; NaN of nothing.

    >>> rms(np.array([3.0, 4.0])).__round__(6)
    3.535534
    """
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")
