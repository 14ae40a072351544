"""How the pose moved and how well it is known, axis by axis: points tell some of them far better than others.

Of a pair of cameras side by side the rotation about the baseline moves every point up or down, across its epipolar
line, and is known best. Turning about the line of sight shears the rows. Turning the cameras towards each other moves
points along their lines: all but the lens's bend of it passes for depth, so that it is known worst, and errors of it
come with errors of t towards the scene.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.geometry.arrays import FloatArray
from retrue.geometry.transform import RigidTransform, vector_from_rotation
from retrue.geometry.two_view import tangent_basis
from retrue.recalibration.result import Evidence, Verification

NAMES = (
    "rotation about the baseline",
    "rotation about the line of sight",
    "rotation towards each other",
    "direction of t across the line of sight",
    "direction of t towards the scene",
)
SIDEWAYS = 0.1  # sine of the angle between baseline and line of sight, below which no plane holds both


@dataclass(frozen=True, slots=True)
class AxisMove:
    """By how much the pose moved about one axis, and one standard deviation of where it now is; degrees."""

    name: str
    moved_deg: float
    sigma_deg: float


def axes_of(old: RigidTransform, evidence: Evidence) -> tuple[AxisMove, ...]:
    """The move from the old pose to what the captures support, on five axes; empty where they support none.

    The axes are the old t (in the projector's frame, or the second camera's), its line of sight made normal to that,
    and what is normal to both; t turns towards the latter two.

    >>> found = Evidence(9, details={"covariance": np.eye(5).tolist()})
    >>> axes_of(RigidTransform(np.eye(3), [-1.0, 0, 0]), found)
    ()
    """
    new, covariance = evidence.pose, evidence.details.get("covariance")
    if new is None or covariance is None:
        return ()
    return axes_between(old, new, np.asarray(covariance, dtype=np.float64))


def axes_of_verification(old: RigidTransform, found: Verification) -> tuple[AxisMove, ...]:
    """The same of a verification: from the rig's pose to that which the capture supports."""
    if found.supported_pose is None or found.covariance is None:
        return ()
    return axes_between(old, found.supported_pose, found.covariance)


def axes_between(old: RigidTransform, new: RigidTransform, covariance: FloatArray) -> tuple[AxisMove, ...]:
    """The same of two poses, the second with that covariance (5, 5).

    >>> old, new = (RigidTransform.from_rotation_vector([0, turn, 0], [-1.0, 0, 0]) for turn in (0.0, 0.01))
    >>> moves = axes_between(old, new, np.eye(5) * 1e-6)
    >>> moves[2].name, round(abs(moves[2].moved_deg), 3), round(moves[2].sigma_deg, 3)
    ('rotation towards each other', 0.573, 0.057)
    """
    baseline, sight, normal = pose_frame(old.t)
    turn = vector_from_rotation(new.R @ old.R.T)
    unit = new.t / np.linalg.norm(new.t)
    tangent = tangent_basis(unit)
    rows = np.zeros((5, 5))
    rows[:3, :3] = baseline, sight, normal
    rows[3:, 3:] = np.stack([normal, sight]) @ tangent
    moved = np.concatenate([rows[:3, :3] @ turn, np.stack([normal, sight]) @ (unit - baseline)])
    variance = np.einsum("ij,jk,ik->i", rows, covariance, rows)
    sigma = np.degrees(np.sqrt(np.maximum(variance, 0.0)))
    degrees = np.degrees(moved)
    return tuple(AxisMove(*one) for one in zip(NAMES, degrees.tolist(), sigma.tolist(), strict=True))


def axes_of_offsets(t: FloatArray) -> FloatArray:
    """(5, 5) from an offset as `creep` has it, a rotation vector and the direction of t in the tangent of t, to these.

    >>> axes_of_offsets(np.array([-2.0, 0, 0])).round(3)[:3, :3].tolist()
    [[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]
    """
    baseline, sight, normal = pose_frame(t)
    rows = np.zeros((5, 5))
    rows[:3, :3] = baseline, sight, normal
    rows[3:, 3:] = np.stack([normal, sight]) @ tangent_basis(baseline)
    return rows


def pose_frame(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Unit vectors: along t, along the line of sight as far as that is normal to t, and normal to both."""
    baseline = t / np.linalg.norm(t)
    sight = np.array([0.0, 0.0, 1.0])
    if not np.linalg.norm(np.cross(baseline, sight)) > SIDEWAYS:
        sight = np.array([0.0, 1.0, 0.0])
    sight = sight - (sight @ baseline) * baseline
    sight /= np.linalg.norm(sight)
    return baseline, sight, np.cross(sight, baseline)
