"""The paper's own steps from a homography to the pose, as written: the reference that ours is compared with.

For use on a rig, take `planar_pose_candidates`: this one sets t3 = 1, so it has no answer for a rectified pair
and the wrong sign for t3 < 0, and it never reads the third column of C, so mirrored poses pass.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from retrue.errors import DegenerateError
from retrue.geometry.arrays import FloatArray, finite_array
from retrue.geometry.planar_pose import PlanarPose
from retrue.geometry.transform import nearest_rotation, skew


def paper_pose_candidates(homography: ArrayLike) -> tuple[PlanarPose, ...]:
    """Up to four poses with t3 > 0: two directions of t, eqs (22) to (25), two rotations each, eqs (26), (27).

    Parameters
    ----------
    homography : (3, 3) projector_from_camera on normalised rays, any scale and sign.

    Returns
    -------
    Poses whose rotation is proper. Not all reproduce the homography, nor have the plane in front: the paper
    leaves that to cheirality (`in_front`). Empty where t3 = 0.

    Raises InputError for what is no finite (3, 3), DegenerateError for a singular one. Source: Zhang, Li, Wu 2007.

    >>> R, t, n = np.eye(3), np.array([0.4, 0.2, 0.1]), np.array([0.0, 0.6, 0.8])
    >>> poses = paper_pose_candidates(R + np.outer(t, n))
    >>> len(poses), min(float(np.abs(pose.R - R).max()) for pose in poses) < 1e-7
    (4, True)
    """
    H = finite_array(homography, (3, 3), "homography")
    determinant = float(np.linalg.det(H / max(float(np.linalg.norm(H)), 1e-300)))
    if not abs(determinant) > 1e-14:
        raise DegenerateError("planar pose: the homography is singular; the points do not span a plane")
    H = H if H[2, 2] >= 0 else -H
    middle = np.linalg.eigvalsh(H @ H.T)[1]  # 1 / lambda^2, Prop. 2
    H = H / float(np.sqrt(middle))
    return tuple(_pose(H, R, t) for t in _translations(H @ H.T - np.eye(3)) for R in _rotations(skew(t) @ H, t))


def _translations(W: FloatArray) -> list[FloatArray]:
    """t = (t1, t2, 1): the first two equations of (25) in closed form, the third picks the signs."""
    with np.errstate(all="ignore"):
        roots1, roots2 = (
            (W[i, 2] + np.array([1.0, -1.0]) * np.sqrt(max(W[i, 2] ** 2 - W[i, i] * W[2, 2], 0.0))) / W[2, 2]
            for i in (0, 1)
        )
    if not np.isfinite([roots1, roots2]).all():
        return []
    found: list[FloatArray] = []
    for t1 in roots1:
        misfit = np.abs(W[2, 2] * t1 * roots2 - W[1, 2] * t1 - W[0, 2] * roots2 + W[0, 1])
        found.append(np.array([t1, roots2[np.argmin(misfit)], 1.0]))
    return found


def _rotations(C: FloatArray, t: FloatArray) -> list[FloatArray]:
    """Columns r_i of unit length with t x r_i = c_i; the third is the cross product of the first two."""
    square = float(t @ t)
    base = [np.cross(C[:, i], t) / square for i in (0, 1)]
    along = [float(np.sqrt(max(1 - float(r @ r), 0.0) / square)) for r in base]
    # r1 . r2 = 0 fixes the sign of one component along t relative to the other.
    relative = -1.0 if base[0] @ base[1] > 0 else 1.0
    rotations: list[FloatArray] = []
    for sign in (1.0, -1.0):
        r1, r2 = base[0] + sign * along[0] * t, base[1] + sign * relative * along[1] * t
        rotations.append(nearest_rotation(np.stack([r1, r2, np.cross(r1, r2)], axis=1)))
    return rotations


def _pose(H: FloatArray, R: FloatArray, t: FloatArray) -> PlanarPose:
    n = t @ (H - R) / (t @ t)  # eq. (28)
    length = float(np.linalg.norm(n))
    return PlanarPose(R, t * length, n / length if length > 0 else n)
