"""How light or dark a surface is by itself: its colours without the shading of the projector's light."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from retrue.correspondences import Correspondences
from retrue.geometry.arrays import FloatArray
from retrue.reconstruction.normals import surface_normals
from retrue.reconstruction.surface_grid import SurfaceGrid
from retrue.rig import Rig

STEEPEST = 0.2
"""Least cosine that a normal may have: a point that is lit so little, beyond 78 degrees, would hardly be one."""
ENOUGH = 3  # neighbours that the surface goes on to, for a normal


def albedo(rig: Rig, points: Correspondences, X: FloatArray, grid: SurfaceGrid) -> NDArray[np.uint8]:
    """(N, 3) red, green, blue of the surface itself, up to one factor for all.

    A dull surface of albedo a returns a cos(theta) / d^2 of the projector's light, d away from it and theta between its
    normal and the way there. The room's light is left out where `points.light` tells the projector's own share. The
    factor leaves the median brightness as it was. The vignetting of either lens, which a picture of a scene does not
    tell from albedo, stays. Where too few neighbours tell a normal, theirs count.

    Parameters
    ----------
    points : N, with colours. X : (N, 3) where they lie. grid : of X.

    Source: Lambert's cosine law and the inverse square law, as in Horn, "Robot Vision", 1986, chapter 10.
    """
    assert points.colors is not None
    found: FloatArray = points.colors * (_own_share(points) / _shading(rig, X, grid))[:, None]
    before, level = (float(np.median(colors.max(axis=1))) for colors in (points.colors, found))
    return np.clip((found * (before / level if level > 0 else 0.0)).round(), 0, 255).astype(np.uint8)


def _shading(rig: Rig, X: FloatArray, grid: SurfaceGrid) -> FloatArray:
    """(N,) cos(theta) / d^2, in 1 / unit^2."""
    way = rig.projector_from_camera.inverse().t - X
    distance = np.linalg.norm(way, axis=1)
    cosine: FloatArray = (surface_normals(X, grid) * way).sum(axis=1) / distance
    a, b = grid.links()
    links = np.bincount(np.concatenate([a, b]), minlength=len(X))
    known = (cosine > STEEPEST) & (links >= ENOUGH)
    total, count = np.zeros(len(X)), np.zeros(len(X))
    for point, neighbour in ((a, b), (b, a)):
        tells = known[neighbour]
        total += np.bincount(point[tells], cosine[neighbour[tells]], len(X))
        count += np.bincount(point[tells], minlength=len(X))
    usual = float(np.median(cosine[known])) if known.any() else 1.0
    beside = np.where(count > 0, total / np.maximum(count, 1), usual)
    return np.where(known, cosine, beside) / distance**2


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
