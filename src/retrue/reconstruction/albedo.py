"""How light or dark a surface is by itself: its colours without the shading of the projector's light."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from retrue.correspondences import Correspondences
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.robust import MAD_TO_SIGMA, biweight
from retrue.reconstruction.normals import bent_normals
from retrue.reconstruction.surface_grid import SurfaceGrid, linked
from retrue.rig import Rig

STEEPEST = 0.2
"""Least cosine that a normal may have: a point that is lit so little, beyond 78 degrees, would hardly be one."""
ENOUGH = 4  # neighbours that the surface goes on to, for a sure normal
FARTHEST = 8  # cells from those
STEPS = 12  # of the differences that tell vignetting, on the longer side of the grid
BLOCK = 3  # of these steps, side of what one print may cover
FEWEST = 200  # of them
ROUNDS = 10
FINEST = 1e-3  # of the light: what cameras round to
BEYOND_DOUBT = 4.0  # sigmas


def albedo(rig: Rig, points: Correspondences, X: FloatArray, grid: SurfaceGrid) -> NDArray[np.uint8]:
    """(N, 3) red, green, blue of the surface itself, up to one factor for all.

    A dull surface of albedo a returns a cos(theta) / d^2 of the projector's light, d away from it and theta between its
    normal and the way there. The room's light is left out where `points.light` tells the projector's own share. The
    factor leaves the median brightness as it was. What the camera's lens loses towards its corners goes too, as far as
    the cloud tells it (`_vignetting`); at a rim, where normals are unsure, neighbours help (`_evened`).

    Parameters
    ----------
    points : N, with colours. X : (N, 3) where they lie. grid : of X.

    Source: Lambert's cosine law and the inverse square law, as in Horn, "Robot Vision", 1986, chapter 10; vignetting
    from gradients, as Zheng, Yu, Kang, Lin and Kambhamettu, "Single-image vignetting correction using radial gradient
    symmetry", CVPR 2008.
    """
    assert points.colors is not None
    seen = points.colors * _own_share(points)[:, None]
    shading, sure = _shading(rig, X, grid)
    found = seen / shading[:, None]
    vignetting = _vignetting(rig, points, np.where(sure[:, None], found, np.nan), grid)
    found = _evened(found / vignetting[:, None], seen, sure, grid)
    before, level = (float(np.median(colors.max(axis=1))) for colors in (points.colors, found))
    return np.clip((found * (before / level if level > 0 else 0.0)).round(), 0, 255).astype(np.uint8)


def _shading(rig: Rig, X: FloatArray, grid: SurfaceGrid) -> tuple[FloatArray, BoolArray]:
    """(N,) cos(theta) / d^2, in 1 / unit^2, NaN where no normal is told; and where it is in the midst of a surface."""
    way = rig.projector_from_camera.inverse().t - X
    distance = np.linalg.norm(way, axis=1)
    cosine: FloatArray = (bent_normals(X, grid) * way).sum(axis=1) / distance
    lit = cosine > STEEPEST
    links = np.bincount(np.concatenate(grid.links()), minlength=len(X))
    return np.where(lit, cosine / distance**2, np.nan), lit & (links >= ENOUGH)


def _evened(found: FloatArray, seen: FloatArray, sure: BoolArray, grid: SurfaceGrid) -> FloatArray:
    """(N, 3) albedo, at a rim as bright as it is there and as the neighbours are, weighted by how sure either is.

    How paint changes from a point to the next, two `sure` neighbours show; how much more a rim and its sure neighbour
    differ, is the error of the rim's shading. What is far off the neighbours, beyond paint and that error, is no
    shading at all, and counts less the farther (Tukey's biweight). Those without any are of the colour that is `seen`.
    """
    with np.errstate(divide="ignore"):
        level = np.log(found.max(axis=1))
    own = np.where(np.isfinite(level), level, np.nan)
    around = _mean_of_neighbours(np.where(sure, own, np.nan), grid)
    a, b = grid.links()
    paint, beside = (_variance((own[a] - own[b])[here]) for here in (sure[a] & sure[b], sure[a] != sure[b]))
    both = _variance((own - around)[~sure])
    share = 1 - min(max(beside - paint, 0.0) / both, 1.0) if both > 0 else 1.0
    filled = np.where(sure, own, around)
    for _ in range(FARTHEST):
        filled = np.where(np.isnan(filled), _mean_of_neighbours(filled, grid), filled)
    known = np.isfinite(filled)
    filled = np.where(known, filled, float(np.median(filled[known])) if known.any() else 0.0)
    off = own - filled
    if both > 0:
        share = share * biweight(np.nan_to_num(off / np.sqrt(both)))
    mixed = np.where(np.isfinite(own), filled + share * off, filled)
    chroma = seen / np.maximum(seen.max(axis=1, keepdims=True), 1e-9)
    return np.exp(np.where(sure, filled, mixed))[:, None] * chroma


def _mean_of_neighbours(values: FloatArray, grid: SurfaceGrid) -> FloatArray:
    """(N,) of those that are known, of the neighbours that the surface goes on to; NaN where there are none."""
    a, b = grid.links()
    total, count = np.zeros(len(values)), np.zeros(len(values))
    for point, neighbour in ((a, b), (b, a)):
        tells = np.isfinite(values[neighbour])
        total += np.bincount(point[tells], values[neighbour[tells]], len(values))
        count += np.bincount(point[tells], minlength=len(values))
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _variance(off: FloatArray) -> float:
    """Mean square of those that are known; 0 of none."""
    off = off[np.isfinite(off)]
    return float(np.mean(off**2)) if len(off) else 0.0


def _vignetting(rig: Rig, points: Correspondences, found: FloatArray, grid: SurfaceGrid) -> FloatArray:
    """(N,) exp(-k r^2), the camera's share of light at r from its principal point, 1 at half the diagonal; 1 in doubt.

    Paint changes outwards as often as inwards, and mostly from place to place; vignetting is one k for the whole
    picture. So k is the robust slope of the log of brightness by r^2, from the differences of points on one surface.
    One print is seen by many pairs: what blocks of the picture say of k against each other tells how sure it is.
    """
    size = np.array(rig.camera.size, dtype=np.float64)
    square = 4 * ((points.camera_px - rig.camera.K[:2, 2]) ** 2).sum(axis=1) / float(size @ size)
    step = max(1, max(grid.index.shape) // STEPS)
    a, b = np.concatenate([linked(grid.index, grid.right, step), linked(grid.index.T, grid.down.T, step)]).T
    with np.errstate(divide="ignore"):
        level = np.log(found.mean(axis=1))
    change, lever = level[a] - level[b], square[a] - square[b]
    told = np.isfinite(change)
    change, lever, block = change[told], lever[told], _blocks(grid, len(found), BLOCK * step)[a[told]]
    if len(change) < FEWEST:
        return np.ones(len(found))
    k, information, score = 0.0, 0.0, np.zeros(1)
    for _ in range(ROUNDS):
        off = change + k * lever
        sigma = max(MAD_TO_SIGMA * float(np.median(np.abs(off))), FINEST)
        weight = biweight(off / sigma)
        information = float((weight * lever**2).sum())
        if not information > 0:
            return np.ones(len(found))
        k = -float((weight * lever * change).sum()) / information
        score = np.bincount(block, weight * lever * (change + k * lever))
    doubt = float(np.sqrt((score**2).sum())) / information
    return np.exp(-k * square) if k > BEYOND_DOUBT * doubt else np.ones(len(found))


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
