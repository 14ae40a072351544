"""Compensating elements and what they leave: spheres and planes by least squares, with covariances.

What remains after the fit is split in two: a smooth field, a polynomial of degree four over the element, which is
what the rig does wrong and would do again; and noise, which another picture would not repeat. Uncertainties come
from the noise alone, for a test asks for the former. Its level is taken from the data, so that only the ratios of
the points' covariances need to be right; and where neighbours share their noise, the blocks in which they lie tell by
how much less they know.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from retrue.geometry.arrays import FloatArray
from retrue.geometry.sphere import FittedSphere, sphere_through

DEGREE = 4
BLOCKS = 7  # along each side, for what neighbours share
DRAWS, FEWEST_DRAWS = 300, 60
MOST_NORMALS = 30_000_000  # drawn in all


@dataclass(frozen=True, slots=True, eq=False)
class Element:
    """A fitted sphere or plane.

    Attributes
    ----------
    parameters : of a sphere its centre and radius (4,); of a plane its normal and distance (4,), normal . X = distance.
    covariance : (4, 4) of a sphere's parameters; of a plane only its use for the form counts.
    noise : (N,) sigma of each point along the normal, as the residuals have it.
    shared : variance of neighbours' sums over that of lone noise, 1 where each errs by itself.
    residuals : (N,) signed distances of the points, positive on the camera's side.
    form : range of the residuals without the outliers that the guideline allows.
    form_sigma : its standard deviation.
    """

    parameters: FloatArray
    covariance: FloatArray
    noise: FloatArray
    shared: float
    residuals: FloatArray
    form: float
    form_sigma: float


def fit_sphere(points: FloatArray, noise: FloatArray, outliers: float) -> Element:
    """Minimises sum of (|X - c| - r)^2 over c and r, free both: the Gaussian compensating sphere.

    Parameters
    ----------
    points : (N, 3) of one ball, in the camera frame.
    noise : (N, 3, 3) covariance of each point, up to a common factor.
    outliers : share that `form` leaves out.

    Raises
    ------
    DegenerateError : the points do not determine a sphere.

    >>> directions = np.random.default_rng(0).normal(size=(500, 3)) * [1, 1, 0.5] - [0, 0, 3]
    >>> ball = 5 * directions / np.linalg.norm(directions, axis=1, keepdims=True) + [10, 20, 400]
    >>> fit_sphere(ball, np.tile(np.eye(3), (500, 1, 1)), 0.003).parameters.round(6).tolist()
    [10.0, 20.0, 400.0, 5.0]
    """
    found = sphere_through(points)
    away = points - found.centre
    _, _, axes = np.linalg.svd(away - away.mean(axis=0), full_matrices=False)
    parameters = np.append(found.centre, found.radius)
    element = _element(parameters, found.residuals, away @ axes[:2].T, found.design, noise, outliers)
    return replace(element, parameters=parameters - _bias_of_sphere(element, found, noise))


def fit_plane(points: FloatArray, noise: FloatArray, outliers: float) -> Element:
    """Minimises sum of (n . X - d)^2 over unit n and d: the Gaussian compensating plane; n points to the camera."""
    centre = points.mean(axis=0)
    away = points - centre
    _, _, axes = np.linalg.svd(away, full_matrices=False)
    normal = axes[2] if axes[2] @ centre < 0 else -axes[2]
    across = away @ axes[:2].T
    design = np.column_stack([np.tile(normal, (len(points), 1)), across])  # rows begin with the normal, as of a sphere
    parameters = np.append(normal, normal @ centre)
    return _element(parameters, away @ normal, across, design, noise, outliers)


def trimmed_range(values: FloatArray, outliers: float) -> float:
    """The least range that holds all values but that share, rounded down to whole points.

    >>> trimmed_range(np.array([0.0, 1.0, 2.0, 50.0]), 0.25), trimmed_range(np.array([0.0, 1.0, 2.0, 50.0]), 0.2)
    (2.0, 50.0)
    """
    ordered = np.sort(values)
    out = int(outliers * len(values))
    return float((ordered[len(ordered) - 1 - out :] - ordered[: out + 1]).min())


def _least_squares(design: FloatArray, values: FloatArray) -> FloatArray:
    solution: Any = np.linalg.lstsq(design, values, rcond=None)
    return np.asarray(solution[0], dtype=np.float64)


def _element(
    parameters: FloatArray,
    residuals: FloatArray,
    across: FloatArray,
    design: FloatArray,
    noise: FloatArray,
    outliers: float,
) -> Element:
    """What remains, and how sure all of it is; `across` (N, 2) are places on the element."""
    normals = design[:, :3]
    shape: FloatArray = np.sqrt((_by_normals(noise, normals) * normals).sum(axis=1))
    shape /= np.sqrt(np.mean(shape**2))
    smooth, level, shared = _split(residuals, across, shape)
    inverse = np.asarray(np.linalg.pinv(design), dtype=np.float64)
    covariance = shared * level**2 * (inverse * shape**2) @ inverse.T
    draws = int(np.clip(MOST_NORMALS / len(residuals), FEWEST_DRAWS, DRAWS))
    random = np.random.default_rng(0)
    ranges = np.empty(draws)
    for draw in range(draws):
        drawn = smooth + level * shape * random.standard_normal(len(residuals))
        ranges[draw] = trimmed_range(drawn - design @ (inverse @ drawn), outliers)
    form = trimmed_range(residuals, outliers)
    return Element(parameters, covariance, level * shape, shared, residuals, form, float(ranges.std(ddof=1)))


def _bias_of_sphere(element: Element, found: FittedSphere, noise: FloatArray) -> FloatArray:
    """(4,) by how much centre and radius err on average, in the second order of the noise.

    Noise turns the very normals that weigh it: a point that is too far off lies nearer to the rim of the cap, too, and
    noise along the rays makes the sphere too small, by some times sigma^2 / r. With d_i = (n_i, 1), e_i the noise of
    a point less that of the centre, f_i what the linear fit leaves of it, P = I - n n^T,

        bias = (D^T D)^-1 sum of d_i tr(P E[e e^T]) / 2 r + (P E[e f], 0) / r.

    Source: Box, "Bias in nonlinear estimation", Journal of the Royal Statistical Society B 33 (1971).
    """
    normals, design = found.design[:, :3], found.design
    by_normal = _by_normals(noise, normals)
    level = element.noise**2 / (by_normal * normals).sum(axis=1)  # of the common factor
    by_normal *= level[:, None]
    inverse = np.asarray(np.linalg.pinv(design), dtype=np.float64)
    a, V = element.shared * inverse[:3].T, element.covariance
    lever = element.shared * (inverse.T * design).sum(axis=1)
    along = element.noise**2

    def across(vectors: FloatArray) -> FloatArray:
        return vectors - normals * (vectors * normals).sum(axis=1, keepdims=True)

    trace = level * np.trace(noise, axis1=1, axis2=2) - along
    trace -= 2 * (across(by_normal) * a).sum(axis=1)
    trace += np.trace(V[:3, :3]) - ((normals @ V[:3, :3]) * normals).sum(axis=1)
    turned = across(by_normal * (1 - lever)[:, None] - a * along[:, None] + design @ V[:, :3]) / found.radius
    return inverse @ (trace / (2 * found.radius)) + np.linalg.pinv(design.T @ design)[:, :3] @ turned.sum(axis=0)


def _by_normals(noise: FloatArray, normals: FloatArray) -> FloatArray:
    """(N, 3) C n of each point."""
    return (noise @ normals[:, :, None])[:, :, 0]


def _split(residuals: FloatArray, across: FloatArray, shape: FloatArray) -> tuple[FloatArray, float, float]:
    """The smooth field (N,), the level of noise, and the variance of neighbours' sums over that of lone noise."""
    low, high = across.min(axis=0), across.max(axis=0)
    u, v = (2 * (across - low) / (high - low) - 1).T
    terms = np.stack([u**i * v**j for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i)], axis=1)
    smooth = terms @ _least_squares(terms, residuals)
    noise = (residuals - smooth) / shape
    level = float(np.sqrt((noise @ noise) / max(len(noise) - terms.shape[1], 1)))
    place = np.minimum(((across - low) / (high - low) * BLOCKS).astype(np.int64), BLOCKS - 1)
    block = place[:, 0] * BLOCKS + place[:, 1]
    sums, counts = np.bincount(block, noise), np.bincount(block)
    shared = float((sums**2).sum() / counts.sum() / level**2) if level > 0 else 1.0
    return smooth, level, max(shared, 1.0)
