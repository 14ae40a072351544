"""The homography of a plane among points that lie elsewhere, or are wrong.

Random minimal samples, half of them local, vectorised; a loss that saturates instead of counting inliers; reweighted
maximum likelihood on what agrees. The noise need not be given: it is read off the points.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from retrue.errors import DegenerateError, InputError
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray, finite_array
from retrue.geometry.homography import MINIMAL_POINTS, fit_homography, homography_residuals
from retrue.shown import ShortRepr, Shown, figures, vector
from retrue.values import ByValue

HYPOTHESES = 200  # in one go; at 30 % of the points on the plane, a local sample hits it in more than 1 of 20
MOST_HYPOTHESES = 2000
MISSED = 1e-3  # chance that no sample was all on the plane, at which the search ends
SCORED_POINTS = 600
COARSEST = 0.01  # noise that the search starts from, of the spread of the points
CUTOFF = 4.0  # of the noise, where a point stops to count
LARGEST_SCATTER = 0.45  # of the cutoff, RMS; points that fill the band by chance have 0.58
MEDIAN_DISTANCE = 1.1774  # of two normal components, in their sigma
NEIGHBOURS = 12
TRIPLETS = 20
AGREEING = 2  # the third nearest of the other nine: half of the neighbours may be wrong
TRIPLET_CONSISTENCY = 1.16  # of that choice, for independent normal noise (by simulation)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class RobustHomography(ByValue, ShortRepr):
    """What a robust fit found.

    Attributes
    ----------
    homography : (3, 3), norm and sign as in `fit_homography`.
    inliers : (N,) points within four sigma of it.
    noise : sigma per axis of the target points about it, in their unit.
    """

    homography: FloatArray
    inliers: BoolArray
    noise: float

    def _shown(self) -> Shown:
        rows = {f"row {row}": vector(self.homography[row], 5) for row in range(3)}
        return f"{self.inliers.sum():,} of {len(self.inliers):,} points agree, noise {figures(self.noise)}", rows


def fit_homography_robust(
    source: ArrayLike, target: ArrayLike, *, noise: float | None = None, seed: int = 0
) -> RobustHomography:
    """Maximum-likelihood homography of the largest plane, whatever the other points are.

    Parameters
    ----------
    source, target : (N, 2), N >= 8.
    noise : sigma per axis of the target points, source points taken for exact; None reads it off the points.
    seed : of the random samples; the same points and seed give the same answer.

    Raises
    ------
    InputError : shapes that differ, NaN, fewer than eight points, a noise that is not positive.
    DegenerateError : no homography that a quarter of the points agree with more closely than chance.

    >>> rng = np.random.default_rng(0)
    >>> source = rng.uniform(-1, 1, (100, 2))
    >>> target = source @ [[1.1, 0.1], [0.0, 0.9]] + rng.normal(0, 1e-3, (100, 2))
    >>> target[:30] = rng.uniform(-1, 1, (30, 2))
    >>> found = fit_homography_robust(source, target)
    >>> bool(found.inliers[30:].mean() > 0.97), int(found.inliers[:30].sum()), bool(0.8e-3 < found.noise < 1.2e-3)
    (True, 0, True)
    """
    source = finite_array(source, (None, 2), "source points")
    target = finite_array(target, (len(source), 2), "target points")
    if len(source) < 2 * MINIMAL_POINTS:
        raise InputError(f"robust homography: expected at least eight points, found {len(source)}")
    if noise is not None and not (np.isfinite(noise) and noise > 0):
        raise InputError(f"robust homography: expected a positive noise, found {noise}")
    rng = np.random.default_rng(seed)
    fewest = max(MINIMAL_POINTS + 1, len(source) // 4)
    spread = float(target.std(axis=0).max())
    scale = noise or min(2 * local_noise(source, target, rng), 0.1 * spread) or 0.02 * spread
    found: RobustHomography | None = None
    rounds = 1 if noise else 4
    while rounds:
        again = largest_plane(source, target, max(scale, 1e-12 * spread), fewest, rng)
        if again is None and found is None and noise is None and 0 < scale < COARSEST * spread:
            scale *= 3  # neighbours agree with each other more closely than with the plane: their noise is smooth
            continue
        if again is None:
            break
        found, rounds = again, rounds - 1
        distance = homography_residuals(found.homography, source, target, 0.0, 1.0)
        count = np.count_nonzero(found.inliers)
        freedom = np.sqrt(count / max(count - MINIMAL_POINTS, 1))
        scale = noise or float(np.median(distance[found.inliers])) / MEDIAN_DISTANCE * freedom
    if found is None:
        raise DegenerateError(
            f"robust homography: no plane that a quarter of the {len(source)} points agree with; are they matches?"
        )
    return RobustHomography(found.homography, found.inliers, scale)


def local_noise(camera_rays: FloatArray, projector_rays: FloatArray, rng: np.random.Generator) -> float:
    """Noise per axis of the projector rays, from how far neighbours are from an affine map of each other.

    In each of many neighbourhoods, the affine map of three points that the others agree with best: outliers, up
    to half of the points, and depth edges do not matter. Neighbours whose noise is correlated (a smoothed dense
    code) make it too small; it is a start, not a result.
    """
    from scipy.spatial import KDTree

    if len(camera_rays) < NEIGHBOURS:
        return 0.0
    seeds = rng.choice(len(camera_rays), min(150, len(camera_rays)), replace=False)
    index = cast(IntArray, KDTree(camera_rays).query(camera_rays[seeds], NEIGHBOURS)[1])
    offset = camera_rays[index] - camera_rays[seeds, None]
    design = np.concatenate([offset, np.ones((*index.shape, 1))], axis=2)  # (S, neighbours, 3)
    target = projector_rays[index]
    best = np.full(len(seeds), np.inf)
    for _ in range(TRIPLETS):
        three = rng.permutation(NEIGHBOURS)[:3]
        corner = design[:, three]
        flat = np.abs(np.linalg.det(corner)) <= 1e-3 * np.abs(corner[..., :2]).max(axis=(1, 2)) ** 2
        corner = np.where(flat[:, None, None], np.eye(3), corner)
        error = ((target - design @ np.linalg.solve(corner, target[:, three])) ** 2).sum(axis=2)
        agreeing = np.partition(np.delete(error, three, axis=1), AGREEING, axis=1)[:, AGREEING]
        best = np.minimum(best, np.where(flat, np.inf, agreeing))
    return float(np.sqrt(np.median(best))) * TRIPLET_CONSISTENCY


def largest_plane(
    x: FloatArray,
    y: FloatArray,
    noise: float,
    fewest: int,
    rng: np.random.Generator,
    most_hypotheses: int = MOST_HYPOTHESES,
) -> RobustHomography | None:
    """The homography that the most points agree with, to `noise` per axis of y; None where none holds `fewest`."""
    scored = rng.choice(len(x), min(SCORED_POINTS, len(x)), replace=False)
    few_x, few_y = x[scored], y[scored]
    score, best = 0.0, None
    for tried in range(HYPOTHESES, most_hypotheses + 1, HYPOTHESES):
        candidates = _minimal_homographies(x, y, _samples(x, rng))
        support = _support(candidates, few_x, few_y, CUTOFF * noise)
        for H in candidates[np.argsort(-support)[:4]]:
            refined = _locally_refined(H, few_x, few_y, noise, fewest * len(scored) / len(x))
            if refined is not None:
                found = float(_support(refined[None], few_x, few_y, CUTOFF * noise)[0])
                if found > score:
                    score, best = found, refined
        if (1 - (score / len(scored)) ** MINIMAL_POINTS) ** tried <= MISSED:
            break
    if best is None:
        return None
    H = _locally_refined(best, x, y, noise, fewest)
    if H is None:
        return None
    distance = homography_residuals(H, x, y, 0.0, noise)
    inliers = distance < CUTOFF
    if not np.count_nonzero(inliers) >= fewest:
        return None
    scatter = float(np.sqrt(np.mean(distance[inliers] ** 2)))
    return RobustHomography(H, inliers, noise) if scatter <= LARGEST_SCATTER * CUTOFF else None


def _samples(x: FloatArray, rng: np.random.Generator) -> IntArray:
    """(S, 4) rows: half from anywhere, half from the neighbourhood of a seed, of any size."""
    anywhere = rng.integers(0, len(x), (HYPOTHESES // 2, 4))
    seeds = rng.integers(0, len(x), 10)
    local = np.empty((HYPOTHESES // 2, 4), dtype=np.int64)
    per_seed = len(local) // len(seeds)
    for k, seed in enumerate(seeds):
        order = np.argsort(((x - x[seed]) ** 2).sum(axis=1))
        size = int(np.clip(len(x) * rng.uniform(0.02, 0.3), min(8, len(x)), len(x)))
        local[k * per_seed : (k + 1) * per_seed] = order[rng.integers(0, size, (per_seed, 4))]
    return np.concatenate([anywhere, local])


def _minimal_homographies(x: FloatArray, y: FloatArray, samples: IntArray) -> FloatArray:
    """(S', 3, 3) exact homographies of four points each, eq. (12), in a frame where H[2, 2] = 1 is safe."""
    center_x, center_y = x.mean(axis=0), y.mean(axis=0)
    s, d = x[samples] - center_x, y[samples] - center_y
    one, zero = np.ones(s.shape[:2]), np.zeros(s.shape[:2])
    sx, sy, u, v = s[..., 0], s[..., 1], d[..., 0], d[..., 1]
    upper = np.stack([sx, sy, one, zero, zero, zero, -u * sx, -u * sy], axis=-1)
    lower = np.stack([zero, zero, zero, sx, sy, one, -v * sx, -v * sy], axis=-1)
    A, b = np.concatenate([upper, lower], axis=1), np.concatenate([u, v], axis=1)
    scale = np.abs(A).max(axis=(1, 2), keepdims=True)
    good = np.abs(np.linalg.det(A / scale)) > 1e-20
    h = np.linalg.solve(A[good], b[good][..., None])[..., 0]
    H = np.concatenate([h, np.ones((len(h), 1))], axis=1).reshape(-1, 3, 3)
    to_source, from_target = np.eye(3), np.eye(3)
    to_source[:2, 2], from_target[:2, 2] = -center_x, center_y
    return from_target @ H @ to_source


def _support(homographies: FloatArray, x: FloatArray, y: FloatArray, cutoff: float) -> FloatArray:
    """(S,) sum over points of 1 - (distance / cutoff)^2, none below zero: MSAC."""
    mapped = np.einsum("sij,nj->sin", homographies, np.concatenate([x, np.ones((len(x), 1))], axis=1))
    with np.errstate(all="ignore"):
        distance = (mapped[:, 0] / mapped[:, 2] - y[:, 0]) ** 2 + (mapped[:, 1] / mapped[:, 2] - y[:, 1]) ** 2
        gain = 1 - distance / cutoff**2
    return np.where(gain > 0, gain, 0.0).sum(axis=1)


def _locally_refined(H: FloatArray, x: FloatArray, y: FloatArray, noise: float, fewest: float) -> FloatArray | None:
    """Reweighted maximum likelihood on what lies near, the reach shrinking to the cutoff."""
    for reach in (2 * CUTOFF, CUTOFF, CUTOFF):
        relative = homography_residuals(H, x, y, 0.0, noise) / reach
        near = relative < 1
        if np.count_nonzero(near) < max(4, fewest):
            return None
        try:
            H = fit_homography(x[near], y[near], source_sigma=0.0, weights=(1 - relative[near] ** 2) ** 2, iterations=1)
        except DegenerateError:
            return None
    return H
