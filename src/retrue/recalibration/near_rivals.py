"""Rivals so near that nobody need decide between them and the answer: they make it less sure, and no more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from retrue.geometry.arrays import FloatArray
from retrue.geometry.transform import RigidTransform
from retrue.geometry.two_view import TwoViewPose, pose_difference
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.posterior import Posterior
from retrue.recalibration.result import sigma_at, working_distance
from retrue.recalibration.rivals import Rival
from retrue.rig import Rig
from retrue.rig_difference import pixel_displacement

LARGEST_SHARE = 1 / 3  # of the distance


def allowed_error(rig: Rig, pose: TwoViewPose, distance: float, options: RecalibrateOptions) -> float:
    """Of points at that distance, as a share of it: the option, or what one pixel is, where that is more.

    An error of more than a third has the points at infinity within three sigma: nothing is measured there.
    """
    length = float(np.linalg.norm(rig.projector_from_camera.t))
    found = replace(rig, projector_from_camera=RigidTransform(pose.R, pose.t * length))
    return max(options.max_error, min(pixel_displacement(found, distance) / distance, LARGEST_SHARE))


def near_rivals(answer: Posterior, rivals: Sequence[Rival], rig: Rig, options: RecalibrateOptions) -> list[Rival]:
    """Those that are not beaten, and from which points differ by less than the answer may be off."""
    unbeaten = [rival for rival in rivals if not rival.margin >= options.min_margin]
    if not unbeaten:
        return []
    distance = working_distance(answer.fit, answer.points, float(np.linalg.norm(rig.projector_from_camera.t)))
    if distance is None:
        return []
    allowed = allowed_error(rig, answer.pose, distance, options)
    found: list[Rival] = []
    for rival in unbeaten:
        apart = sigma_at(distance, _square(answer, rival), answer.pose, rig).displacement
        if apart is not None and apart <= allowed * distance:
            found.append(rival)
    return found


def spread(answer: Posterior, near: Sequence[Rival]) -> FloatArray:
    """(5, 5) what they add to its covariance: of two that points do not tell apart, half the way is a sigma."""
    return np.sum([_square(answer, rival) / 4 for rival in near], axis=0) if near else np.zeros((5, 5))


def _square(answer: Posterior, rival: Rival) -> FloatArray:
    step = pose_difference(rival.posterior.pose, answer.pose)
    return np.outer(step, step)
