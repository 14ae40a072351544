"""How light or dark a surface is by itself: its colours without the shading of the projector's light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from retrue.correspondences import Correspondences
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.robust import biweight
from retrue.reconstruction.shading import log_cosines
from retrue.reconstruction.surface_grid import SurfaceGrid, linked
from retrue.rig import Rig

ENOUGH = 4  # neighbours that the surface goes on to, for a sure normal
FARTHEST = 8  # cells from those
ONE_SIGMA = (0.16, 0.84)  # quantiles of normal numbers
SAME = 0.02  # at first: by how much the log brightness of one paint errs
CUT = 0.05  # of the light of a block: how unsure it is beside an edge
MOST = 1.0  # doubt
TINY = 1e-300
STEPS = 12  # of the differences that tell vignetting, on the longer side of the grid
BLOCK = 3  # of these steps, side of what one print may cover
FEWEST = 200  # of them
ROUNDS = 30
LEAST, LEAST_SIZE = 0.2, 0.2533
"""Share of the differences that tells their scale, and that quantile of the size of normal numbers."""
FINEST = 1e-3  # of the light: what cameras round to
BEYOND_DOUBT = 4.0  # sigmas


def albedo(
    rig: Rig, points: Correspondences, X: FloatArray, sigma: FloatArray | None, grid: SurfaceGrid
) -> NDArray[np.uint8]:
    """(N, 3) red, green, blue of the surface itself, up to one factor for all.

    A dull surface of albedo a returns a cos(theta) / d^2 of the projector's light, d away from it and theta between its
    normal and the way there. The room's light is left out where `points.light` tells the projector's own share. The
    factor leaves the median brightness as it was. What the camera's lens loses towards its corners goes too, as far as
    the cloud tells it (`_vignetting`); at a rim, where little tells, neighbours help (`_evened`).

    Parameters
    ----------
    points : N, with colours. X : (N, 3) where they lie. sigma : (N,) of each along its ray, or None. grid : of X.

    Source: Lambert's cosine law and the inverse square law, as in Horn, "Robot Vision", 1986, chapter 10; vignetting
    from gradients, as Zheng, Yu, Kang, Lin and Kambhamettu, "Single-image vignetting correction using radial gradient
    symmetry", CVPR 2008.
    """
    assert points.colors is not None
    seen = points.colors * _own_share(points)[:, None]
    log_cosine, doubt = log_cosines(rig, X, sigma, grid)
    shading = _shading(rig, X, seen.max(axis=1), log_cosine)
    sure = np.bincount(np.concatenate(grid.links()), minlength=len(X)) >= ENOUGH
    found = seen / shading[:, None]
    found /= _vignetting(rig, points, np.where(sure[:, None], found, np.nan), grid)[:, None]
    if points.light_class is not None:
        doubt = np.hypot(doubt, CUT)
    found = _evened(found, seen, doubt, sure, grid)
    before, level = (float(np.median(colors.max(axis=1))) for colors in (points.colors, found))
    return np.clip((found * (before / level if level > 0 else 0.0)).round(), 0, 255).astype(np.uint8)


def _shading(rig: Rig, X: FloatArray, seen: FloatArray, log_cosine: FloatArray) -> FloatArray:
    """(N,) cos(theta) / d^2, in 1 / unit^2, from the logarithms, NaN where no normal is told.

    There, what is `seen` of both paint and cosine is shared between them as they vary over the others.
    """
    distance = np.linalg.norm(rig.projector_from_camera.inverse().t - X, axis=1)
    known = np.isfinite(log_cosine) & (seen > 0)
    if known.any() and not known.all():
        cosine, both = log_cosine[known], np.log(np.maximum(seen, 1e-9)) + 2 * np.log(distance)
        paint = both[known] - cosine
        share = cosine.var() / max(cosine.var() + paint.var(), 1e-12)
        guess = cosine.mean() + share * (both - cosine.mean() - paint.mean())
        log_cosine = np.where(np.isfinite(log_cosine), log_cosine, guess)
    return np.exp(np.nan_to_num(log_cosine)) / distance**2


def _evened(found: FloatArray, seen: FloatArray, doubt: FloatArray, sure: BoolArray, grid: SurfaceGrid) -> FloatArray:
    """(N, 3) albedo, at a rim as it is found there, or as that of the neighbours, as either is likely.

    A rim that is brighter or darker than its `sure` neighbours shows the same paint; or another one, which may be as
    bright as any in the cloud; or the same, in a light that is misjudged, by about its `doubt` and now and then by far
    more (Cauchy's density). How often paint changes from a point to the next, two sure ones show. Those without
    neighbours are held against most.
    """
    with np.errstate(divide="ignore"):
        level = np.log(found.max(axis=1))
    own = np.where(np.isfinite(level), level, np.nan)
    around = _filled(np.where(sure, own, np.nan), grid)
    a, b = grid.links()
    change, off = (own[a] - own[b])[sure[a] & sure[b]], own - around
    told = np.isfinite(own)
    low, high = np.quantile(own[told], ONE_SIGMA) if told.any() else (0.0, 0.0)
    paint = _paint_changes(change[np.isfinite(change)], float(high - low) / np.sqrt(2))
    kept = paint.density(off)
    kept /= kept + (1 - paint.often) * _heavy(off, np.minimum(doubt, MOST))
    bright = np.where(told, around + kept * off, around)
    chroma = seen / np.maximum(seen.max(axis=1, keepdims=True), 1e-9)
    return np.exp(np.where(sure & told, own, bright))[:, None] * chroma


@dataclass(frozen=True, slots=True)
class _PaintChanges:
    """From a point to the next paint mostly stays, and its log brightness errs by `same`; `often` it is another one."""

    same: float
    often: float
    other: float

    def density(self, change: FloatArray) -> FloatArray:
        return (1 - self.often) * _density(change, self.same) + self.often * _density(change, self.other)


def _paint_changes(change: FloatArray, other: float) -> _PaintChanges:
    """By expectation and maximisation of the two, `other` known."""
    other = max(other, FINEST)
    found = _PaintChanges(min(SAME, other), 0.5, other)
    for _ in range(ROUNDS if len(change) else 0):
        stays = (1 - found.often) * _density(change, found.same) / found.density(change)
        same = float(np.sqrt((stays * change**2).sum() / max(stays.sum(), 1e-9)))
        found = _PaintChanges(min(max(same, FINEST), other), 1 - float(stays.mean()), other)
    return found


def _density(off: FloatArray, sigma: float) -> FloatArray:
    """(N,) of normal numbers, up to one factor; never none."""
    return np.exp(-0.5 * (off / sigma) ** 2) / sigma + TINY


def _heavy(off: FloatArray, half: FloatArray) -> FloatArray:
    """(N,) of Cauchy's numbers of that half width, by the same factor."""
    return np.sqrt(2 / np.pi) * half / (half**2 + off**2)


def _filled(values: FloatArray, grid: SurfaceGrid) -> FloatArray:
    """(N,) of each known point itself, of the others what their neighbours have; far from all, the median."""
    for _ in range(FARTHEST):
        values = np.where(np.isnan(values), _mean_of_neighbours(values, grid), values)
    known = np.isfinite(values)
    return np.where(known, values, float(np.median(values[known])) if known.any() else 0.0)


def _mean_of_neighbours(values: FloatArray, grid: SurfaceGrid) -> FloatArray:
    """(N,) of those that are known, of the neighbours that the surface goes on to; NaN where there are none."""
    a, b = grid.links()
    total, count = np.zeros(len(values)), np.zeros(len(values))
    for point, neighbour in ((a, b), (b, a)):
        tells = np.isfinite(values[neighbour])
        total += np.bincount(point[tells], values[neighbour[tells]], len(values))
        count += np.bincount(point[tells], minlength=len(values))
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _vignetting(rig: Rig, points: Correspondences, found: FloatArray, grid: SurfaceGrid) -> FloatArray:
    """(N,) exp(-k r^2), the camera's share of light at r from its principal point, 1 at half the diagonal; 1 in doubt.

    Paint changes outwards as often as inwards, and mostly from place to place; vignetting is one k for the whole
    picture. So k is the robust slope of the log of brightness by r^2, from the differences of points on one surface,
    next to each other, which mostly show one paint, or far apart, which vignetting tells apart more: as is surer.
    """
    size = np.array(rig.camera.size, dtype=np.float64)
    square = 4 * ((points.camera_px - rig.camera.K[:2, 2]) ** 2).sum(axis=1) / float(size @ size)
    with np.errstate(divide="ignore"):
        level = np.log(found)
    step = max(1, max(grid.index.shape) // STEPS)
    block = _blocks(grid, len(found), BLOCK * step)
    k, doubt = min((_slope(level, square, block, grid, apart) for apart in {1, step}), key=lambda told: told[1])
    return np.exp(-k * square) if k > BEYOND_DOUBT * doubt else np.ones(len(found))


def _slope(level: FloatArray, square: FloatArray, block: IntArray, grid: SurfaceGrid, step: int) -> tuple[float, float]:
    """k, and how sure it is, of differences over so many cells; infinitely unsure where too few tell.

    Each channel tells by itself, since prints seldom change all. The scale is that of the least fifth of the changes,
    which cross no print. One print is seen by many pairs: what blocks of the picture say against each other is the
    doubt.
    """
    a, b = np.concatenate([linked(grid.index, grid.right, step), linked(grid.index.T, grid.down.T, step)]).T
    change = level[a] - level[b]
    row, channel = np.nonzero(np.isfinite(change))
    if len(row) < FEWEST:
        return 0.0, np.inf
    change, lever, block = change[row, channel], (square[a] - square[b])[row], block[a[row]]
    k, information, score = 0.0, 0.0, np.zeros(1)
    for _ in range(ROUNDS):
        off = change + k * lever
        weight = biweight(off / max(float(np.quantile(np.abs(off), LEAST)) / LEAST_SIZE, FINEST))
        information = float((weight * lever**2).sum())
        if not information > 0:
            return 0.0, np.inf
        k = -float((weight * lever * change).sum()) / information
        score = np.bincount(block, weight * lever * (change + k * lever))
    return k, float(np.sqrt((score**2).sum())) / information


def _blocks(grid: SurfaceGrid, count: int, side: int) -> IntArray:
    """(count,) number of the block, so many cells wide and high, that each point lies in."""
    row, column = np.nonzero(grid.index >= 0)
    found = np.zeros(count, np.int64)
    found[grid.index[row, column]] = row // side * grid.index.shape[1] + column // side
    return found


def _own_share(points: Correspondences) -> FloatArray:
    """(N,) the projector's share of the light that is seen, up to one factor; 1 where that is not told.

    Light of several classes is that of a single picture's blocks, whose colours hold nothing else.
    """
    assert points.colors is not None
    if points.light is None or points.light_class is not None:
        return np.ones(len(points))
    with np.errstate(divide="ignore", invalid="ignore"):
        share = points.light / points.colors.mean(axis=1)
    known = np.isfinite(share) & (share > 0)
    usual = float(np.median(share[known])) if known.any() else 1.0
    return np.where(known, share / usual, 1.0)
