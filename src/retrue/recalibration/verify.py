"""Does a capture still fit a rig? Nothing is changed; the answer is good, drifted or unknown.

The epipolar residual alone cannot say: about some axes a wrong rotation hardly moves it, because the
points trade it for depth. So the best explanation of the capture is compared with the best one that keeps to the rig's
pose, as closely as the rig knows it: a likelihood ratio. It contradicts a rig even where it knows no better pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from retrue.correspondences import Correspondences, require_captures
from retrue.errors import DegenerateError, require_kind
from retrue.geometry.transform import RigidTransform
from retrue.geometry.two_view import epipolar_residuals
from retrue.rasters import check_captures
from retrue.recalibration.chance import deviations_limit
from retrue.recalibration.contradiction import contradiction
from retrue.recalibration.drift import drift, own_covariance
from retrue.recalibration.fit import own_pose
from retrue.recalibration.judge import Judgement, objection
from retrue.recalibration.misread import judge_as_meant
from retrue.recalibration.options import VerifyOptions
from retrue.recalibration.reasons import (
    Imprecise,
    OneCoordinate,
    PoseContradicted,
    PoseDrifted,
    Reason,
    RivalUnbeaten,
    drift_text,
    reason_of,
)
from retrue.recalibration.result import BANDS, Band, Verification, change, rms, sigma_at, working_distance
from retrue.rig import Rig, require_baseline, require_rig


def verify(rig: Rig, captures: Sequence[Correspondences], options: VerifyOptions | None = None) -> Verification:
    """Compare the rig's pose with the one that the captures support by themselves.

    The statistic is the likelihood ratio of the best explanation and the best within the rig's own uncertainty, lenses
    and planes being free within theirs in both: chi-square with five degrees of freedom for a rig that still holds.

    Parameters
    ----------
    rig, captures : as in `recalibrate`.

    Raises InputError where there are no captures, CaptureError where their rasters are not the rig's, DegenerateError
    where the rig's devices coincide (t = 0).
    """
    require_rig(rig)
    require_baseline(rig)
    require_captures(captures)
    check_captures(rig, captures)
    options = options or VerifyOptions()
    require_kind(options, VerifyOptions, "options")
    total = sum(len(capture) for capture in captures)
    try:
        judgement = judge_as_meant(rig, captures, options.estimate)
        return _verified(rig, judgement, total, options)
    except DegenerateError as error:
        cause = reason_of(error, captures)
        return Verification("unknown", str(cause), None, total, cause=cause)


def unasked(points: Correspondences) -> Verification:
    """What is said of a capture of one projector coordinate, which tells nothing of a pose."""
    cause = OneCoordinate()
    return Verification("unknown", str(cause), None, len(points), cause=cause)


def _verified(rig: Rig, judgement: Judgement, total: int, options: VerifyOptions) -> Verification:
    answer, pose = judgement.answer, rig.projector_from_camera
    length = float(np.linalg.norm(pose.t))
    deviations = drift(rig, judgement, options.estimate)
    supported = RigidTransform(answer.pose.R, answer.pose.t * length)
    depth = working_distance(answer.fit, answer.points, length)
    found = change(rig, supported, depth)
    uncertainty = sigma_at(depth, judgement.covariance, answer.pose, rig)
    epipolar_rms = rms(epipolar_residuals(pose, judgement.measured.support.points)[~judgement.outside])

    def verdict(
        word: Literal["good", "drifted", "unknown"], says: str | Reason, band: Band | None = None
    ) -> Verification:
        return Verification(
            word,
            str(says),
            epipolar_rms,
            total,
            found,
            deviations,
            uncertainty,
            working_distance=depth,
            cause=says if isinstance(says, Reason) else None,
            supported_pose=supported,
            band=band or BANDS[word],
            covariance=judgement.covariance,
            statistical_covariance=answer.statistical_covariance,
        )

    moved = (found.rotation_deg, found.translation_deg, found.displacement, depth, rig.unit)
    cause = objection(judgement, uncertainty, depth, options.estimate)
    limit = deviations_limit(options.false_alarms)
    holds = deviations <= limit
    if not holds and (cause is None or isinstance(cause, Imprecise | RivalUnbeaten)):
        deviations = min(deviations, contradiction(answer, own_pose(rig), own_covariance(rig, options.estimate)))
        holds = deviations <= limit
    if not holds and cause is None:
        small = found.displacement is not None and depth and found.displacement <= options.improvable * depth
        return verdict(
            "drifted",
            PoseDrifted(*moved, deviations, bool(small), judgement.inverted),
            "improvable" if small else BANDS["drifted"],
        )
    if not holds and isinstance(cause, Imprecise | RivalUnbeaten):
        return verdict("drifted", PoseContradicted(deviations, cause))
    if cause is not None and not (holds and isinstance(cause, RivalUnbeaten)):
        return verdict("unknown", cause)
    return verdict("good", f"the capture supports the rig's pose: {drift_text(*moved)}, {deviations:.1f} sigma")
