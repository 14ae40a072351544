"""A rig that creeps: a filter over many frames finds what no single one can, and tells it from a bump.

Each frame k supports a pose of its own, by the rotation w_k (a vector) and the direction d_k of t away from the rig's.
The offset x = (w, d) wanders: x_k = x_(k-1) + q, y_k = x_k + r. For r stands how frames scatter from one to the next,
which is less than their sigma, for that has errors too that all of them share; for q the scatter / memory, so that the
filter's own sigma settles at scatter / sqrt(memory) (Kalman 1960, eq. 23-25, each part by itself). What the rig was off
from the beginning is no creep, nor is what another scene adds at once: only what is added since, little by little.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from retrue.geometry.arrays import FloatArray
from retrue.geometry.transform import RigidTransform, vector_from_rotation
from retrue.recalibration.result import Verification
from retrue.recalibration.streak import CreepOptions

LEAST_SCATTER = 0.02  # of a frame's sigma; pictures that are copies of each other scatter not at all


@dataclass(frozen=True, slots=True, eq=False)
class Creep:
    """What the filter knows; of pairs, the first is of the rotation, the second of the direction of t. Radians.

    Attributes
    ----------
    last : (6,) what the last frame said: rotation vector and direction of t from the rig's.
    frame_sigma : (2,) as it states it.
    offset : (6,) as the filter knows it, sigma : (2,) how well.
    scatter : (2,) variance of a frame beside the next.
    baseline, baseline_sigma : of the first frames; None while there are too few.
    frames : that went in, jumped : that did not, one after the other.
    rested : frames since the last attempt to recalibrate.
    """

    last: FloatArray
    frame_sigma: FloatArray
    offset: FloatArray
    sigma: FloatArray
    scatter: FloatArray
    baseline: FloatArray | None = None
    baseline_sigma: FloatArray | None = None
    frames: int = 1
    jumped: int = 0
    rested: int = 0

    @property
    def added(self) -> FloatArray:
        """(2,) creep since the baseline."""
        return np.zeros(2) if self.baseline is None else _lengths(self.offset - self.baseline)

    @property
    def sigmas(self) -> float:
        """The same in sigma, the larger of both."""
        if self.baseline_sigma is None:
            return 0.0
        return float(np.max(self.added / np.hypot(self.sigma, self.baseline_sigma)))

    @property
    def noise(self) -> FloatArray:
        """(2,) one standard deviation of a frame, shared errors left out; with them, while too few frames were seen."""
        if self.baseline is None:
            return self.frame_sigma
        return np.maximum(np.sqrt(self.scatter), LEAST_SCATTER * self.frame_sigma)


def after_frame(
    creep: Creep | None, rig_pose: RigidTransform, found: Verification, options: CreepOptions
) -> Creep | None:
    """With what one more frame says. One that cannot tell, or jumps, changes nothing; many that jump begin anew."""
    measured = _measured(rig_pose, found)
    if measured is None:
        return creep
    offset, sigma = measured
    memory = options.creep_memory
    if creep is None or creep.jumped >= memory:
        return Creep(offset, sigma, offset, sigma, np.zeros(2))
    if _jump(creep, offset) > options.creep_sigmas:
        return replace(creep, jumped=creep.jumped + 1)
    scatter = creep.scatter + (_lengths(offset - creep.last) ** 2 / 2 - creep.scatter) / min(creep.frames, memory)
    expected = creep.sigma**2 + (creep.noise / memory) ** 2
    gain = expected / (expected + creep.noise**2)
    after = replace(
        creep,
        last=offset,
        frame_sigma=sigma,
        offset=creep.offset + np.repeat(gain, 3) * (offset - creep.offset),
        sigma=np.sqrt((1 - gain) * expected),
        scatter=scatter,
        frames=creep.frames + 1,
        jumped=0,
        rested=creep.rested + 1,
    )
    if after.baseline is None and after.frames >= memory:
        settled = np.maximum(np.sqrt(scatter), LEAST_SCATTER * sigma) / np.sqrt(memory)
        return replace(after, baseline=after.offset, baseline_sigma=settled, sigma=settled)
    return after


def jump(creep: Creep | None, rig_pose: RigidTransform, found: Verification) -> float:
    """How far the frame is from the one before, in sigma of their difference; 0 where nobody knows.

    From the last that did not jump: after a bump all frames do, and after a hand before the lens none.
    """
    measured = _measured(rig_pose, found)
    if creep is None or measured is None:
        return 0.0
    return _jump(creep, measured[0])


def _jump(creep: Creep, offset: FloatArray) -> float:
    return float(np.max(_lengths(offset - creep.last) / (np.sqrt(2) * creep.noise)))


def creep_is_due(creep: Creep | None, options: CreepOptions) -> bool:
    """Whether the rig crept beyond doubt, and so far that a recalibration is worth it."""
    if creep is None or creep.rested < options.creep_memory or not creep.sigmas > options.creep_sigmas:
        return False
    return bool(np.max(creep.added / creep.frame_sigma) >= options.creep_share)


def _measured(rig_pose: RigidTransform, found: Verification) -> tuple[FloatArray, FloatArray] | None:
    """(6,) offset of the pose that the frame supports, and (2,) its sigma."""
    if found.supported_pose is None or found.sigma is None or found.verdict == "unknown":
        return None
    sigma = np.radians([found.sigma.rotation_deg, found.sigma.translation_deg])
    if not (np.isfinite(sigma).all() and (sigma > 0).all()):
        return None
    turn = vector_from_rotation(found.supported_pose.R @ rig_pose.R.T)
    directions = [pose.t / np.linalg.norm(pose.t) for pose in (found.supported_pose, rig_pose)]
    return np.concatenate([turn, directions[0] - directions[1]]), sigma


def _lengths(offset: FloatArray) -> FloatArray:
    return np.array([np.linalg.norm(offset[:3]), np.linalg.norm(offset[3:])], dtype=np.float64)
