"""A camera, a projector, and how they stand: rotations by quaternions, and how far one pose is from another."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

import retrue

from .lens import Array, Generator, Lens, random_camera, random_projector


@dataclass(frozen=True)
class Rig:
    """X_projector = R X_camera + t."""

    camera: Lens
    projector: Lens
    R: Array
    t: Array

    @property
    def place(self) -> Array:
        """Where the projector stands in the camera's frame."""
        return -self.R.T @ self.t

    def in_projector(self, points: Array) -> Array:
        return points @ self.R.T + self.t

    def public(self, evidence: dict[str, object] | None = None) -> retrue.Rig:
        pose = retrue.RigidTransform(self.R, self.t)
        return retrue.Rig(self.camera.public(), self.projector.public(), pose, "mm", evidence or {})


def turn(vector: Array) -> Array:
    """The rotation (3, 3) by |vector| radians about it, by way of its quaternion."""
    vector = np.asarray(vector, dtype=float)
    angle = float(np.sqrt(vector @ vector))
    w, v = np.cos(angle / 2), vector * (0.5 * np.sinc(angle / (2 * np.pi)))
    x, y, z = v
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return (w * w - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * w * cross


def turn_vector(R: Array) -> Array:
    """The inverse of `turn`: the quaternion is the main eigenvector of Bar-Itzhack's matrix."""
    S = np.empty((4, 4))
    S[0, 0] = np.trace(R)
    S[0, 1:] = S[1:, 0] = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    S[1:, 1:] = R + R.T - np.trace(R) * np.eye(3)
    q = np.linalg.eigh(S)[1][:, 3]
    q = q * (1 if q[0] >= 0 else -1)
    sine = float(np.linalg.norm(q[1:]))
    return q[1:] * (2 * np.arctan2(sine, q[0]) / sine if sine > 0 else 0.0)


def angle_between(a: Array, b: Array) -> float:
    """In radians."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    return float(2 * np.arctan2(np.linalg.norm(a - b), np.linalg.norm(a + b)))


def random_direction(rng: Generator) -> Array:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def tilted(rng: Generator, direction: Array, angle: float) -> Array:
    """That direction, turned by `angle` about any axis across it."""
    axis = np.cross(direction, random_direction(rng))
    return turn(axis / np.linalg.norm(axis) * angle) @ direction


def looking_at(rng: Generator, lens: Lens, place: Array, target: Array, roll: float) -> Array:
    """R of a device at `place` whose picture's middle falls on `target`, rolled about that line."""
    middle = lens.rays((np.array([lens.size]) - 1) / 2)[0]
    down = np.array([0.0, 1.0, 0.0])
    device, world = (_frame(z, down) for z in (middle, target - place))
    return device.T @ turn(np.array([0, 0, roll])) @ world


def _frame(z: Array, down: Array) -> Array:
    """Rows x, y, z with z along the first vector and y near the second."""
    z = z / np.linalg.norm(z)
    x = np.cross(down, z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def random_rig(rng: Generator, distance: float, along: float | None = None) -> Rig:
    """Baseline 0.1 to 0.6 of the distance in any direction; toed in to the scene, or rectified.

    `along` keeps the baseline within that angle of the camera's axis, forward or backward.
    """
    camera, projector = random_camera(rng), random_projector(rng)
    length = distance * rng.uniform(0.1, 0.6)
    style = rng.random()
    if along is None and style < 0.15:  # rectified: the same axes, side by side or one above the other
        axis = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]][rng.integers(4)])
        return Rig(camera, projector, np.eye(3), -axis * distance * rng.uniform(0.1, 0.35))
    if along is not None:
        direction = tilted(rng, np.array([0, 0, rng.choice([-1.0, 1.0])]), rng.uniform(0, along))
    elif style < 0.6:  # beside the camera, as most rigs are
        direction = random_direction(rng) * [1, 1, 0.3]
    else:
        direction = random_direction(rng)
    place = length * direction / np.linalg.norm(direction)
    target = distance * np.array([*rng.uniform(-0.04, 0.04, 2), 1])
    roll = rng.normal(0, 0.15) + np.pi * (rng.random() < 0.1)
    R = looking_at(rng, projector, place, target, roll)
    return Rig(camera, projector, R, -R @ place)


def moved(rng: Generator, rig: Rig, rotation: float, translation: float, keep_length: bool = True) -> Rig:
    """Turned by `rotation` and its t by `translation`, degrees, about any axes; |t| up to 1.3 times off if not kept."""
    R = turn(np.radians(rotation) * random_direction(rng)) @ rig.R
    t = np.linalg.norm(rig.t) * tilted(rng, rig.t / np.linalg.norm(rig.t), np.radians(translation))
    return replace(rig, R=R, t=t * (1.0 if keep_length else np.exp(rng.uniform(-0.26, 0.26))))


def pose_error(R: Array, t: Array, true: Rig) -> Array:
    """(5,) rotation vector in the projector's frame, and t's angle along two directions across the found t.

    The directions: t x (the axis that t has least of), made a unit vector, and t x that.
    """
    t = t / np.linalg.norm(t)
    first = np.cross(t, np.eye(3)[np.abs(t).argmin()])
    first /= np.linalg.norm(first)
    across = np.stack([first, np.cross(t, first)]) @ (true.t / np.linalg.norm(true.t))
    length = np.linalg.norm(across)
    if length > 0:
        across = across * (angle_between(t, true.t) / length)
    return np.concatenate([turn_vector(true.R @ R.T), across])
