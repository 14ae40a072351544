"""By how many sigma exact matches contradict the lenses handed in, at whatever pose explains them best through those.

`bound` tells it to first order about the truth. A lens that is far off draws the pose with it, and points that seem to
contradict it are explained as well from degrees away: a case is owed an answer only where no pose explains them. Nor
do a few contradict it by however much: any match may be wrong.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from .bound import FEWEST_ON_A_PLANE, MOST_POINTS, POSE
from .capture import Capture
from .lens import Array, Lens, Prior
from .rig import Rig, turn

EVALUATIONS = 60
MOST_TOLD = 12.0  # of chi-square, by any one match
BEHIND = 0.02  # of the points: a pose that has more of them behind a device explains nothing
PIXEL = 1e-3


@dataclass(frozen=True)
class Matches:
    """Exact right matches of one capture, each of which `stands` for some; their piece of the scene, -1 off planes."""

    camera_px: Array
    projector_px: Array
    piece: Array
    stands: float
    sigma: float

    @classmethod
    def of(cls, rig: Rig, capture: Capture) -> Matches:
        rows = np.flatnonzero(capture.right)
        every = max(1, round(len(rows) / MOST_POINTS))
        rows = rows[::every]
        points = capture.points[rows]
        names, piece = np.unique(capture.labels[rows], return_inverse=True)
        enough = np.bincount(piece, minlength=len(names)) >= FEWEST_ON_A_PLANE * len(rows) / len(capture)
        piece = np.where(capture.flat[rows] & enough[piece], piece, -1)
        pixels = rig.camera.project(points), rig.projector.project(rig.in_projector(points))
        seen = np.isfinite(pixels[0]).all(axis=1) & np.isfinite(pixels[1]).all(axis=1)
        piece = np.unique(piece[seen], return_inverse=True)[1] - int((piece[seen] < 0).any())
        return cls(
            pixels[0][seen], pixels[1][seen], piece, every, float(np.hypot(capture.noise.sigma, capture.noise.slow))
        )


def contradiction(truth: Rig, told: Rig, captures: Sequence[Capture], prior: Prior, poses: Sequence[Rig]) -> float:
    """Root of the least chi-square from the truth and from those other poses; the truth explains all, at zero."""
    seen = [Matches.of(truth, capture) for capture in captures]
    lens = np.array([prior.focal, prior.centre_px, prior.centre_px, prior.k1] * 2)
    sigma = np.maximum(lens, [1e-6, 1e-4, 1e-4, 1e-7] * 2)
    least = np.inf
    for pose in (truth, *poses):
        start = replace(told, R=pose.R, t=pose.t / np.linalg.norm(pose.t))
        planes = [_planes(start, matches) for matches in seen]
        sizes = np.cumsum([POSE + len(sigma), *(one.size for one in planes)])

        def misses(x: Array, start: Rig = start, planes: list[Array] = planes, sizes: Array = sizes) -> list[Array]:
            rig, found = _moved(start, x[:POSE], x[POSE : sizes[0]] * sigma), list[Array]()
            for k, matches in enumerate(seen):
                step = x[sizes[k] : sizes[k + 1]].reshape(planes[k].shape)
                n = planes[k] + step * np.linalg.norm(planes[k], axis=1, keepdims=True)
                found.append(np.nan_to_num(_misses(rig, matches, n) / matches.sigma, nan=1e3))
            return found

        def weighed(x: Array, misses: Callable[[Array], list[Array]] = misses, sizes: Array = sizes) -> Array:
            """Residuals whose squares saturate."""
            found = [x[POSE : sizes[0]]]
            for matches, missed in zip(seen, misses(x), strict=True):
                squares = (missed**2).sum(axis=1, keepdims=True)
                found.append((missed * np.sqrt(matches.stands * MOST_TOLD / (MOST_TOLD + squares))).ravel())
            return np.concatenate(found)

        best = least_squares(weighed, np.zeros(sizes[-1]), x_scale="jac", max_nfev=EVALUATIONS)
        rig = _moved(start, best.x[:POSE], best.x[POSE : sizes[0]] * sigma)
        if max(_behind(rig, matches) for matches in seen) <= BEHIND:
            least = min(least, 2 * best.cost)
    return float(np.sqrt(least))


def _moved(rig: Rig, pose: Array, lens: Array) -> Rig:
    across = np.linalg.svd(rig.t[None])[2][1:]
    t = rig.t + pose[3:] @ across
    camera, projector = _changed(rig.camera, lens[:4]), _changed(rig.projector, lens[4:])
    return Rig(camera, projector, turn(pose[:3]) @ rig.R, t / np.linalg.norm(t))


def _changed(lens: Lens, by: Array) -> Lens:
    return lens.other(zoom=float(np.exp(by[0]))).other(shift=(by[1], by[2])).other(k1=float(by[3]))


def _planes(rig: Rig, matches: Matches) -> Array:
    """(P, 3) n of n . X = 1, least squares of y x (R x + t (n . x)) = 0."""
    x, y = rig.camera.rays(matches.camera_px), rig.projector.rays(matches.projector_px)
    found = np.zeros((int(matches.piece.max(initial=-1)) + 1, 3))
    for index in range(len(found)):
        mine = (matches.piece == index) & np.isfinite(x).all(axis=1) & np.isfinite(y).all(axis=1)
        slopes = np.cross(y[mine], rig.t)[:, :, None] * x[mine][:, None]
        aims = -np.cross(y[mine], x[mine] @ rig.R.T)
        found[index] = np.linalg.lstsq(slopes.reshape(-1, 3), aims.ravel(), rcond=None)[0]
    return found


def _misses(rig: Rig, matches: Matches, planes: Array) -> Array:
    """(N, 2) in camera pixels: what the plane's transfer misses, or the distance from the epipolar line, and 0."""
    pixels = [matches.camera_px + d for d in PIXEL * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])]
    rays = [rig.camera.rays(one) for one in pixels]
    found = np.zeros((len(matches.piece), 2))
    flat = matches.piece >= 0
    if flat.any():
        n = planes[matches.piece[flat]]
        there = [rig.projector.project(x[flat] @ rig.R.T + rig.t * (x[flat] * n).sum(axis=1)[:, None]) for x in rays]
        slopes = np.stack([there[1] - there[2], there[3] - there[4]], axis=2) / (2 * PIXEL)
        missed = there[0] - matches.projector_px[flat]
        usable = np.isfinite(slopes).all(axis=(1, 2)) & (np.abs(np.linalg.det(np.nan_to_num(slopes))) > 1e-9)
        slopes = np.where(usable[:, None, None], slopes, np.eye(2))
        found[flat] = np.where(usable[:, None], np.linalg.solve(slopes, missed[..., None])[..., 0], np.nan)
    y = rig.projector.rays(matches.projector_px)[~flat]
    across = [(y * np.cross(rig.t, x[~flat] @ rig.R.T)).sum(axis=1) for x in rays]
    slope = np.hypot(across[1] - across[2], across[3] - across[4]) / (2 * PIXEL)
    found[~flat, 0] = across[0] / np.maximum(slope, 1e-12)
    return found


def _behind(rig: Rig, matches: Matches) -> float:
    """Share of the points whose rays meet behind a device."""
    x, y = rig.camera.rays(matches.camera_px) @ rig.R.T, rig.projector.rays(matches.projector_px)
    across, aside = np.cross(x, y), np.cross(rig.t, y)
    depth = -(across * aside).sum(axis=1)
    further = (across * np.cross(x, rig.t)).sum(axis=1)  # d y = depth x + t: d of the same sign as its depth
    return float(np.mean((depth < 0) | (further < 0)))
