"""The two poses that a plane homography allows, in a form that breaks on no rig.

The paper sets t3 = 1 (see `paper_solver`), which fails on a rectified pair. The same
poses follow from the eigenvectors of H H^T without it, and orthonormal by construction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from retrue.errors import DegenerateError
from retrue.geometry.arrays import BoolArray, FloatArray, array_of, finite_array
from retrue.geometry.transform import vector_from_rotation
from retrue.kernels import planar_pose as kernel
from retrue.shown import ShortRepr, Shown, counted, vector
from retrue.values import ByValue

SMALLEST_PARALLAX = 1e-9  # |t| / distance below which H is a rotation to rounding
SMALLEST_DETERMINANT = 1e-14  # of an H of norm 1
AHEAD = 0.0, 0.0, 1.0
OPTICAL_AXIS = np.array(AHEAD)
OPTICAL_AXIS.setflags(write=False)
_new = object.__new__


class PlanarPose(ShortRepr):
    """H ~ R + translation_over_distance normal^T; read-only.

    Attributes
    ----------
    R : (3, 3) proper rotation, projector from camera.
    translation_over_distance : (3,) t / d; a homography does not give t itself.
    normal : (3,) unit normal of the plane in the camera frame, pointing away from the camera.
    """

    __slots__ = ("_first", "_rows")
    _rows: FloatArray  # (..., 3) R, t / d, normal, one below the other; its twin's too where both were solved together
    _first: int

    def __init__(self, R: ArrayLike, translation_over_distance: ArrayLike, normal: ArrayLike) -> None:
        self._rows, self._first = np.empty((5, 3)), 0
        self._rows[:3], self._rows[3], self._rows[4] = R, translation_over_distance, normal
        self._rows.setflags(write=False)

    def _shown(self) -> Shown:
        rotation = vector(np.degrees(vector_from_rotation(self.R)))
        return (
            f"rotation {rotation} deg, t / d {vector(self.translation_over_distance)}, normal {vector(self.normal)}",
            {},
        )

    @property
    def R(self) -> FloatArray:
        return self._rows[self._first : self._first + 3]

    @property
    def translation_over_distance(self) -> FloatArray:
        return self._rows[self._first + 3]

    @property
    def normal(self) -> FloatArray:
        return self._rows[self._first + 4]

    @property
    def homography(self) -> FloatArray:
        """R + (t / d) normal^T, (3, 3)."""
        return self.R + np.outer(self.translation_over_distance, self.normal)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PlanarPoses(ByValue, ShortRepr):
    """Both poses of each of N homographies; see `PlanarPose`. NaN where a homography gives none.

    Attributes
    ----------
    R : (N, 2, 3, 3).
    translation_over_distance, normal : (N, 2, 3).
    """

    R: FloatArray
    translation_over_distance: FloatArray
    normal: FloatArray

    def __len__(self) -> int:
        return len(self.R)

    def _shown(self) -> Shown:
        without = int(np.isnan(self.R[:, 0, 0, 0]).sum())
        return f"{counted(len(self), 'pair')}{f', {without} of NaN' if without else ''}", {}


def planar_pose_candidates(
    homography: ArrayLike, viewing_ray: ArrayLike = OPTICAL_AXIS
) -> tuple[PlanarPose, PlanarPose]:
    """Both poses of a camera-projector pair that see one plane, from its homography.

    With H H^T = sum mu_i v_i v_i^T (mu1 >= mu2 >= mu3), mu2 is 1 / lambda^2 (Prop. 2). Q = H / sqrt(mu2),
    a = mu1 / mu2 - 1, b = 1 - mu3 / mu2, u = (sqrt(a) v1 +- sqrt(b) v3) / sqrt(a + b) is the direction of t, and
    R is the rotation that takes Q^T v2 to v2 and Q^T (u x v2) to u x v2.

    Parameters
    ----------
    homography : (3, 3) projector_from_camera on normalised rays, any scale and sign.
    viewing_ray : (3,) a ray of the camera that meets the plane in front, to orient the normal. Poses with
        other signs of (t, n) have the plane behind the camera. The sign of H is taken so that the projector has
        that point in front too; for points away from the optical axis, give their mean ray.

    Returns
    -------
    The two poses, twins of each other, first the one whose plane faces the viewing ray more squarely; they
    coincide when t is parallel to the normal (the fold).

    Raises
    ------
    InputError : not a finite (3, 3).
    DegenerateError : singular H, or t = 0 (H is a rotation: the plane tells nothing).

    Source: Zhang, Li, Wu 2007, Prop. 2 and eqs (17) to (24); Tsai, Huang, Zhu 1982.

    >>> from retrue.geometry.transform import rotation_from_vector
    >>> R, t_over_d, normal = rotation_from_vector([0.1, -0.3, 0.05]), [0.4, 0.1, 0.0], np.array([0.36, 0.48, 0.8])
    >>> poses = planar_pose_candidates(-7 * (R + np.outer(t_over_d, normal)))
    >>> min(float(np.abs(pose.R - R).max()) for pose in poses) < 1e-14
    True
    >>> [pose.normal.round(6).tolist() for pose in poses]
    [[0.36, 0.48, 0.8], [-0.95499, -0.263215, 0.136793]]
    """
    x, y, z = AHEAD if viewing_ray is OPTICAL_AXIS else finite_array(viewing_ray, (3,), "viewing ray").tolist()
    rows = np.empty((10, 3))
    try:
        solved = kernel.planar_poses(homography, x, y, z, rows)
    except (TypeError, ValueError):  # not a float64 array in C order
        solved = False
    if not solved:
        H = np.ascontiguousarray(finite_array(homography, (3, 3), "homography"))
        rows = _rows_of_stack(H[None], np.array([x, y, z]))[0]
        if np.isnan(rows[0, 0]):
            raise DegenerateError(_hopeless(H))
    rows.setflags(write=False)
    first, second = _new(PlanarPose), _new(PlanarPose)
    first._rows = second._rows = rows  # pyright: ignore[reportPrivateUsage]
    first._first, second._first = 0, 5  # pyright: ignore[reportPrivateUsage]
    return first, second


def planar_pose_candidates_batch(homographies: ArrayLike, viewing_ray: ArrayLike = OPTICAL_AXIS) -> PlanarPoses:
    """`planar_pose_candidates` of many homographies (N, 3, 3) at once.

    A homography that is singular, a rotation or not finite leaves NaN, not an error.

    >>> poses = planar_pose_candidates_batch([np.diag([1.2, 1.0, 0.9]), np.eye(3)])
    >>> np.abs(poses.normal[:, 0]).round(6).tolist()
    [[0.835711, 0.0, 0.54917], [nan, nan, nan]]
    """
    stack = np.ascontiguousarray(array_of(homographies, (None, 3, 3), "homographies"))
    x = finite_array(viewing_ray, (3,), "viewing ray")
    rows = _rows_of_stack(stack, x).reshape(-1, 2, 5, 3)
    return PlanarPoses(rows[:, :, :3], rows[:, :, 3], rows[:, :, 4])


def _rows_of_stack(stack: FloatArray, x: FloatArray) -> FloatArray:
    """(N, 10, 3): R, t / d, normal of both poses of each; NaN where there are none."""
    rows = np.empty((len(stack), 10, 3))
    if not kernel.planar_poses_of_stack(stack, x[0], x[1], x[2], rows.reshape(-1, 3)):
        doubtful = np.isnan(rows[:, 0, 0])
        rows[doubtful] = _rows_by_singular_values(stack[doubtful], x)
    return rows


def _rows_by_singular_values(stack: FloatArray, x: FloatArray) -> FloatArray:
    """The same where forming H H^T would cost too many digits."""
    with np.errstate(all="ignore"):
        H = stack / np.linalg.norm(stack, axis=(1, 2), keepdims=True)
        good = np.abs(np.linalg.det(H)) > SMALLEST_DETERMINANT
    H = np.where(good[:, None, None], H, np.eye(3))
    H = H * np.where(H[:, 2] @ x >= 0, 1.0, -1.0)[:, None, None]
    U, singular, Vt = np.linalg.svd(H)
    # Roots of mu_i / mu_2: Q = U diag(ratio) Vt without ever forming H H^T, which would halve the digits.
    ratio = singular / singular[:, 1:2]
    Q = (U * ratio[:, None, :]) @ Vt
    a, b = ratio[:, 0] ** 2 - 1, 1 - ratio[:, 2] ** 2
    good &= np.sqrt(a + b) > SMALLEST_PARALLAX
    total = np.where(good, a + b, 1.0)
    u1, u3 = np.sqrt(a / total)[:, None] * U[:, :, 0], np.sqrt(b / total)[:, None] * U[:, :, 2]
    e2, r2 = U[:, :, 1], Vt[:, 1]
    rows = np.full((len(stack), 10, 3), np.nan)
    for first, u in ((0, u1 + u3), (5, u1 - u3)):
        e3 = _cross(u, e2)
        r3 = (e3[:, None] @ Q)[:, 0]
        r1 = _cross(r2, r3)
        m = (u[:, None] @ Q)[:, 0] - r1  # |t| n
        length: FloatArray = np.linalg.norm(m, axis=1, keepdims=True)
        length = np.where((m @ x)[:, None] >= 0, length, -length)  # the plane is in front along x
        frames = np.stack([u, e2, e3], axis=2) @ np.stack([r1, r2, r3], axis=1)
        with np.errstate(all="ignore"):
            normal: FloatArray = m / length
        rows[good, first : first + 3], rows[good, first + 3], rows[good, first + 4] = (
            frames[good],
            (length * u)[good],
            normal[good],
        )
    turned_away = rows[:, 4] @ x < rows[:, 9] @ x
    rows[turned_away] = np.roll(rows[turned_away], 5, axis=1)
    return rows


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross products of (N, 3) arrays; np.cross takes several times as long."""
    return a[:, [1, 2, 0]] * b[:, [2, 0, 1]] - a[:, [2, 0, 1]] * b[:, [1, 2, 0]]


def _hopeless(H: FloatArray) -> str:
    if not abs(float(np.linalg.det(H / max(float(np.linalg.norm(H)), 1e-300)))) > SMALLEST_DETERMINANT:
        return "planar pose: the homography is singular; the points do not span a plane"
    return "planar pose: the homography is a rotation (t = 0); the plane tells nothing about t"


def twin_pose(pose: PlanarPose, viewing_ray: ArrayLike = OPTICAL_AXIS) -> PlanarPose:
    """The other pose with the same homography, in closed form: t' ~ R n + |n|^2 / 2 t, n' ~ R^T t + |t|^2 / 2 n.

    Shapes and `viewing_ray` as in `planar_pose_candidates`. Raises DegenerateError where t = 0. Source: eqs (23),
    (24); Longuet-Higgins 1986.

    >>> first, second = planar_pose_candidates(np.diag([1.2, 1.0, 0.9]) + np.outer([0.3, 0.1, 0], [0.1, 0.2, 1]))
    >>> float(np.abs(twin_pose(first).R - second.R).max()) < 1e-13
    True
    """
    x = finite_array(viewing_ray, (3,), "viewing ray")
    t, normal = pose.translation_over_distance, pose.normal
    length = float(np.linalg.norm(t))
    if not length > SMALLEST_PARALLAX:
        raise DegenerateError("twin pose: t = 0; the plane tells nothing about t")
    direction = pose.R @ normal + t / 2
    twin_normal = pose.R.T @ t + length**2 / 2 * normal
    direction = direction / np.linalg.norm(direction)
    twin_normal = twin_normal / np.linalg.norm(twin_normal)
    R = pose.homography - length * np.outer(direction, twin_normal)
    sign = 1.0 if twin_normal @ x >= 0 else -1.0
    return PlanarPose(R, sign * length * direction, sign * twin_normal)


def in_front(pose: PlanarPose, camera_rays: ArrayLike) -> BoolArray:
    """Cheirality (N,): which camera rays (N, 2) meet the plane in front of the camera and of the projector.

    >>> pose = PlanarPose(np.eye(3), [0.1, 0, 0], [0, 0.6, 0.8])
    >>> in_front(pose, [[0.0, 0.0], [0.0, -2.0]]).tolist()
    [True, False]
    """
    rays = finite_array(camera_rays, (None, 2), "camera rays")
    on_plane = rays @ pose.normal[:2] + pose.normal[2]  # distance / depth, in the camera
    in_projector = rays @ pose.homography[2, :2] + pose.homography[2, 2]  # projector depth / camera depth
    return (on_plane > 0) & (in_projector > 0)
