"""Rigid transforms: `target_from_source`, X_target = R X_source + t."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from retrue.errors import InputError
from retrue.geometry.arrays import FloatArray, finite_array, frozen_array
from retrue.shown import ShortRepr, Shown, vector
from retrue.values import ByValue

ROTATION_TOLERANCE = 1e-3  # |R R^T - I| that rounding in a hand-written or printed file explains


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class RigidTransform(ByValue, ShortRepr):
    """X_target = R X_source + t.

    Attributes
    ----------
    R : (3, 3) proper rotation. Rounding is removed on the way in (nearest rotation); a matrix further
        than 1e-3 from a rotation, or a reflection, is an `InputError`.
    t : (3,) translation, in the rig's unit.

    >>> turn = RigidTransform.from_rotation_vector([0, 0, np.pi / 2], [1.0, 0, 0])
    >>> (turn @ turn.inverse()).t.round(12).tolist()
    [0.0, 0.0, 0.0]
    >>> turn.apply([[2.0, 0, 0]]).round(12).tolist()
    [[1.0, 2.0, 0.0]]
    """

    R: FloatArray
    t: FloatArray

    def __post_init__(self) -> None:
        R = finite_array(self.R, (3, 3), "rotation R")
        t = finite_array(self.t, (3,), "translation t")
        error = float(np.abs(R @ R.T - np.eye(3)).max())
        if not error < ROTATION_TOLERANCE:
            raise InputError(f"rotation R: expected an orthonormal matrix, found R R^T off identity by {error:.2g}")
        if not R[0] @ _cross(R[1], R[2]) > 0:
            raise InputError("rotation R: expected determinant +1, found a reflection (-1)")
        object.__setattr__(self, "R", frozen_array(nearest_rotation(R) if error > 1e-14 else R))
        object.__setattr__(self, "t", frozen_array(t))

    @classmethod
    def identity(cls) -> RigidTransform:
        """Of a frame to itself.

        >>> RigidTransform.identity().apply([1.0, 2.0, 3.0]).tolist()
        [1.0, 2.0, 3.0]
        """
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_rotation_vector(cls, rotation_vector: ArrayLike, t: ArrayLike) -> RigidTransform:
        """From axis times angle (3,) in radians and t (3,)."""
        return cls(rotation_from_vector(rotation_vector), finite_array(t, (3,), "translation t"))

    def apply(self, points: ArrayLike) -> FloatArray:
        """Points (..., 3) of the source frame, in the target frame."""
        return np.asarray(points, dtype=np.float64) @ self.R.T + self.t

    def inverse(self) -> RigidTransform:
        """source_from_target."""
        return RigidTransform(self.R.T, -self.R.T @ self.t)

    def __matmul__(self, other: RigidTransform) -> RigidTransform:
        """a_from_b @ b_from_c is a_from_c."""
        return RigidTransform(self.R @ other.R, self.R @ other.t + self.t)

    def _shown(self) -> Shown:
        return f"rotation {vector(np.degrees(vector_from_rotation(self.R)))} deg, t {vector(self.t)}", {}


def nearest_rotation(matrix: FloatArray) -> FloatArray:
    """The proper rotation nearest to `matrix` (3, 3) in the Frobenius norm (Kabsch: by SVD, det +1)."""
    u, _, vt = np.linalg.svd(matrix)
    u[:, 2] *= np.sign(np.linalg.det(u @ vt))
    return u @ vt


def rotation_from_vector(rotation_vector: ArrayLike) -> FloatArray:
    """Rodrigues' formula: exp([w]x) for w (3,) in radians; exact to rounding for small angles too.

    >>> rotation_from_vector([0, 0, np.pi / 2]).round(12).tolist()
    [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """
    w = finite_array(rotation_vector, (3,), "rotation vector")
    angle = float(np.sqrt(w @ w))
    W = skew(w)
    sine = np.sinc(angle / np.pi)  # sin(a) / a
    versine = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2  # (1 - cos a) / a^2
    return np.eye(3) + sine * W + versine * (W @ W)


def vector_from_rotation(R: ArrayLike) -> FloatArray:
    """The rotation vector (3,) in radians, angle in [0, pi]; the inverse of `rotation_from_vector`.

    >>> vector_from_rotation(rotation_from_vector([0.1, -0.2, 3.0])).round(12).tolist()
    [0.1, -0.2, 3.0]
    """
    R = finite_array(R, (3, 3), "rotation R")
    if not np.abs(R @ R.T - np.eye(3)).max() < 1e-12:  # a tiny angle keeps its digits only untouched
        R = nearest_rotation(R)
    # Outer products of the quaternion (x, y, z, w), each a number of R: the longest row has no cancellation.
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()
    trace = a + e + i
    squares = [1 - trace + 2 * a, 1 - trace + 2 * e, 1 - trace + 2 * i, 1 + trace]
    row = np.array(
        [
            [squares[0], b + d, c + g, h - f],
            [d + b, squares[1], f + h, c - g],
            [g + c, h + f, squares[2], d - b],
            [h - f, c - g, d - b, squares[3]],
        ][squares.index(max(squares))]
    )
    x, w = (row[:3], row[3]) if row[3] >= 0 else (-row[:3], -row[3])
    sine = float(np.linalg.norm(x))
    return x * (2 * float(np.arctan2(sine, w)) / sine) if sine > 0 else np.zeros(3)


def skew(v: FloatArray) -> FloatArray:
    """[v]x (3, 3), so that [v]x y = v x y."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def rotation_angle(R: FloatArray) -> float:
    """Angle of a rotation in radians, accurate near 0 and near pi.

    >>> round(rotation_angle(rotation_from_vector([0, 1e-9, 0])) * 1e9, 6)
    1.0
    """
    sine = 0.5 * float(np.linalg.norm([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]))
    return float(np.arctan2(sine, 0.5 * (np.trace(R) - 1.0)))


def direction_angle(a: ArrayLike, b: ArrayLike) -> float:
    """Angle between two vectors in radians, accurate near 0 and near pi; NaN when one is zero.

    >>> round(float(np.degrees(direction_angle([1, 0, 0], [1, 1, 0]))), 9)
    45.0
    """
    v, w = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    if not (v.any() and w.any()):
        return float("nan")
    v, w = v / np.abs(v).max(), w / np.abs(w).max()  # so that no product under- or overflows
    return float(np.arctan2(np.linalg.norm(_cross(v, w)), v @ w))


def _cross(v: FloatArray, w: FloatArray) -> FloatArray:
    """`np.cross` of two vectors (3,), in a tenth of its time."""
    (a, b, c), (x, y, z) = v.tolist(), w.tolist()
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])
