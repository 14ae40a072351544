"""The two poses that a plane homography allows, in a form that breaks on no rig.

The paper sets t3 = 1 (see `paper_solver`), which fails on a rectified pair. The same
poses follow from the eigenvectors of H H^T without it, and orthonormal by construction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from retrue.errors import DegenerateError
from retrue.geometry.arrays import BoolArray, FloatArray, finite_array, frozen_array

SMALLEST_PARALLAX = 1e-9  # |t| / distance below which H is a rotation to rounding


@dataclass(frozen=True, slots=True, eq=False)
class PlanarPose:
    """H ~ R + translation_over_distance normal^T.

    Attributes
    ----------
    R : (3, 3) proper rotation, projector from camera.
    translation_over_distance : (3,) t / d; a homography does not give t itself.
    normal : (3,) unit normal of the plane in the camera frame, pointing away from the camera.
    """

    R: FloatArray
    translation_over_distance: FloatArray
    normal: FloatArray

    def __post_init__(self) -> None:
        for name in ("R", "translation_over_distance", "normal"):
            object.__setattr__(self, name, frozen_array(getattr(self, name)))

    @property
    def homography(self) -> FloatArray:
        """R + (t / d) normal^T, (3, 3)."""
        return self.R + np.outer(self.translation_over_distance, self.normal)


def planar_pose_candidates(
    homography: ArrayLike, viewing_ray: ArrayLike = (0.0, 0.0, 1.0)
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
    The two poses, twins of each other; they coincide when t is parallel to the normal (the fold).

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
    [[-0.95499, -0.263215, 0.136793], [0.36, 0.48, 0.8]]
    """
    H = finite_array(homography, (3, 3), "homography")
    x = finite_array(viewing_ray, (3,), "viewing ray")
    H = H / max(float(np.linalg.norm(H)), 1e-300)
    if not abs(float(np.linalg.det(H))) > 1e-14:
        raise DegenerateError("planar pose: the homography is singular; the points do not span a plane")
    U, singular, Vt = np.linalg.svd(H if H[2] @ x >= 0 else -H)
    # Roots of mu_i / mu_2: Q = U diag(ratio) Vt without ever forming H H^T, which would halve the digits.
    ratio = singular / singular[1]
    a, b = ratio[0] ** 2 - 1, 1 - ratio[2] ** 2
    if not np.sqrt(a + b) > SMALLEST_PARALLAX:
        raise DegenerateError("planar pose: the homography is a rotation (t = 0); the plane tells nothing about t")
    u1, u3 = np.sqrt(a / (a + b)) * U[:, 0], np.sqrt(b / (a + b)) * U[:, 2]
    Q, e2, r2 = (U * ratio) @ Vt, U[:, 1], Vt[1]
    return _pose(Q, u1 + u3, e2, r2, x), _pose(Q, u1 - u3, e2, r2, x)


def _pose(Q: FloatArray, u: FloatArray, e2: FloatArray, r2: FloatArray, x: FloatArray) -> PlanarPose:
    """The pose with t along u, or against it: whichever has the plane in front along x."""
    e3 = np.cross(u, e2)
    r3 = e3 @ Q
    r1 = np.cross(r2, r3)
    R = np.outer(u, r1) + np.outer(e2, r2) + np.outer(e3, r3)
    m = u @ Q - r1  # |t| n
    length = float(np.linalg.norm(m))
    sign = 1.0 if m @ x >= 0 else -1.0
    return PlanarPose(R, sign * length * u, sign * m / length)


def twin_pose(pose: PlanarPose, viewing_ray: ArrayLike = (0.0, 0.0, 1.0)) -> PlanarPose:
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
