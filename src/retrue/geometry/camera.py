"""A pinhole camera with lens distortion; a projector is one too, run backwards.

Integer pixel coordinates lie at pixel centres: (0, 0) is the centre of the top-left pixel.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from retrue.errors import InputError
from retrue.geometry.arrays import BoolArray, FloatArray, finite_array, frozen_array, whole_size
from retrue.kernels import lenses as kernel
from retrue.shown import ShortRepr, Shown, vector
from retrue.values import ByValue

DISTORTION_LENGTHS = (0, 4, 5, 8, 12)
SAME_RAY = 1e-6  # rounding is far below, another side of a fold far above


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Camera(ByValue, ShortRepr):
    """pixel ~ K distort(X / Z): m = alpha K X, eqs (3) and (4) of Zhang, Li, Wu 2007, with a lens.

    Attributes
    ----------
    size : (width, height) in pixels.
    K : (3, 3) upper triangular, K[2, 2] = 1, focal lengths positive; K[0, 1] is skew.
    distortion : OpenCV's order k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4]]]; 0, 4, 5, 8 or 12 numbers,
        kept as at least five.

    >>> camera = Camera((640, 480), [[500, 0, 320], [0, 500, 240], [0, 0, 1]], [-0.2, 0.1, 0, 0, 0])
    >>> pixel = camera.project([[0.3, -0.2, 1.0]])
    >>> pixel.round(3).tolist()
    [[466.354, 142.431]]
    >>> camera.unproject(pixel).round(9).tolist()
    [[0.3, -0.2]]
    """

    size: tuple[int, int]
    K: FloatArray
    distortion: FloatArray = field(default_factory=lambda: np.zeros(5))

    def __post_init__(self) -> None:
        size = whole_size(self.size, "size")
        K = finite_array(self.K, (3, 3), "K")
        if not (K[0, 0] > 0 and K[1, 1] > 0):
            raise InputError(f"K: expected positive focal lengths, found {K[0, 0]:g} and {K[1, 1]:g}")
        if not (K[1, 0] == 0 and K[2, 0] == 0 and K[2, 1] == 0 and K[2, 2] == 1):
            raise InputError("K: expected zeros below the diagonal and K[2][2] = 1")
        distortion = finite_array(self.distortion, (None,), "distortion")
        if len(distortion) not in DISTORTION_LENGTHS:
            raise InputError(f"distortion: expected {DISTORTION_LENGTHS} coefficients, found {len(distortion)}")
        if len(distortion) < 5:
            distortion = np.pad(distortion, (0, 5 - len(distortion)))
        object.__setattr__(self, "size", size)
        object.__setattr__(self, "K", frozen_array(K))
        object.__setattr__(self, "distortion", frozen_array(distortion))

    def project(self, points: ArrayLike) -> FloatArray:
        """Pixels (..., 2) of points (..., 3) of the camera's frame; NaN at or behind the camera (Z <= 0)."""
        points = np.asarray(points, dtype=np.float64)
        pixels = np.empty((*points.shape[:-1], 2))
        lens = self._coefficients, bool(self.distortion.any())
        kernel.project(self.K, *lens, np.ascontiguousarray(points).reshape(-1, 3), pixels.reshape(-1, 2))
        return pixels

    def unproject(self, pixels: ArrayLike) -> FloatArray:
        """Undistorted normalised rays (..., 2), (X / Z, Y / Z), of pixels (..., 2); NaN where no ray maps there."""
        return self.undistort(self.normalise(pixels))

    def normalise(self, pixels: ArrayLike) -> FloatArray:
        """K^-1 m: still distorted rays (..., 2) of pixels (..., 2)."""
        pixels = np.asarray(pixels, dtype=np.float64)
        y = (pixels[..., 1] - self.K[1, 2]) / self.K[1, 1]
        x = (pixels[..., 0] - self.K[0, 2] - self.K[0, 1] * y) / self.K[0, 0]
        return np.stack([x, y], axis=-1)

    def pixels_from_rays(self, rays: ArrayLike) -> FloatArray:
        """Pixels (..., 2) of undistorted rays (..., 2)."""
        return self.distort(rays) @ self.K[:2, :2].T + self.K[:2, 2]

    def distort(self, rays: ArrayLike) -> FloatArray:
        """OpenCV's lens model on normalised rays (..., 2)."""
        rays = np.asarray(rays, dtype=np.float64)
        if not self.distortion.any():
            return rays
        distorted = np.empty((*rays.shape[:-1], 2))
        kernel.distort(self._coefficients, _rows(rays), distorted.reshape(-1, 2))
        return distorted

    def undistort(self, distorted: ArrayLike) -> FloatArray:
        """Inverse of `distort`, to rounding: fixed-point steps, then Newton where they have not settled.

        NaN where the lens model cannot reach the point, or only beyond its fold (where it stops
        being one-to-one).
        """
        distorted = np.asarray(distorted, dtype=np.float64)
        if not self.distortion.any():
            return distorted
        rays = np.empty((*distorted.shape[:-1], 2))
        kernel.undistort(self._coefficients, _rows(distorted), np.empty((rays.size // 2, 2)), rays.reshape(-1, 2))
        return rays

    def ray_jacobian(self, rays: ArrayLike) -> FloatArray:
        """d pixel / d ray (..., 2, 2) at undistorted rays (..., 2)."""
        rays = np.asarray(rays, dtype=np.float64)
        (a, b), (c, d) = self._distortion_jacobian(rays[..., 0], rays[..., 1])
        lens = np.stack([np.stack([a, b], axis=-1), np.stack([c, d], axis=-1)], axis=-2)
        return self.K[:2, :2] @ lens

    def frustum(self, depth: float) -> FloatArray:
        """Corners (4, 3) of the picture at that depth, its outer edge; what the lens model cannot reach, without it.

        >>> Camera((4, 2), [[2, 0, 1.5], [0, 2, 0.5], [0, 0, 1]]).frustum(10.0)[2].tolist()
        [10.0, 5.0, 10.0]
        """
        width, height = self.size
        corners = np.array([[0, 0], [width, 0], [width, height], [0, height]]) - 0.5
        rays = self.unproject(corners)
        rays = np.where(np.isfinite(rays), rays, self.normalise(corners))
        return np.column_stack([rays, np.ones(4)]) * depth

    def contains(self, pixels: ArrayLike, margin: float = 0.5) -> BoolArray:
        """Which pixels (..., 2) lie in the picture; its edge is half a pixel beyond the outer centres."""
        pixels = np.asarray(pixels, dtype=np.float64)
        inside = (pixels >= -margin) & (pixels <= np.array(self.size) - 1 + margin)
        return inside[..., 0] & inside[..., 1]

    def sees(self, points: ArrayLike) -> BoolArray:
        """Which points (..., 3) of the camera's frame are in its picture; not those that the lens model folds into it.

        Beyond its picture a lens model may turn back, and so has points far outside at pixels whose rays are others.

        >>> camera = Camera((640, 480), [[500, 0, 320], [0, 500, 240], [0, 0, 1]], [-0.2, 0, 0, 0, 0])
        >>> camera.project([[2.2, 0, 1]]).round(1).tolist(), camera.sees([[0.6, 0, 1], [2.2, 0, 1]]).tolist()
        ([[355.2, 240.0]], [True, False])
        """
        points = np.asarray(points, dtype=np.float64)
        pixels = self.project(points)
        with np.errstate(invalid="ignore"):
            seen = np.asarray(self.contains(pixels))
        if self.distortion.any():
            rays = points[seen][..., :2] / points[seen][..., 2:]
            seen[seen] = (np.abs(self.unproject(pixels[seen]) - rays) <= SAME_RAY * (1 + np.abs(rays))).all(axis=-1)
        return seen

    @property
    def _coefficients(self) -> FloatArray:
        """All twelve, those that the lens model lacks zero."""
        return np.append(self.distortion, np.zeros(DISTORTION_LENGTHS[-1] - len(self.distortion)))

    def _distortion_jacobian(
        self, x: FloatArray, y: FloatArray
    ) -> tuple[tuple[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
        k1, k2, p1, p2, k3 = self.distortion[:5]
        r2 = x * x + y * y
        numerator = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = k1 + r2 * (2 * k2 + r2 * 3 * k3)  # d numerator / d r2
        radial = numerator
        if len(self.distortion) >= 8:
            k4, k5, k6 = self.distortion[5:8]
            denominator = 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
            radial = numerator / denominator
            slope = (slope - radial * (k4 + r2 * (2 * k5 + r2 * 3 * k6))) / denominator
        a = radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
        b = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
        c = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
        d = radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
        if len(self.distortion) >= 12:
            s1, s2, s3, s4 = self.distortion[8:12]
            thin_x, thin_y = 2 * (s1 + 2 * s2 * r2), 2 * (s3 + 2 * s4 * r2)
            a, b, c, d = a + thin_x * x, b + thin_x * y, c + thin_y * x, d + thin_y * y
        return (a, b), (c, d)

    def _shown(self) -> Shown:
        (width, height), (fx, skew, x), (_, fy, y) = self.size, self.K[0], self.K[1]
        lens = ", ".join(f"{number:.3g}" for number in self.distortion) if self.distortion.any() else "none"
        title = f"{width} x {height} px, focal lengths {vector([fx, fy], 5)}, centre {vector([x, y], 5)}"
        return f"{title}{f', skew {skew:.3g}' if skew else ''}, distortion {lens}", {}


def _rows(rays: FloatArray) -> FloatArray:
    """(N, 2) of rays (..., 2), as kernels take them."""
    return np.ascontiguousarray(rays[..., :2]).reshape(-1, 2)
