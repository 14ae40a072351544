"""A rig that creeps: a filter over many frames finds what no single one can, and tells it from a bump.

Each frame k supports a pose of its own, y_k = x_k + r_k away from the rig's: a rotation vector and two angles of the
direction of t, five in all, with the covariance R_k of the frame's own points. What x does is a local linear trend,
x_k = x_(k-1) + v_(k-1), v_k = v_(k-1) + q_k, so that a creep of any rate is followed without delay. For q stands R over
4 m^4, which makes the filter settle at the covariance of about m frames, the memory (Kalman 1960; Kalata 1984). R_k is
scaled by how frames really scatter from one to the next: less than they say where they are copies. Where a frame is
further from what was expected than one in twenty, the rate changed, and the filter forgets as much as that takes.

What the rig was off from the beginning is no creep, nor is what another scene adds at once: only what is added since,
little by little. A frame that is far both from what was expected and from the frames before is left out; so are others,
for `BUMP_FRAMES` in a row: then the filter goes on from there, and where they agreed it was a bump, or another scene.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from retrue.geometry.arrays import FloatArray
from retrue.geometry.transform import RigidTransform, vector_from_rotation
from retrue.geometry.two_view import POSE_PARAMETERS, tangent_basis
from retrue.recalibration.result import Verification
from retrue.recalibration.streak import CreepOptions

LEAST_SCATTER = 0.02  # of a frame's sigma; pictures that are copies of each other scatter not at all
BUMP_FRAMES = 3
FIRST_RATE = 1.0  # a frame: how fast a rig may creep, at the beginning, in sigma of a frame
SELDOM = 3.33  # chi of five degrees of freedom that one in twenty exceeds
SIZE = POSE_PARAMETERS
TREND = np.block([[np.eye(SIZE), np.eye(SIZE)], [np.zeros((SIZE, SIZE)), np.eye(SIZE)]])


@dataclass(frozen=True, slots=True, eq=False)
class Creep:
    """What the filter knows. Radians; a rotation vector, then the direction of t in the tangent of the rig's.

    Attributes
    ----------
    state : (10,) the offset from the rig's pose, and its rate a frame.
    covariance : (10, 10) of it.
    frame : (5, 5) covariance of a frame, as frames have it, smoothed.
    scatter : variance of frames from one to the next, as a multiple of what they say.
    recent : (K, 5) offsets of the last frames that went in.
    baseline, baseline_covariance : (5,), (5, 5) of the first frames; None while there are too few.
    jumps : (K, 5) offsets of the last frames that lay elsewhere, one after the other.
    frames : that went in since the filter began.
    rested : frames since the last attempt to recalibrate.
    bumps : how often it began anew because frames agreed on another place.
    """

    state: FloatArray
    covariance: FloatArray
    frame: FloatArray
    recent: FloatArray
    scatter: float = 1.0
    baseline: FloatArray | None = None
    baseline_covariance: FloatArray | None = None
    jumps: FloatArray | None = None
    frames: int = 1
    rested: int = 0
    bumps: int = 0

    @property
    def offset(self) -> FloatArray:
        """(5,) from the rig's pose, as the filter knows it."""
        return self.state[:SIZE]

    @property
    def added(self) -> FloatArray:
        """(2,) creep since the baseline: the angles of rotation and direction of t."""
        if self.baseline is None:
            return np.zeros(2)
        moved = self.offset - self.baseline
        return np.array([np.linalg.norm(moved[:3]), np.linalg.norm(moved[3:])], dtype=np.float64)

    @property
    def sigmas(self) -> float:
        """The same in sigma: a Mahalanobis length."""
        if self.baseline is None or self.baseline_covariance is None:
            return 0.0
        return _length(self.offset - self.baseline, self.covariance[:SIZE, :SIZE] + self.baseline_covariance)

    @property
    def noise(self) -> FloatArray:
        """(5, 5) covariance of a frame about what is expected of it."""
        return self.frame * max(self.scatter, LEAST_SCATTER**2)


def after_frame(
    creep: Creep | None, rig_pose: RigidTransform, found: Verification, options: CreepOptions
) -> Creep | None:
    """With what one more frame says. One that cannot tell, or jumps, changes nothing, unless others join it."""
    measured = measured_offset(rig_pose, found)
    return creep if measured is None else after_offset(creep, *measured, options)


def after_offset(creep: Creep | None, offset: FloatArray, frame: FloatArray, options: CreepOptions) -> Creep:
    """The same of an offset (5,) and its covariance (5, 5)."""
    memory = options.creep_memory
    if creep is None:
        return _begun(offset, frame)
    expected, spread = _expected(creep, memory)
    noise = frame * max(creep.scatter, LEAST_SCATTER**2)
    innovation = offset - expected[:SIZE]
    if _jump(creep, offset, frame, options) > options.creep_sigmas:
        return _after_jump(creep, offset, frame, options)
    spread = spread * max(_length(innovation, spread[:SIZE, :SIZE] + noise) / SELDOM, 1.0) ** 2
    apart = offset - creep.recent[-1]
    scatter = _length(apart, frame + creep.frame) ** 2 / SIZE
    gain: FloatArray = np.linalg.solve(spread[:SIZE, :SIZE] + noise, spread[:SIZE]).T.astype(np.float64)
    left = np.eye(2 * SIZE)
    left[:, :SIZE] -= gain
    weight = 1 / min(creep.frames + 1, memory)
    after = replace(
        creep,
        state=expected + gain @ innovation,
        covariance=left @ spread @ left.T + gain @ noise @ gain.T,
        frame=creep.frame + weight * (frame - creep.frame),
        recent=np.vstack([creep.recent, offset])[-BUMP_FRAMES:],
        scatter=creep.scatter + weight * (scatter - creep.scatter),
        jumps=None,
        frames=creep.frames + 1,
        rested=creep.rested + 1,
    )
    if after.baseline is None and after.frames >= memory:
        return replace(after, baseline=after.offset, baseline_covariance=after.covariance[:SIZE, :SIZE])
    return after


def jump(creep: Creep | None, rig_pose: RigidTransform, found: Verification, options: CreepOptions) -> float:
    """How far the frame is from what was expected, or from those before if that is less, in sigma of the difference.

    0 where nobody knows.
    """
    measured = measured_offset(rig_pose, found)
    if creep is None or measured is None:
        return 0.0
    return _jump(creep, *measured, options)


def creep_is_due(creep: Creep | None, options: CreepOptions) -> bool:
    """Whether the rig crept beyond doubt, and so far that a recalibration is worth it."""
    if creep is None or creep.baseline is None or creep.rested < options.creep_memory:
        return False
    if not creep.sigmas > options.creep_sigmas:
        return False
    frame = np.sqrt([np.trace(creep.frame[:3, :3]), np.trace(creep.frame[3:, 3:])])
    return bool(np.max(creep.added / frame) >= options.creep_share)


def measured_offset(rig_pose: RigidTransform, found: Verification) -> tuple[FloatArray, FloatArray] | None:
    """(5,) offset of the pose that the frame supports, and (5, 5) its covariance; None where it cannot tell."""
    measured = measured_pose(found)
    return None if measured is None else offset_from(rig_pose, *measured)


def measured_pose(found: Verification) -> tuple[RigidTransform, FloatArray] | None:
    """The pose that the frame supports, and (5, 5) its covariance; None where it cannot tell.

    Where a frame states its angles' sigma alone, that is taken to be as large about each axis.
    """
    if found.supported_pose is None or found.sigma is None or found.verdict == "unknown":
        return None
    covariance = found.statistical_covariance
    if covariance is None:
        sigma = np.radians([found.sigma.rotation_deg, found.sigma.translation_deg])
        covariance = np.diag(np.repeat(sigma**2 / [3, 2], [3, 2]))
    pose = found.supported_pose
    numbers = np.concatenate([pose.R.ravel(), pose.t, covariance.ravel()])
    if not (np.isfinite(numbers).all() and np.linalg.eigvalsh(covariance)[0] > 0):
        return None
    return pose, covariance


def offset_from(
    rig_pose: RigidTransform, pose: RigidTransform, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(5,) from one pose to another, and (5, 5) the covariance of that, whose t has a tangent of its own."""
    old, new = (one.t / np.linalg.norm(one.t) for one in (rig_pose, pose))
    across = tangent_basis(old)
    rows = np.eye(SIZE)
    rows[3:, 3:] = across.T @ tangent_basis(new)
    offset = np.concatenate([vector_from_rotation(pose.R @ rig_pose.R.T), across.T @ (new - old)])
    return offset, rows @ covariance @ rows.T


def _begun(offset: FloatArray, frame: FloatArray) -> Creep:
    covariance = np.zeros((2 * SIZE, 2 * SIZE))
    covariance[:SIZE, :SIZE], covariance[SIZE:, SIZE:] = frame, frame * FIRST_RATE**2
    return Creep(np.concatenate([offset, np.zeros(SIZE)]), covariance, frame, offset[None])


def _expected(creep: Creep, memory: int) -> tuple[FloatArray, FloatArray]:
    """State (10,) and covariance (10, 10) at the next frame."""
    spread = TREND @ creep.covariance @ TREND.T
    spread[SIZE:, SIZE:] += creep.noise / (4 * memory**4)
    return TREND @ creep.state, spread


def _jump(creep: Creep, offset: FloatArray, frame: FloatArray, options: CreepOptions) -> float:
    expected, spread = _expected(creep, options.creep_memory)
    noise = frame * max(creep.scatter, LEAST_SCATTER**2)
    wandered = 2 * max(creep.scatter - 1, 0.0) * BUMP_FRAMES  # what frames scatter by beyond what they say, it moves by
    before = creep.noise / len(creep.recent) + creep.frame * wandered
    return min(
        _length(offset - expected[:SIZE], spread[:SIZE, :SIZE] + noise),
        _length(offset - creep.recent.mean(axis=0), before + noise),
    )


def _after_jump(creep: Creep, offset: FloatArray, frame: FloatArray, options: CreepOptions) -> Creep:
    """One more frame elsewhere; after as many as a bump takes, the filter goes on from their mean.

    Where they do not agree, it was no bump: the rig moves from frame to frame, and the scatter says so from then on.
    """
    jumps = np.vstack([np.empty((0, SIZE)) if creep.jumps is None else creep.jumps, offset])
    if len(jumps) < BUMP_FRAMES:
        return replace(creep, jumps=jumps)
    mean, steps = jumps.mean(axis=0), np.diff(jumps, axis=0)
    agreed = max(_length(one - mean, creep.noise) for one in jumps) <= options.creep_sigmas
    scatter = max(_length(step, 2 * creep.frame) ** 2 / SIZE for step in steps)
    return replace(
        _begun(mean, frame / BUMP_FRAMES),
        frame=frame,
        recent=jumps,
        scatter=creep.scatter if agreed else max(creep.scatter, scatter),
        frames=BUMP_FRAMES,
        bumps=creep.bumps + int(agreed),
    )


def _length(vector: FloatArray, covariance: FloatArray) -> float:
    return float(np.sqrt(vector @ np.linalg.solve(covariance, vector)))
