"""Plane homographies: target ~ H source, fitted by maximum likelihood.

Eqs (11) to (14) of Zhang, Li, Wu 2007 fit H by plain linear least squares. That costs up to eight times the
attainable error on a small patch, so the linear fit here is Hartley's normalised one, and only the start.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from retrue.errors import DegenerateError, InputError
from retrue.geometry.arrays import FloatArray, finite_array
from retrue.kernels import homography as kernel
from retrue.ranges import require_number

MINIMAL_POINTS = 4
NONE = np.empty(0)  # no weights: equal ones; no start: the linear fit
SETTLED = 1e-6  # step of the normalised H; the next is a thousandth of it, and lost in rounding


def fit_homography(
    source: ArrayLike,
    target: ArrayLike,
    *,
    source_sigma: float = 1.0,
    target_sigma: float = 1.0,
    weights: ArrayLike | None = None,
    iterations: int = 5,
) -> FloatArray:
    """Maximum-likelihood homography for Gaussian noise in both images, target ~ H source.

    Minimises sum_i w_i min over s of |source_i - s|^2 / source_sigma^2 + |target_i - H(s)|^2 / target_sigma^2
    by Gauss-Newton from the normalised linear fit. Each step works at the corrected points s
    (Sampson's correction), so that it settles where the full bundle adjustment does, not near it.

    Parameters
    ----------
    source, target : (N, 2), N >= 4, any unit; for poses: undistorted normalised rays.
    source_sigma, target_sigma : noise per axis in the units of source and target; only their ratio matters.
        Zero stands for an exact image; not both.
    weights : (N,) inverse relative variance of each point, or None.
    iterations : at most so many steps; two are enough below a pixel of noise.

    Returns
    -------
    (3, 3) H of Frobenius norm 1, signed so that (H source)_3 > 0 at most points.

    Raises
    ------
    InputError : shapes that differ, NaN, fewer than four points.
    DegenerateError : the points do not determine H (three of four, or all, on one line; all in one place).

    Source: eq. (12) to (14); Hartley and Zisserman 2004, 4.2.6 and 4.4.

    >>> square = [[0, 0], [1, 0], [1, 1], [0, 1], [0.5, 0.2]]
    >>> H = fit_homography(square, apply_homography([[2, 0.1, 3], [0.3, 1, 1], [0.2, 0.1, 1]], square))
    >>> (H / H[2, 2]).round(9).tolist()
    [[2.0, 0.1, 3.0], [0.3, 1.0, 1.0], [0.2, 0.1, 1.0]]
    """
    for name, sigma in (("source_sigma", source_sigma), ("target_sigma", target_sigma)):
        require_number(sigma, name, 0)
    require_number(iterations, "iterations", 0, whole=True)
    if not (source_sigma >= 0 and target_sigma >= 0 and source_sigma + target_sigma > 0):
        raise InputError(f"sigma: expected two numbers >= 0, not both zero, found {source_sigma} and {target_sigma}")
    H = np.empty((3, 3))
    rest = source_sigma, target_sigma, iterations, SETTLED, H
    try:
        if kernel.fit_homography(source, target, NONE if weights is None else weights, NONE, *rest):
            return H
    except (TypeError, ValueError):  # not float64 arrays in C order
        pass
    source, target, weights = _checked(source, target, weights)
    start = _fit_normalised(source, target, weights)[0].ravel()
    if not kernel.fit_homography(source, target, NONE if weights is None else weights, start, *rest):
        raise DegenerateError("homography: no finite fit; spread the points over a plane")
    return H


def fit_homography_linear(
    source: ArrayLike, target: ArrayLike, *, weights: ArrayLike | None = None, normalised: bool = True
) -> FloatArray:
    """Linear least squares, eqs (12) to (14); `normalised=False` is the paper's own, plain form.

    Shapes, sign and errors as in `fit_homography`.

    >>> H = fit_homography_linear([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 0], [2, 0], [2, 2], [0, 2]])
    >>> apply_homography(H, [[0.5, 0.25]]).round(9).tolist()
    [[1.0, 0.5]]
    """
    source, target, weights = _checked(source, target, weights)
    if not normalised:
        return _signed(_fit_linear(source, target, weights), source)
    H, source_frame, target_frame = _fit_normalised(source, target, weights)
    return _signed(np.linalg.inv(target_frame) @ H @ source_frame, source)


def apply_homography(H: ArrayLike, points: ArrayLike) -> FloatArray:
    """Points (..., 2) mapped by H (3, 3); NaN where they map to infinity.

    >>> apply_homography([[1, 0, 0], [0, 1, 0], [0.5, 0, 1]], [[2.0, 4.0]]).tolist()
    [[1.0, 2.0]]
    """
    H, points = np.asarray(H, dtype=np.float64), np.asarray(points, dtype=np.float64)
    mapped = points @ H[:, :2].T + H[:, 2]
    scale = np.where(mapped[..., 2:] != 0, mapped[..., 2:], np.nan)
    return mapped[..., :2] / scale


def homography_residuals(
    H: FloatArray, source: FloatArray, target: FloatArray, source_sigma: float = 1.0, target_sigma: float = 1.0
) -> FloatArray:
    """Whitened Sampson distance (N,) of each pair: its square is chi-square with two degrees of freedom.

    NaN where H maps a point to infinity.

    >>> homography_residuals(np.eye(3), np.zeros((1, 2)), np.array([[3.0, 4.0]])).round(6).tolist()
    [3.535534]
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        (dx, dy), (a, b, c) = _whitened(H, source, target, source_sigma, target_sigma)
        return np.sqrt((c * dx * dx - 2 * b * dx * dy + a * dy * dy) / (a * c - b * b))


def _checked(
    source: ArrayLike, target: ArrayLike, weights: ArrayLike | None
) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    source = np.ascontiguousarray(finite_array(source, (None, 2), "source points"))
    target = np.ascontiguousarray(finite_array(target, (len(source), 2), "target points"))
    if len(source) < MINIMAL_POINTS:
        raise InputError(f"homography: expected at least four points, found {len(source)}")
    if weights is None:
        return source, target, None
    weights = np.ascontiguousarray(finite_array(weights, (len(source),), "weights"))
    if not weights.min() >= 0:
        raise InputError(f"homography: expected weights >= 0, found {weights.min():g}")
    return source, target, weights


def _fit_normalised(
    source: FloatArray, target: FloatArray, weights: FloatArray | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Linear H (3, 3) between points normalised by the two frames, and these."""
    source_frame, target_frame = _normalising_frame(source), _normalising_frame(target)
    H = _fit_linear(_transformed(source_frame, source), _transformed(target_frame, target), weights)
    return H, source_frame, target_frame


def _normalising_frame(points: FloatArray) -> FloatArray:
    """Similarity to centroid 0 and mean distance sqrt 2 (Hartley 1997)."""
    center = points.mean(axis=0)
    spread = np.hypot(*(points - center).T).mean()
    if not spread > 1e-12 * max(1.0, float(np.abs(center).max())):
        raise DegenerateError("homography: all points lie at one place; spread them over a plane")
    scale = np.sqrt(2) / spread
    return np.array([[scale, 0, -scale * center[0]], [0, scale, -scale * center[1]], [0, 0, 1]])


def _transformed(frame: FloatArray, points: FloatArray) -> FloatArray:
    return frame[0, 0] * points + frame[:2, 2]


def _fit_linear(source: FloatArray, target: FloatArray, weights: FloatArray | None) -> FloatArray:
    """Smallest right singular vector of the design matrix of eq. (13)."""
    count = len(source)
    design = np.zeros((2 * count, 9))
    design[:count, 0:2] = design[count:, 3:5] = source
    design[:count, 2] = design[count:, 5] = 1
    design[:count, 6:8] = -target[:, :1] * source
    design[count:, 6:8] = -target[:, 1:] * source
    design[:count, 8], design[count:, 8] = -target[:, 0], -target[:, 1]
    if weights is not None:
        design *= np.sqrt(np.concatenate([weights, weights]))[:, None]
    if count > 50:  # the normal equations are exact enough to start from, and far smaller
        values, vectors = np.linalg.eigh(design.T @ design)
        h, second, largest = vectors[:, 0], np.sqrt(max(float(values[1]), 0.0)), np.sqrt(float(values[-1]))
    else:
        _, singular, vt = np.linalg.svd(design, full_matrices=True)
        h, second, largest = vt[8], float(singular[7]), float(singular[0])
    if not second > 1e-7 * largest:
        raise DegenerateError("homography: the points lie on one line; spread them over a plane")
    return h.reshape(3, 3)


def _whitened(
    H: FloatArray, source: FloatArray, target: FloatArray, source_sigma: float, target_sigma: float
) -> tuple[tuple[FloatArray, FloatArray], tuple[FloatArray, FloatArray, FloatArray]]:
    """Transfer error, and its covariance ((a, b), (b, c))."""
    mapped = source @ H[:, :2].T + H[:, 2]
    inverse_depth = 1 / mapped[:, 2]
    u, v = mapped[:, 0] * inverse_depth, mapped[:, 1] * inverse_depth
    p, q = (H[0, 0] - u * H[2, 0]) * inverse_depth, (H[0, 1] - u * H[2, 1]) * inverse_depth
    r, s = (H[1, 0] - v * H[2, 0]) * inverse_depth, (H[1, 1] - v * H[2, 1]) * inverse_depth
    vs, vt = source_sigma**2, target_sigma**2
    covariance = (vt + vs * (p * p + q * q), vs * (p * r + q * s), vt + vs * (r * r + s * s))
    return (target[:, 0] - u, target[:, 1] - v), covariance


def _signed(H: FloatArray, source: FloatArray) -> FloatArray:
    H = H / np.linalg.norm(H)
    depth = source @ H[2, :2] + H[2, 2]
    return -H if np.count_nonzero(depth > 0) * 2 < len(depth) else H
