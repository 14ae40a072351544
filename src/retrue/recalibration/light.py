"""Which twin does the projector's own light speak for?

Each projector pixel sends equal light, so how bright a diffuse plane is depends on its attitude to the projector alone.
Twins differ in that by far more than in anything else: where one plane faces the projector, the other's is seen nearly
edge-on, and would be many times brighter at one end than at the other. What the camera's curve, paint, gloss and an
uneven projector do to the light is the same for both candidates, and either changes slowly or sits at edges: so
neighbours are compared, robustly, with one bounded smooth term for what all candidates share.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from retrue.geometry.arrays import FloatArray, IntArray
from retrue.geometry.nearest import nearest_of_all
from retrue.geometry.robust import MAD_TO_SIGMA, quantile

GAMMAS = (1.0, 0.7, 0.45)  # linear light; in between; the curve of a camera that makes pictures for people
NEIGHBOURS = 6
MOST_POINTS = 1200
FEWEST_POINTS = 30
PROJECTOR_SLOPE = 0.13  # sigma of log light from the middle of its picture to an edge: two are 40 % from side to side
PROJECTOR_CURVE = 0.1  # likewise, of what falls off to all sides
CAMERA_FALL_OFF = 0.5  # sigma of the exponent of cos^4: a lens has half to one and a half of that, or is corrected
CLASS_SIGMA = 2.0  # of a block colour's constant: next to free
CAUCHY = 1.5  # scatters at which a difference counts half
LEFT_LIGHT = 0.3  # of the median that the projector sends: other light that nobody took away
LEFT_PRICE = 4.6  # of chi-square: one picture in ten has it
SMALLEST_SCATTER = 0.01  # of log light: no camera measures it more closely
DARK = 3.0  # of log light: how wrong a prediction of no light is, where there is some
ROUNDS = 8


def log_irradiance(projector_rays: FloatArray, R: FloatArray, t: FloatArray, planes: FloatArray) -> FloatArray:
    """(N,) log of the light that falls on each point's plane, up to a constant: 3 log(n^ . r / cos alpha) - 2 log D.

    A pixel at the angle alpha from the projector's axis sends its light along the unit ray r. On the plane n^ . X = D
    of the projector's frame it falls under the angle theta at the distance d, with cos(theta) / d^2 = (n^ . r)^3 / D^2;
    and a pixel at alpha is narrower than one on the axis by cos^3 alpha. NaN where the plane is seen from behind.

    Parameters
    ----------
    projector_rays : (N, 2) normalised.
    R, t : projector from camera, t in the unit of the planes.
    planes : (N, 3) n of each point's plane, camera frame.

    >>> plane = np.array([[0.6, 0.0, 0.8]])
    >>> rays = np.array([[0.0, 0.0], [0.5, 0.0]])
    >>> log_irradiance(rays, np.eye(3), np.zeros(3), plane.repeat(2, axis=0)).round(3).tolist()
    [-0.669, 0.286]
    """
    normals = planes @ R.T
    facing = normals[:, 0] * projector_rays[:, 0] + normals[:, 1] * projector_rays[:, 1] + normals[:, 2]
    length, reaches = np.linalg.norm(normals, axis=1), 1 + normals @ t
    facing = facing / length * np.sign(reaches)
    with np.errstate(divide="ignore"):
        return 3 * np.log(np.where(facing > 0, facing, np.nan)) - 2 * np.log(np.abs(reaches) / length)


def light_costs(
    light: FloatArray,
    light_class: IntArray,
    camera_rays: FloatArray,
    projector_raster: FloatArray,
    predictions: Sequence[FloatArray],
    rng: np.random.Generator,
) -> list[float] | None:
    """-2 log likelihood of the light under each candidate, up to a constant; None where too little is lit.

    log light = c(class) + gamma (log irradiance + s) + noise. s is what lenses and lamp do, smooth and bounded by its
    prior: first and radial order in the projector's picture, a power of cos^4 in the camera's. The noise is that of
    differences between neighbours, with Cauchy's heavy tails at the scatter that the best candidate leaves. A point is
    in several pairs and measures once; the sum is scaled to that. Where other light was left in, dark places look less
    dark than they are: a candidate may have that, too, at a price.

    Parameters
    ----------
    light : (N,) what the projector alone adds at each point; NaN or not positive where unknown.
    light_class : (N,) points of one class have one constant.
    camera_rays : (N, 2) normalised.
    projector_raster : (N, 2) place in the projector's picture, -1 .. 1 from edge to edge.
    predictions : (N,) `log_irradiance` of each candidate.
    """
    rows = np.flatnonzero(np.isfinite(light) & (light > 0))
    if len(rows) < FEWEST_POINTS:
        return None
    columns = np.column_stack([np.log(light[rows]), camera_rays[rows], projector_raster[rows]])
    columns = np.column_stack([columns, *(shown for p in predictions for shown in _curves(p[rows]))])
    if len(rows) > MOST_POINTS:
        columns, light_class = _merged(columns, light_class[rows], rng)
    else:
        light_class = light_class[rows]
    first, second = _neighbours(columns[:, 1:3])
    terms, precision = _shared_terms(columns[:, 1:3], columns[:, 3:5], light_class)
    measured, *wanted = np.nan_to_num(columns[first] - columns[second], nan=DARK)[:, [0, *range(5, columns.shape[1])]].T
    pairs = _Pairs(measured, np.take(terms, first, axis=1) - np.take(terms, second, axis=1), precision, len(columns))
    scatter = max(min(pairs.scatter(change) for change in wanted), SMALLEST_SCATTER)
    found = [min(pairs.cost(gamma * change, scatter) for gamma in GAMMAS) for change in wanted]
    return [min(none, left + LEFT_PRICE) for none, left in zip(found[::2], found[1::2], strict=True)]


def _curves(predicted: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The prediction (N,), and what it looks like with other light in it."""
    around = predicted - np.median(predicted[np.isfinite(predicted)]) if np.isfinite(predicted).any() else predicted
    return around, np.log(np.exp(around) + LEFT_LIGHT)


@dataclass(frozen=True, slots=True, eq=False)
class _Pairs:
    """Differences of log light between P pairs of neighbours, and the terms that all candidates share.

    Attributes
    ----------
    measured : (P,).
    terms : (K, P) differences of the shared terms.
    precision : (K,) of their coefficients, around zero.
    points : how many points the pairs are made of.
    """

    measured: FloatArray
    terms: FloatArray
    precision: FloatArray
    points: int

    def scatter(self, predicted: FloatArray) -> float:
        """Robust standard deviation that the best curve leaves, starting from what neighbours differ by at all."""
        scatters: list[float] = []
        for gamma in GAMMAS:
            scatter = _deviation(self.measured - gamma * predicted)
            for _ in range(ROUNDS):
                residual, _ = self._fitted(gamma * predicted, scatter, rounds=1)
                scatter = max(_deviation(residual), SMALLEST_SCATTER)
            scatters.append(scatter)
        return min(scatters)

    def cost(self, predicted: FloatArray, scatter: float) -> float:
        """-2 log posterior of the best shared terms."""
        residual, coefficients = self._fitted(predicted, scatter, rounds=ROUNDS)
        loss = CAUCHY**2 * np.log1p((residual / (CAUCHY * scatter)) ** 2)
        return float(loss.sum()) * self._share() + float(self.precision @ coefficients**2)

    def _share(self) -> float:
        return self.points / len(self.measured)

    def _fitted(self, predicted: FloatArray, scatter: float, rounds: int) -> tuple[FloatArray, FloatArray]:
        """Residuals (P,) and coefficients (K,) by reweighted least squares."""
        target = self.measured - predicted
        residual, coefficients = target, np.zeros(len(self.terms))
        for _ in range(rounds):
            weights = self._share() / scatter**2 / (1 + (residual / (CAUCHY * scatter)) ** 2)
            weighted = self.terms * weights
            information = weighted @ self.terms.T + np.diag(self.precision)
            coefficients = cast(FloatArray, np.linalg.solve(information, weighted @ target))
            residual = target - coefficients @ self.terms
        return residual, coefficients


def _deviation(values: FloatArray) -> float:
    return MAD_TO_SIGMA * quantile(np.abs(values), 0.5)


def _neighbours(x: FloatArray) -> tuple[IntArray, IntArray]:
    """Both ends (P,) of the pairs of nearest neighbours, each pair once."""
    nearest = nearest_of_all(x, x, min(NEIGHBOURS + 1, len(x)))[1][:, 1:]
    own = np.repeat(np.arange(len(x)), nearest.shape[1])
    ends = np.sort(np.stack([own, nearest.ravel()], axis=1), axis=1)
    pairs = np.unique(ends[ends[:, 0] != ends[:, 1]], axis=0)
    return pairs[:, 0], pairs[:, 1]


def _merged(columns: FloatArray, light_class: IntArray, rng: np.random.Generator) -> tuple[FloatArray, IntArray]:
    """At most some MOST_POINTS rows: means over squares of the picture, or, of several classes, a part of the rows."""
    if len(np.unique(light_class)) > 1:
        rows = np.sort(rng.choice(len(columns), MOST_POINTS, replace=False))
        return columns[rows], light_class[rows]
    x = columns[:, 1:3]
    low, high = x.min(axis=0), x.max(axis=0)
    width, height = np.maximum(high - low, 1e-12).tolist()
    side = float(np.sqrt(width * height / MOST_POINTS))
    across = np.floor((x - low) / side).astype(np.int64)
    _, square, count = np.unique(
        across[:, 0] * (across[:, 1].max() + 1) + across[:, 1], return_inverse=True, return_counts=True
    )
    merged = np.stack([np.bincount(square, column) / count for column in columns.T], axis=1)
    full = count * 2 >= np.median(count)
    return merged[full], np.zeros(int(full.sum()), dtype=np.int64)


def _shared_terms(x: FloatArray, raster: FloatArray, light_class: IntArray) -> tuple[FloatArray, FloatArray]:
    """Terms (K, N) that lenses, lamp and classes add, and the precision (K,) of their coefficients."""
    terms = [raster[:, 0], raster[:, 1], (raster**2).sum(axis=1) / 2, -2 * np.log1p((x**2).sum(axis=1))]
    sigmas = [PROJECTOR_SLOPE] * 2 + [PROJECTOR_CURVE, CAMERA_FALL_OFF]
    classes = np.unique(light_class)[1:]
    terms += [np.asarray(light_class == one, dtype=np.float64) for one in classes]
    return np.stack(terms), 1 / np.array(sigmas + [CLASS_SIGMA] * len(classes)) ** 2
