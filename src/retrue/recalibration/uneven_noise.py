"""Noise that is not alike along both axes of the projector: no evidence for epipolar lines that run along one of them.

Stripes, and blocks seen aslant, are known better across than along. A pose whose lines run along the louder axis has
less noise across them, whether it is right or not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.geometry.arrays import FloatArray, IntArray
from retrue.geometry.robust import SMALLEST_LEVEL, biweight_level
from retrue.geometry.transform import skew
from retrue.geometry.two_view import FREE, TwoViewPoints, TwoViewPose

TWO_PARAMETERS = 24.0  # of chi-square, as elsewhere: by less, noise is alike along all axes
FEWEST = 10
WITHOUT_NEIGHBOURS = 0.8  # of the variance of a difference from the mean of four is that of one


def noise_covariance(missed: FloatArray, plane_index: IntArray, neighbours: IntArray) -> FloatArray | None:
    """(2, 2) covariance S of a match's noise along the projector's axes, in its own sigma.

    By what the homographies of planes leave (N, 2), less what the four nearest of the same plane (N, 4) leave on
    average: so the bow of a plane, and what neighbours share, is none of it. Its levels along the axes and along both
    diagonals are robust. None where noise that is alike along all axes explains the n points as well, with two
    parameters less: n log ((tr S / 2)^2 / det S) is their likelihood ratio.
    """
    beside = plane_index[neighbours] == plane_index[:, None]
    rows = (plane_index != FREE) & beside.all(axis=1) & np.isfinite(missed).all(axis=1)
    number = int(np.count_nonzero(rows))
    if number < FEWEST:
        return None
    x, y = np.ascontiguousarray((missed[rows] - missed[neighbours[rows]].mean(axis=1)).T)
    axes = x, y, (x + y) / np.sqrt(2), (x - y) / np.sqrt(2)
    xx, yy, rising, falling = (max(biweight_level(axis), SMALLEST_LEVEL) ** 2 for axis in axes)
    covariance: FloatArray = np.array([[xx, (rising - falling) / 2], [(rising - falling) / 2, yy]])
    determinant, middle = float(np.linalg.det(covariance)), float(np.trace(covariance)) / 2
    if not determinant > 0 or number * np.log(middle**2 / determinant) < TWO_PARAMETERS:
        return None
    return covariance * WITHOUT_NEIGHBOURS


@dataclass(frozen=True, slots=True, eq=False)
class LineNoise:
    """How loud each residual is about its epipolar line.

    Attributes
    ----------
    relative : (2, N) standard deviations across and along the line, over the usual one of either.
    usual : (2,) their variances, geometric means.
    even : the variance, were it alike along all axes.
    """

    relative: FloatArray
    usual: FloatArray
    even: float


def line_noise(pose: TwoViewPose, points: TwoViewPoints, covariance: FloatArray) -> LineNoise:
    """Variances n^T S n and m^T S m across and along each point's epipolar line of the projector; even, sqrt(det S).

    >>> points = TwoViewPoints(*np.zeros((2, 1, 2)), *np.ones((2, 1)), np.array([-1]))
    >>> line_noise(TwoViewPose(np.eye(3), np.array([1.0, 0, 0])), points, np.diag([4, 0.25])).usual.round(9).tolist()
    [0.25, 4.0]
    """
    (xx, xy), (_, yy) = covariance
    E: FloatArray = skew(pose.t) @ pose.R
    lines: FloatArray = points.camera_rays @ E[:2, :2].T + E[:2, 2]
    u, v = (lines / np.maximum(np.linalg.norm(lines, axis=1, keepdims=True), 1e-300)).T
    across, along = xx * u**2 + 2 * xy * u * v + yy * v**2, xx * v**2 - 2 * xy * u * v + yy * u**2
    logarithms = np.log(np.maximum([across, along], SMALLEST_LEVEL**2))
    middle = logarithms.mean(axis=1)
    return LineNoise(np.exp((logarithms.T - middle).T / 2), np.exp(middle), float(np.sqrt(np.linalg.det(covariance))))
