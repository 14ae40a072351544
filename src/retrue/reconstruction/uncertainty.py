"""How sure each point of a cloud is: what it errs by itself, and what all points share because the rig errs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.reconstruction.sensitivity import pixels_by_rig, point_by_pixels
from retrue.rig import Rig
from retrue.rig_evidence import RIG_NUMBERS, rig_covariance
from retrue.values import ByValue

Errors = Literal["own", "common", "all"]
BLOCK = 1 << 15  # points at a time: what fits into the processor's cache
NEGLIGIBLE = 1e-12  # of the largest variance: a direction in which the rig is exact


@dataclass(frozen=True, slots=True, eq=False)
class Uncertainty(ByValue):
    """What the N points of a cloud rest on.

    A point errs by itself, by the noise of its two pixels; and it errs with all others, since the rig that places them
    is not exact. The first averages out over many points, the second never does.

    Attributes
    ----------
    rig : that placed them.
    axes : projector coordinates that were known, as `Correspondences.axes`.
    camera_sigma_px, projector_sigma_px : (N,) one standard deviation per axis of each point's own noise; NaN of a
        point that nobody measured.
    projector_sigma_ratio : (N,) of the projector's x over its y, whose root mean square is the other; None: alike.
    """

    rig: Rig
    axes: tuple[int, ...]
    camera_sigma_px: FloatArray
    projector_sigma_px: FloatArray
    projector_sigma_ratio: FloatArray | None = None

    def select(self, rows: IntArray | BoolArray) -> Uncertainty:
        """The same of those points only."""
        camera, projector = self.camera_sigma_px[rows], self.projector_sigma_px[rows]
        ratio = None if self.projector_sigma_ratio is None else self.projector_sigma_ratio[rows]
        return replace(self, camera_sigma_px=camera, projector_sigma_px=projector, projector_sigma_ratio=ratio)

    def scaled(self, level: FloatArray) -> Uncertainty:
        """The same of points that err so many times as much by themselves, (N,)."""
        camera, projector = level * self.camera_sigma_px, level * self.projector_sigma_px
        return replace(self, camera_sigma_px=camera, projector_sigma_px=projector)

    def along_rays(self, points: FloatArray) -> FloatArray:
        """(N,) sigma of each point's own error along the camera's ray, in the rig's unit."""

        def sigma(part: slice) -> FloatArray:
            X = points[part]
            ray = X / np.linalg.norm(X, axis=1, keepdims=True)
            B = point_by_pixels(self.rig, X, self.axes)
            return np.sqrt(((ray[:, None] @ B)[:, 0] ** 2 * self._variances(part)).sum(axis=1))

        return _by_blocks(len(points), (), sigma)

    def covariance(self, points: FloatArray, errors: Errors) -> FloatArray:
        """(N, 3, 3) of points (N, 3), in the rig's unit squared."""

        def of(part: slice) -> FloatArray:
            total = np.zeros((len(points[part]), 3, 3))
            if errors != "common":
                B = point_by_pixels(self.rig, points[part], self.axes)
                total += (B * self._variances(part)[:, None]) @ np.swapaxes(B, 1, 2)
            if errors != "own":
                shifts = self._shifts(points[part], root)
                total += shifts @ np.swapaxes(shifts, 1, 2)
            return total

        root = covariance_root(rig_covariance(self.rig)) if errors != "own" else np.empty((RIG_NUMBERS, 0))
        return _by_blocks(len(points), (3, 3), of)

    def shifts(self, points: FloatArray) -> FloatArray:
        """(N, 3, K) how far each of K independent errors of the rig, one sigma each, moves the points (N, 3)."""
        root = covariance_root(rig_covariance(self.rig))
        return _by_blocks(len(points), (3, root.shape[1]), lambda part: self._shifts(points[part], root))

    def _shifts(self, points: FloatArray, root: FloatArray) -> FloatArray:
        B = point_by_pixels(self.rig, points, self.axes)
        return -B @ (pixels_by_rig(self.rig, points, self.axes) @ root)

    def _variances(self, part: slice) -> FloatArray:
        ratio = None if self.projector_sigma_ratio is None else self.projector_sigma_ratio[part]
        return pixel_variances(self.axes, self.camera_sigma_px[part], self.projector_sigma_px[part], ratio)


def pixel_variances(
    axes: tuple[int, ...], camera: FloatArray, projector: FloatArray, ratio: FloatArray | None
) -> FloatArray:
    """(N, 2 + len(axes)) of each point's pixels, from one sigma (N,) per axis, and the ratio of the projector's two.

    >>> pixel_variances((0, 1), np.array([0.1]), np.array([0.5]), np.array([0.75])).round(2).tolist()
    [[0.01, 0.01, 0.18, 0.32]]
    """
    both = [projector**2] * len(axes)
    if ratio is not None and len(axes) == 2:
        y = 2 * projector**2 / (1 + ratio**2)
        both = [ratio**2 * y, y]
    return np.stack([camera**2, camera**2, *both], axis=1)


def covariance_root(covariance: FloatArray) -> FloatArray:
    """(P, K) with S S^T = covariance (P, P), of as many columns as it has directions that vary."""
    values, vectors = np.linalg.eigh(covariance)
    kept = values > NEGLIGIBLE * max(float(values[-1]), 0.0)
    return vectors[:, kept] * np.sqrt(values[kept])


def _by_blocks(count: int, row: tuple[int, ...], function: Callable[[slice], FloatArray]) -> FloatArray:
    found = np.empty((count, *row))
    for first in range(0, count, BLOCK):
        part = slice(first, first + BLOCK)
        found[part] = function(part)
    return found
