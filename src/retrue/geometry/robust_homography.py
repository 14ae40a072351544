"""The homography of a plane among points that lie elsewhere, or are wrong.

Random minimal samples, half of them local; a loss that saturates instead of counting inliers; reweighted maximum
likelihood on what agrees. The noise need not be given: it is read off the points.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from retrue.errors import DegenerateError, InputError
from retrue.geometry.arrays import BoolArray, FloatArray, centred, finite_array, mean_point
from retrue.geometry.homography import MINIMAL_POINTS
from retrue.geometry.robust import MEDIAN_DISTANCE, quantile
from retrue.kernels import robust_homography as kernel
from retrue.ranges import require_number
from retrue.shown import ShortRepr, Shown, figures, vector
from retrue.values import ByValue

QUICK = 40_000  # points to map for the first of them; enough where most points are on the plane
HYPOTHESES = 200  # at 30 % of the points on the plane, a local sample hits it in more than 1 of 20
MOST_HYPOTHESES = 2000
DRAWS = 256  # numbers of the counter that one hypothesis may take
REFINED, FEW = 4, 800  # of each lot, the best; of few points more, as a sample is far off where it has no points
MISSED = 1e-3  # chance that no sample was all on the plane, at which the search ends
SEARCHED_POINTS, SCORED_POINTS = 2000, 600
EXACT = 1e-9  # noise that is rounding, of the spread of the points
COARSEST = 0.01  # noise that the search starts from, of the spread of the points
NARROWER = 0.5  # of the noise that was searched with: then another plane may hold more points
NEARLY = 0.8  # of the best plane's support; a sample with less will not surpass it once refined
CUTOFF = 4.0  # of the noise, where a point stops to count
REACH = 5.0  # where it stops to pull a fit that is alone: wider, as that is more efficient
SETTLED = 0.01  # relative change of the noise
FEW_POINTS, NARROW = 50, 0.3  # below, it is asked whether another plane holds its points so much more closely
STEPS, FINAL_STEPS = 4, 10  # from a wide reach: near the optimum, and to it
LARGEST_SCATTER = 0.45  # of the cutoff, RMS; points that fill the band by chance have 0.58
NEIGHBOURS, SEEDS, TRIPLETS = 12, 64, 20
THINNED = 4  # to one of so many points
TRIPLET_CONSISTENCY = 1.16  # of the third smallest of nine errors, for independent normal noise (by simulation)


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
    if noise is not None:
        require_number(noise, "robust homography: noise", 0, above=True)
    require_number(seed, "seed", 0, whole=True)
    rng = np.random.default_rng(seed)
    fewest = max(MINIMAL_POINTS + 1, len(source) // 4)
    spread = float(target.std(axis=0).max())
    scale = noise or min(local_noise(source, target, rng), 0.1 * spread) or 0.02 * spread
    found = _settled_plane(source, target, scale, noise, fewest, rng)
    if found is None:
        raise DegenerateError(
            f"robust homography: no plane that a quarter of the {len(source)} points agree with; are they matches?"
        )
    few = noise is None and len(source) < FEW_POINTS  # of few, neighbours tell the noise badly
    while few and found.noise > EXACT * spread:
        narrower = _settled_plane(source, target, NARROW * found.noise, NARROW * found.noise, fewest, rng)
        if narrower is None or not _evidence(narrower, spread) > _evidence(found, spread):
            break
        found = _settled_plane(source, target, narrower.noise, None, fewest, rng) or narrower
    return found


def _settled_plane(
    source: FloatArray, target: FloatArray, scale: float, noise: float | None, fewest: int, rng: np.random.Generator
) -> RobustHomography | None:
    """The largest plane at a noise to start from, and again at the one that it leaves, unless the noise is given."""
    spread = float(target.std(axis=0).max())
    found: RobustHomography | None = None
    rounds, before, searched = 1 if noise else 4, 0.0, np.inf
    while rounds and not abs(scale - before) < SETTLED * scale:
        scale = max(scale, 1e-12 * spread)
        if found is None or scale < NARROWER * searched:
            start, searched = None if found is None else found.homography, scale
            again = largest_plane(source, target, scale, fewest, rng, start=start, reach=REACH)
        else:
            again = refined_plane(found.homography, source, target, scale, fewest, REACH)
        if again is None and found is None and noise is None and 0 < scale < COARSEST * spread:
            scale *= 3  # neighbours agree with each other more closely than with the plane: their noise is smooth
            continue
        if again is None:
            break
        found, rounds, before = again, rounds - 1, scale
        scale = noise or _noise_left(found, source, target)
    return None if found is None else replace(found, noise=scale)


def _noise_left(found: RobustHomography, source: FloatArray, target: FloatArray) -> float:
    distance = _distances(found.homography, source, target)[found.inliers]
    freedom = np.sqrt(len(distance) / max(len(distance) - MINIMAL_POINTS, 1))
    return quantile(distance, 0.5) / MEDIAN_DISTANCE * float(freedom)


def _evidence(found: RobustHomography, spread: float) -> float:
    """Log likelihood of the inliers, up to a constant, that the four do not count for which any homography fits."""
    return (np.count_nonzero(found.inliers) - MINIMAL_POINTS) * float(np.log(spread / found.noise))


def local_noise(camera_rays: FloatArray, projector_rays: FloatArray, rng: np.random.Generator) -> float:
    """Noise per axis of the projector rays, from how far neighbours are from an affine map of each other.

    In each of many neighbourhoods, the affine map of three points that the others agree with best: outliers, up
    to half of the points, and depth edges do not matter. Neighbours whose noise is correlated (a smoothed dense
    code) make it too small; it is a start, not a result. Neighbours on one line, as of pixel rows that lie far apart,
    have no affine map: then fewer points, whose neighbours are of several. 0 where nothing tells.
    """
    x, y = camera_rays, projector_rays
    while len(x) >= NEIGHBOURS:
        seeds = rng.choice(len(x), min(SEEDS, len(x)), replace=False)
        triplets = rng.permuted(np.tile(np.arange(NEIGHBOURS), (TRIPLETS, 1)), axis=1)[:, :3]
        scatter = np.empty(len(seeds))
        kernel.local_scatter(x, y, seeds, np.ascontiguousarray(triplets), scatter)
        noise = float(np.sqrt(quantile(scatter, 0.5))) * TRIPLET_CONSISTENCY
        if np.isfinite(noise):
            return noise
        kept = rng.choice(len(x), len(x) // THINNED, replace=False)
        x, y = x[kept], y[kept]
    return 0.0


def largest_plane(
    x: FloatArray,
    y: FloatArray,
    noise: float,
    fewest: int,
    rng: np.random.Generator,
    most_hypotheses: int = MOST_HYPOTHESES,
    start: FloatArray | None = None,
    reach: float = CUTOFF,
) -> RobustHomography | None:
    """The homography that the most points agree with, to `noise` per axis of y; None where none holds `fewest`.

    To the homography near a `start`, only a sample that more points agree with is preferred.
    """
    rows = rng.choice(len(x), min(SEARCHED_POINTS, len(x)), replace=False)
    source_center, target_center = mean_point(x), mean_point(y)
    s, d = x[rows] - source_center, y[rows] - target_center
    scored, cutoff = min(SCORED_POINTS, len(rows)), CUTOFF * noise
    least = max(MINIMAL_POINTS, fewest * scored / len(x))
    state, tried = int(rng.integers(0, 2**63)), 0
    lot = int(np.clip(QUICK // scored, HYPOTHESES // 4, 4 * HYPOTHESES))
    best = np.zeros(9) if start is None else _shifted(start, source_center, -target_center).ravel()
    score = cast("float", kernel.refine(s, d, scored, cutoff, least, STEPS, best))
    while tried < most_hypotheses:
        hypotheses = np.zeros((max(REFINED, FEW // scored), 10))
        hypotheses[:, 0] = max(score, 0.0) * (NEARLY if start is None else 1.0)
        kernel.search(s, d, scored, cutoff, state + DRAWS * tried, lot, hypotheses)
        tried, lot = tried + lot, min(HYPOTHESES, most_hypotheses - tried - lot)
        for H in hypotheses[:, 1:]:
            support = cast("float", kernel.refine(s, d, scored, cutoff, least, STEPS, H))
            if support > score:
                score, best = support, H
        if (1 - (score / scored) ** MINIMAL_POINTS) ** tried <= MISSED:
            break
    if not score > 0:
        return None
    return refined_plane(_shifted(best.reshape(3, 3), -source_center, target_center), x, y, noise, fewest, reach)


def refined_plane(
    H: FloatArray, x: FloatArray, y: FloatArray, noise: float, fewest: int, reach: float
) -> RobustHomography | None:
    """The homography near H that the most points agree with; None where fewer than `fewest` do, or as by chance."""
    (s, source_center), (d, target_center) = centred(x), centred(y)
    about = _shifted(H, source_center, -target_center).ravel()
    least = max(MINIMAL_POINTS, fewest)
    if not kernel.refine(s, d, len(s), reach * noise, least, FINAL_STEPS, about) > 0:
        return None
    relative = _distances(about, s, d) / (CUTOFF * noise)
    inliers = relative < 1
    if not np.count_nonzero(inliers) >= fewest:
        return None
    if not float(np.sqrt(np.mean(relative[inliers] ** 2))) <= LARGEST_SCATTER:
        return None
    H = _shifted(about.reshape(3, 3), -source_center, target_center)  # with H33 = 1: the centre is in front
    return RobustHomography(H / np.linalg.norm(H), inliers, noise)


def _distances(H: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
    """(N,) from the target to the mapped source; NaN where it is mapped to infinity."""
    distances = np.empty(len(x))
    kernel.transfer_distances(x, y, H.ravel(), distances)
    return distances


def _shifted(H: FloatArray, source: FloatArray, target: FloatArray) -> FloatArray:
    """H for points moved back by `source`, their images forth by `target`: T(target) H T(source)."""
    H = H.copy()
    H[:, 2] += H[:, :2] @ source
    H[:2] += target[:, None] * H[2]
    return H
