"""Older solvers that ours is compared with, written from their papers and not from our own code."""

from __future__ import annotations

import numpy as np

from retrue.geometry.arrays import FloatArray
from retrue.geometry.transform import skew


def longuet_higgins_poses(H: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """(R, t / d) of a plane from the eigenvectors of H^T H.

    With H scaled to middle singular value 1, two directions in the plane keep their length:
    u = (sqrt(1 - s3^2) v1 +- sqrt(s1^2 - 1) v3) / sqrt(s1^2 - s3^2). R takes (v2, u, v2 x u) to their images.

    Source: H. C. Longuet-Higgins, "The reconstruction of a plane surface from two perspective projections", 1986.

    >>> H = np.eye(3) + np.outer([0.3, 0.1, 0.0], [0.0, 0.6, 0.8])
    >>> min(float(np.abs(R - np.eye(3)).max()) for R, _ in longuet_higgins_poses(-2 * H)) < 1e-14
    True
    """
    H = H if np.linalg.det(H) > 0 else -H
    values, V = np.linalg.eigh(H.T @ H)
    H, values = H / np.sqrt(values[1]), values / values[1]
    V = V * np.linalg.det(V)
    v3, v2, v1 = V.T
    span = values[2] - values[0]
    p, q = np.sqrt(max(1 - values[0], 0) / span), np.sqrt(max(values[2] - 1, 0) / span)
    poses: list[tuple[FloatArray, FloatArray]] = []
    for u in (p * v1 + q * v3, p * v1 - q * v3):
        before = np.stack([v2, u, np.cross(v2, u)], axis=1)
        after = np.stack([H @ v2, H @ u, np.cross(H @ v2, H @ u)], axis=1)
        R = after @ before.T
        poses.append((R, (H - R) @ np.cross(v2, u)))
    return poses


def eight_point_poses(x: FloatArray, y: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """(R, t) of points in general position, |t| = 1: Hartley's normalised eight-point algorithm, on rays (N, 2)."""
    frames: list[FloatArray] = []
    for points in (x, y):
        centre = points.mean(axis=0)
        scale = np.sqrt(2) / np.hypot(*(points - centre).T).mean()
        frames.append(np.array([[scale, 0, -scale * centre[0]], [0, scale, -scale * centre[1]], [0, 0, 1]]))
    a, b = (np.c_[points, np.ones(len(points))] @ frame.T for points, frame in zip((x, y), frames, strict=True))
    design = (b[:, :, None] * a[:, None, :]).reshape(len(x), 9)
    E = frames[1].T @ np.linalg.svd(design)[2][8].reshape(3, 3) @ frames[0]
    U, _, Vt = np.linalg.svd(E)
    U, Vt = U * np.linalg.det(U), Vt * np.linalg.det(Vt)
    W = -skew(np.array([0.0, 0.0, 1.0])) + np.diag([0.0, 0.0, 1.0])
    return [(U @ turn @ Vt, sign * U[:, 2]) for turn in (W, W.T) for sign in (1.0, -1.0)]
