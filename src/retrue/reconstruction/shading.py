"""How much of the projector's light each point of a surface catches: its shading, from the normals and their doubt.

Paint changes abruptly, shading does not: what a normal does not tell at a rim or in noise, the shading of the
neighbours does, not their colours.
"""

from __future__ import annotations

import numpy as np

from retrue.geometry.arrays import FloatArray
from retrue.reconstruction.normals import bent_gradients
from retrue.reconstruction.surface_grid import SurfaceGrid
from retrue.rig import Rig

STEEPEST = 0.05
"""Least cosine that a normal may have: a point that is lit so little, beyond 87 degrees, would hardly be one."""
FINEST = 1e-3  # of the light: what cameras round to
SURER = 1e-5  # than that no normal is
BEYOND_DOUBT = 2.0  # sigmas
SWEEPS = 30


def log_cosines(rig: Rig, X: FloatArray, sigma: FloatArray | None, grid: SurfaceGrid) -> tuple[FloatArray, FloatArray]:
    """(N,) log of the cosine between the normal and the way to the projector, NaN where no neighbour tells; and (N,)
    how unsure each point's own normal leaves it, infinitely where it has none.

    Each is known from its normal, up to what noise and bends that a quadric does not follow make of it; and from a
    point to the next it changes by about as much as two normals differ beyond their doubt. The most likely field,

        minimise sum of (s_i - s_i measured)^2 / v_i + sum over links of (s_i - s_j)^2 / t_ij,

    has the own normal's where that is sure, and goes on as the neighbours are where it is not.

    Parameters
    ----------
    X : (N, 3). sigma : (N,) along the camera's ray; None: as the surface scatters. grid : of X.
    """
    measured, variance = _measured(rig, X, sigma, grid)
    a, b = grid.links()
    apart = (measured[a] - measured[b]) ** 2 - BEYOND_DOUBT**2 * (variance[a] + variance[b])
    known = np.isfinite(apart)
    least = max(float(np.median(np.maximum(apart[known], 0.0))) if known.any() else 0.0, FINEST**2)
    link = 1 / (least + np.where(known, np.maximum(apart, 0.0), 0.0))
    own = np.where(np.isfinite(variance), 1 / np.maximum(variance, SURER**2), 0.0)
    field = measured
    for _ in range(SWEEPS):
        total, weight = own * np.nan_to_num(measured), own.copy()
        for point, neighbour in ((a, b), (b, a)):
            told = np.isfinite(field[neighbour])
            total += np.bincount(point[told], (link * field[neighbour])[told], len(X))
            weight += np.bincount(point[told], link[told], len(X))
        field = np.where(weight > 0, total / np.where(weight > 0, weight, 1.0), np.nan)
    return field, np.sqrt(variance)


def _measured(rig: Rig, X: FloatArray, sigma: FloatArray | None, grid: SurfaceGrid) -> tuple[FloatArray, FloatArray]:
    """(N,) log of the cosine by each point's own normal, NaN for none; and its variance, infinite there.

    The normal goes as n = (w_x, w_y, w - x w_x - y w_y), so that with V the way to the projector

        d log cos = dn . V / n . V - dn . n / n . n.
    """
    slopes, covariance, left = bent_gradients(X, grid)
    rays, w = X[:, :2] / X[:, 2:], 1 / X[:, 2]
    n = np.column_stack([slopes, w - (slopes * rays).sum(axis=1)])
    way = rig.projector_from_camera.inverse().t - X
    along, square = (n * way).sum(axis=1), (n * n).sum(axis=1)
    cosine = -along / np.sqrt(square) / np.linalg.norm(way, axis=1)
    change = (way[:, :2] - rays * way[:, 2:]) / along[:, None] - (n[:, :2] - rays * n[:, 2:]) / square[:, None]
    noise = np.full(len(X), np.median(left)) if sigma is None else (sigma / (np.linalg.norm(X, axis=1) * X[:, 2])) ** 2
    with np.errstate(invalid="ignore"):
        spread = (change[:, None] @ covariance @ change[:, :, None])[:, 0, 0]
    variance = np.fmax(noise, left) * spread
    told = (cosine > STEEPEST) & (variance > 0)
    return np.log(np.where(told, cosine, np.nan)), np.where(told, variance, np.inf)
