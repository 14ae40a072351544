"""Noise that is not alike along both axes: no evidence for epipolar lines that run along one of them.

Stripes, and blocks seen aslant, are known better across than along; what one device alone errs by is longer one way
where the other sees it aslant. A pose whose lines run along the louder axis has less noise across them, right or not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.robust import SMALLEST_LEVEL, biweight_level
from retrue.geometry.transform import skew
from retrue.geometry.two_view import FREE, TwoViewPoints, TwoViewPose

TWO_PARAMETERS = 24.0  # of chi-square, as elsewhere: by less, noise is alike along all axes
FEWEST = 10
WITHOUT_NEIGHBOURS = 0.8  # of the variance of a difference from the mean of four is that of one

Frame = Literal["both devices", "camera", "projector"]
FRAMES: tuple[Frame, ...] = "both devices", "camera", "projector"


@dataclass(frozen=True, slots=True, eq=False)
class NoiseShape:
    """A match's noise is F S F of the projector's rays: S along the axes of whose pixels it is.

    Attributes
    ----------
    frame : F^2 = sx^2 J J^T + sy^2 I, or one of both terms.
    covariance : S (2, 2).
    slopes : (N, 2, 2) J = d y / d x of each point's plane, by its homography, whatever a pose makes of it; of
        points on none, their mean.
    """

    frame: Frame
    covariance: FloatArray
    slopes: FloatArray

    def of(self, points: TwoViewPoints, homographies: Sequence[FloatArray]) -> NoiseShape:
        """The same of other points on those planes."""
        return replace(self, slopes=_moved(homographies, points)[1])

    def select(self, rows: IntArray | BoolArray) -> NoiseShape:
        """The same of those points."""
        return replace(self, slopes=self.slopes[rows])


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


def noise_shape(points: TwoViewPoints, homographies: Sequence[FloatArray], neighbours: IntArray) -> NoiseShape | None:
    """How a match's noise is shaped, by what the homographies of planes leave; None where it is alike along all axes.

    That is, where it is a multiple of F^2 of both devices, as their sigmas have it: other shapes have two parameters
    more, and n log det S + sum log det F^2 of n points, their likelihood, must be clearly less. From what a point is
    missed by, what the four nearest of the same plane (N, 4) are on average is taken: so the bow of a plane, and what
    neighbours share, is none of it. Levels of S along the axes and along both diagonals are robust.
    """
    beside = points.plane_index[neighbours] == points.plane_index[:, None]
    rows = np.flatnonzero((points.plane_index != FREE) & beside.all(axis=1))
    if len(rows) < FEWEST or not len(homographies):
        return None
    there, J = _moved(homographies, points)
    missed = points.projector_rays - there
    apart = missed[rows] - missed[neighbours[rows]].mean(axis=1)
    shapes: list[NoiseShape] = []
    costs: list[float] = []
    even = np.inf
    for frame in FRAMES:
        square = _square(frame, J[rows], points.camera_sigma[rows], points.projector_sigma[rows])
        F, determinant = _root(square)
        with np.errstate(divide="ignore", invalid="ignore"):
            own = np.einsum("nij,nj->ni", _adjugate(F), apart) / np.sqrt(determinant)[:, None]
            logarithm = np.log(determinant)
        good = np.isfinite(own).all(axis=1) & np.isfinite(logarithm)
        if np.count_nonzero(good) < max(FEWEST, len(rows) // 2):
            continue  # a device that is exact has no noise
        S = _robust_covariance(own[good])
        if not np.linalg.det(S) > 0:
            continue
        shapes.append(NoiseShape(frame, S * WITHOUT_NEIGHBOURS, J))
        costs.append(len(rows) * float(np.log(np.linalg.det(S)) + np.mean(logarithm[good])))
        if frame == FRAMES[0]:
            even = costs[0] + len(rows) * float(2 * np.log(np.trace(S) / 2) - np.log(np.linalg.det(S)))
    if not np.isfinite(even) or not even - min(costs) > TWO_PARAMETERS:
        return None
    return shapes[int(np.argmin(costs))]


def line_noise(pose: TwoViewPose, points: TwoViewPoints, shape: NoiseShape) -> LineNoise:
    """Variances across and along each point's epipolar line of the projector, in the points' own sigma.

    What lies across the line of normal l is l . r / (l^T C l)^1/2, with C = F^2 of both devices; what lies along it,
    orthogonal in C, is l' . r / (l'^T C l')^1/2, with C l' at right angles to l. Even: sqrt(det S), in the same unit.

    >>> points = TwoViewPoints(*np.zeros((2, 1, 2)), *np.ones((2, 1)), np.array([-1]))
    >>> shape = NoiseShape("both devices", np.diag([4, 0.25]), np.eye(2)[None])
    >>> line_noise(TwoViewPose(np.eye(3), np.array([1.0, 0, 0])), points, shape).usual.round(9).tolist()
    [0.25, 4.0]
    """
    E: FloatArray = skew(pose.t) @ pose.R
    lines: FloatArray = points.camera_rays @ E[:2, :2].T + E[:2, 2]
    J = shape.slopes
    C = _square(FRAMES[0], J, points.camera_sigma, points.projector_sigma)
    square = C if shape.frame == FRAMES[0] else _square(shape.frame, J, points.camera_sigma, points.projector_sigma)
    F, determinant = _root(square)
    others = np.einsum("nij,nj->ni", C, lines) @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    variances: list[FloatArray] = []
    for direction in (lines, others):
        in_frame = np.einsum("nij,nj->ni", F, direction)
        loud = np.einsum("ni,ij,nj->n", in_frame, shape.covariance, in_frame)
        variances.append(loud / np.maximum(np.einsum("ni,nij,nj->n", direction, C, direction), 1e-300))
    logarithms = np.log(np.maximum(variances, SMALLEST_LEVEL**2))
    middle = logarithms.mean(axis=1)
    _, usual = _root(C)
    narrower: FloatArray = np.log(np.maximum(determinant, 1e-300) / np.maximum(usual, 1e-300))
    even = float(np.sqrt(np.linalg.det(shape.covariance)) * np.exp(narrower.mean() / 2))
    return LineNoise(np.exp((logarithms.T - middle).T / 2), np.exp(middle), even)


def _moved(homographies: Sequence[FloatArray], points: TwoViewPoints) -> tuple[FloatArray, FloatArray]:
    """(N, 2) where its plane's homography (P, 3, 3) has each point, and its slope J (N, 2, 2); NaN, and their mean."""
    there, J = np.full((len(points), 2), np.nan), np.full((len(points), 2, 2), np.nan)
    rows = np.flatnonzero(points.plane_index != FREE)
    if len(rows):
        H = np.array(homographies)[points.plane_index[rows]]
        moved: FloatArray = np.einsum("nij,nj->ni", H[:, :, :2], points.camera_rays[rows]) + H[:, :, 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            there[rows] = moved[:, :2] / moved[:, 2:]
            J[rows] = (H[:, :2, :2] - there[rows, :, None] * H[:, 2:, :2]) / moved[:, 2:, None]
    known = np.isfinite(J).all(axis=(1, 2))
    J[~known] = J[known].mean(axis=0) if known.any() else np.eye(2)
    return there, J


def _square(frame: Frame, J: FloatArray, camera_sigma: FloatArray, projector_sigma: FloatArray) -> FloatArray:
    """(N, 2, 2) F^2."""
    square = np.zeros(J.shape)
    if frame != "projector":
        square += camera_sigma[:, None, None] ** 2 * (J @ J.transpose(0, 2, 1))
    if frame != "camera":
        square += projector_sigma[:, None, None] ** 2 * np.eye(2)
    return square


def _root(square: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(N, 2, 2) F of F^2, and det F^2 (N,): F = (F^2 + I det F) / tr F, by Cayley and Hamilton."""
    xx, xy, yy = square[:, 0, 0], square[:, 0, 1], square[:, 1, 1]
    determinant: FloatArray = np.maximum(xx * yy - xy * xy, 0.0)
    root = np.sqrt(determinant)
    trace = np.sqrt(np.maximum(xx + yy + 2 * root, 1e-300))
    return (square + root[:, None, None] * np.eye(2)) / trace[:, None, None], determinant


def _adjugate(matrices: FloatArray) -> FloatArray:
    """(N, 2, 2) of symmetric ones: their inverses times their determinants."""
    return (matrices[:, 0, 0] + matrices[:, 1, 1])[:, None, None] * np.eye(2) - matrices


def _robust_covariance(own: FloatArray) -> FloatArray:
    x, y = np.ascontiguousarray(own.T)
    axes = x, y, (x + y) / np.sqrt(2), (x - y) / np.sqrt(2)
    xx, yy, rising, falling = (max(biweight_level(axis), SMALLEST_LEVEL) ** 2 for axis in axes)
    return np.array([[xx, (rising - falling) / 2], [(rising - falling) / 2, yy]])
