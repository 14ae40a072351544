"""What the matches can tell at best (Cramer-Rao), with the lenses as well known as a prior says; by differences.

Unknowns: the pose (5, |t| = 1), both lenses (focal length, principal point, k1), each plane. A point on a plane leaves
the whole error of its transferred pixel, any other the one across its epipolar line.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .capture import Capture
from .lens import Array, Lens, Prior
from .rig import Rig, turn

FREE_LENS = Prior(0.3, 30.0, 0.1)
POSE, LENS = 5, 8
STEPS = np.array([1e-6] * POSE + [1e-6, 1e-3, 1e-3, 1e-6] * 2)
MOST_POINTS = 250
FEWEST_ON_A_PLANE = 20


@dataclass(frozen=True)
class Bound:
    """Standard deviations.

    Attributes
    ----------
    pose : (2,) degrees, of rotation and direction of t, with lenses as well known as their calibration says.
    lens : (2, 4) of the camera's and the projector's focal length (relative), principal point and k1, if all are free.
    against : by how many sigma the matches contradict the lenses that were handed in (root of the likelihood ratio).
    error : of the points themselves, measured with that pose, as a share of their distance.
    """

    pose: Array
    lens: Array
    against: float = 0.0
    error: float = np.inf


def bound(rig: Rig, captures: Sequence[Capture], prior: Prior, told: Rig | None = None) -> Bound:
    """For the right matches, at the truth; infinite where they do not determine the pose."""
    size = POSE + LENS
    total = np.zeros((size, size))
    for capture in captures:
        total += _information(rig, capture)
    free = _inverse(total + _prior(FREE_LENS))
    pose = _inverse(total + _prior(prior))
    parts = np.trace(pose[:3, :3]), np.trace(pose[3:5, 3:5])
    return Bound(
        np.degrees(np.sqrt(parts)),
        np.sqrt(np.diag(free)[POSE:]).reshape(2, 4),
        _against(rig, told or rig, total, prior),
        _error(rig, captures, pose[:POSE, :POSE]),
    )


def _error(rig: Rig, captures: Sequence[Capture], covariance: Array) -> float:
    """How far points lie from where they are, one sigma, RMS: a wrong pose moves them along the camera's rays."""
    if not np.isfinite(covariance).all():
        return np.inf
    length = np.linalg.norm(rig.t)
    rig = replace(rig, t=rig.t / length)
    points = np.concatenate([capture.points[capture.right] for capture in captures]) / length
    points = points[:: max(1, len(points) // MOST_POINTS)]
    x, y = points / points[:, 2:], rig.in_projector(points)
    values, vectors = np.linalg.eigh(covariance)
    total = np.zeros(len(points))
    for value, vector in zip(values, vectors.T, strict=True):
        moved = rig
        for k, part in enumerate(np.sqrt(max(value, 0.0)) * vector):
            moved = _changed(moved, k, part)
        across = np.cross(x @ moved.R.T, y)
        depth = -(across * np.cross(moved.t, y)).sum(axis=1) / (across**2).sum(axis=1)
        total += (depth / points[:, 2] - 1) ** 2
    return float(np.sqrt(total.mean()))


def _against(rig: Rig, told: Rig, total: Array, prior: Prior) -> float:
    """d^T (S^-1 + P)^-1 d, rooted: d is what the lenses are off, S what the matches tell of them, P the prior."""
    d = np.concatenate([_lens_off(getattr(told, name), getattr(rig, name)) for name in ("camera", "projector")])
    S = total[POSE:, POSE:] - total[POSE:, :POSE] @ np.linalg.pinv(total[:POSE, :POSE]) @ total[:POSE, POSE:]
    gain = S - S @ np.linalg.solve(S + _prior(prior)[POSE:, POSE:], S)
    return float(np.sqrt(max(0.0, d @ gain @ d)))


def _lens_off(told: Lens, true: Lens) -> Array:
    return np.array([np.log(told.focal[0] / true.focal[0]), *(told.centre - true.centre), told.bend[0] - true.bend[0]])


def _prior(prior: Prior) -> Array:
    lens = [prior.focal, prior.centre_px, prior.centre_px, prior.k1]
    return np.diag([0.0] * POSE + [1 / max(s, 1e-7) ** 2 for s in lens * 2])


def _inverse(information: Array) -> Array:
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    if not values[0] > 1e-12:
        return np.full_like(information, np.inf)
    return (vectors / values) @ vectors.T / np.outer(scale, scale)


def _changed(rig: Rig, k: int, step: float) -> Rig:
    """The rig with one unknown moved."""
    if k < 3:
        return replace(rig, R=turn(step * np.eye(3)[k]) @ rig.R)
    if k < POSE:
        across = np.linalg.svd(rig.t[None])[2][1:]
        return replace(rig, t=rig.t + step * across[k - 3])
    name, which = ("camera", "projector")[(k - POSE) // 4], (k - POSE) % 4
    lens = getattr(rig, name)
    new = [
        lens.other(zoom=float(np.exp(step))),
        lens.other(shift=(step, 0)),
        lens.other(shift=(0, step)),
        lens.other(k1=step),
    ][which]
    return replace(rig, **{name: new})


def _information(rig: Rig, capture: Capture) -> Array:
    """(13, 13) of one capture, its planes already taken out."""
    size = POSE + LENS
    rows = np.flatnonzero(capture.right)
    if len(rows) == 0:
        return np.zeros((size, size))
    length = np.linalg.norm(rig.t)
    rig = replace(rig, t=rig.t / length)
    weight = max(1.0, len(rows) / MOST_POINTS) / (capture.noise.sigma**2 + capture.noise.slow**2)
    rows = rows[:: max(1, round(len(rows) / MOST_POINTS))]
    points, labels, flat = capture.points[rows] / length, capture.labels[rows], capture.flat[rows]
    camera_px, projector_px = rig.camera.project(points), rig.projector.project(rig.in_projector(points))
    pieces, piece = np.unique(labels, return_inverse=True)
    enough = np.bincount(piece, minlength=len(pieces)) >= FEWEST_ON_A_PLANE * len(rows) / len(capture)
    flat = flat & enough[piece]
    total = np.zeros((size, size))
    if flat.any():
        normals = capture.normals[rows][flat]
        n = normals / (normals * points[flat]).sum(axis=1, keepdims=True)
        total += _plane_information(rig, camera_px[flat], n, piece[flat])
    if not flat.all():
        total += _free_information(rig, camera_px[~flat], projector_px[~flat])
    return total * weight


def _plane_information(rig: Rig, camera_px: Array, n: Array, piece: Array) -> Array:
    """Of points on planes n (N, 3), n . X = 1, each point with that of its piece; the planes taken out."""

    def transfer(rig: Rig, camera_px: Array, n: Array) -> Array:
        rays = rig.camera.rays(camera_px)
        return rig.projector.project(rig.in_projector(rays / (rays * n).sum(axis=1, keepdims=True)))

    by_rig = _slopes(rig, lambda changed: transfer(changed, camera_px, n))  # (13, N, 2)
    small = 1e-6 * np.linalg.norm(n, axis=1, keepdims=True)
    by_plane = [transfer(rig, camera_px, n + small * d) - transfer(rig, camera_px, n - small * d) for d in np.eye(3)]
    h = 1e-3
    by_pixel = [(transfer(rig, camera_px + d, n) - transfer(rig, camera_px - d, n)) / (2 * h) for d in h * np.eye(2)]
    whiten = np.linalg.inv(np.stack(by_pixel, axis=2))  # camera pixels per projector pixel, (N, 2, 2)
    J = np.einsum("nij,knj->kni", whiten, np.concatenate([by_rig, np.array(by_plane) / 2e-6]))
    J[:, ~np.isfinite(J).all(axis=(0, 2))] = 0
    m = len(by_rig)
    total = np.zeros((m, m))
    for one in np.unique(piece):
        mine = J[:, piece == one].reshape(len(J), -1)
        A = mine @ mine.T
        total += A[:m, :m] - A[:m, m:] @ np.linalg.pinv(A[m:, m:]) @ A[m:, :m]
    return total


def _free_information(rig: Rig, camera_px: Array, projector_px: Array) -> Array:
    def miss(rig: Rig, camera_px: Array) -> Array:
        x, y = rig.camera.rays(camera_px), rig.projector.rays(projector_px)
        return (y * np.cross(rig.t, x @ rig.R.T)).sum(axis=1)

    by_rig = _slopes(rig, lambda changed: miss(changed, camera_px))  # (13, N)
    h = 1e-3
    by_pixel = [(miss(rig, camera_px + d) - miss(rig, camera_px - d)) / (2 * h) for d in h * np.eye(2)]
    J = by_rig / np.hypot(*by_pixel)
    J = J[:, np.isfinite(J).all(axis=0)]
    return J @ J.T


def _slopes(rig: Rig, of: Callable[[Rig], Array]) -> Array:
    return np.stack([(of(_changed(rig, k, h)) - of(_changed(rig, k, -h))) / (2 * h) for k, h in enumerate(STEPS)])
