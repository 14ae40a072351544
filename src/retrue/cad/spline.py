"""B-spline surfaces of inverse depth, which are NURBS exactly.

A surface that the camera sees is a function w(x, y) of the ray (X / Z, Y / Z), w = 1 / Z. Its noise is even in w, so
w is fitted, linearly, by a tensor product of cubic B-splines: w = sum c_ij B_i(x) B_j(y). The points of the surface
are (x, y, 1) / w, and x, y and 1 are splines too, with the Greville abscissae xi, eta and 1 as coefficients. So the
surface is the rational B-spline with weights c_ij and poles (xi_i, eta_j, 1) / c_ij: nothing is lost on the way to CAD.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from retrue.cad.surfaces import Kind
from retrue.geometry.arrays import FloatArray
from retrue.values import ByValue

DEGREE = 3
STIFFNESS = 1e-7  # of the penalty on second differences, per point: enough to carry on where there are none
FARTHEST_OUT = 4.0  # coefficients are kept within this factor of the points' own range of w


@dataclass(frozen=True, slots=True, eq=False)
class SplineSurface(ByValue):
    """w(x, y) = sum c_ij B_i(x) B_j(y); (u, v) are the ray (x, y) itself.

    Attributes
    ----------
    x_knots, y_knots : the full knot vectors, clamped, cubic.
    coefficients : (I, J) c_ij, all positive, one over the cloud's unit.
    """

    x_knots: FloatArray
    y_knots: FloatArray
    coefficients: FloatArray

    @property
    def kind(self) -> Kind:
        return "b-spline"

    def poles(self) -> tuple[FloatArray, FloatArray]:
        """Poles (I, J, 3) in the cloud's unit and weights (I, J), the latter about 1."""
        c = self.coefficients
        xi, eta = np.meshgrid(_greville(self.x_knots), _greville(self.y_knots), indexing="ij")
        return np.stack([xi, eta, np.ones_like(c)], axis=-1) / c[..., None], c / c.mean()

    def distances(self, points: FloatArray) -> FloatArray:
        """To first order: 1 - Z w(x, y) over the gradient of Z w(X / Z, Y / Z)."""
        rays = points[:, :2] / points[:, 2:]
        w = self._evaluated(rays, 0, 0)
        a, b = self._evaluated(rays, 1, 0), self._evaluated(rays, 0, 1)
        gradient = np.sqrt(a**2 + b**2 + (w - (rays * np.column_stack([a, b])).sum(axis=1)) ** 2)
        return (1 - points[:, 2] * w) / gradient

    def parameters(self, rays: FloatArray) -> FloatArray:
        return rays

    def _evaluated(self, rays: FloatArray, x_derivative: int, y_derivative: int) -> FloatArray:
        """w or a derivative (N,) at rays (N, 2); those outside of the knots as on their border."""
        from scipy.interpolate import NdBSpline

        low = [self.x_knots[0], self.y_knots[0]]
        high = [self.x_knots[-1], self.y_knots[-1]]
        spline = cast("Any", NdBSpline)((self.x_knots, self.y_knots), self.coefficients, DEGREE)
        return spline(np.clip(rays, low, high), nu=(x_derivative, y_derivative))


def fit_spline(points: FloatArray, intervals: tuple[int, int]) -> SplineSurface:
    """Least squares of w of points (N, 3) over their rays, with so many intervals of knots along x and along y."""
    from scipy.interpolate import BSpline
    from scipy.sparse import linalg

    rays, w = points[:, :2] / points[:, 2:], 1 / points[:, 2]
    knots = [_clamped(axis, count) for axis, count in zip(rays.T, intervals, strict=True)]
    along_x, along_y = (
        cast("Any", BSpline).design_matrix(axis, knot, DEGREE) for axis, knot in zip(rays.T, knots, strict=True)
    )
    size = along_x.shape[1], along_y.shape[1]
    terms = _products(along_x, along_y)
    mean = float(w.mean())
    normal = terms.T @ terms + STIFFNESS * len(w) * _stiffness(size)
    solution: FloatArray = cast("Any", linalg).spsolve(normal.tocsc(), terms.T @ (w / mean))
    coefficients = np.clip(solution * mean, w.min() / FARTHEST_OUT, w.max() * FARTHEST_OUT)
    return SplineSurface(knots[0], knots[1], coefficients.reshape(size))


def _clamped(values: FloatArray, intervals: int) -> FloatArray:
    """The knot vector of even intervals over the values."""
    low, high = float(values.min()), float(values.max())
    return np.concatenate([np.full(DEGREE, low), np.linspace(low, high, intervals + 1), np.full(DEGREE, high)])


def _greville(knots: FloatArray) -> FloatArray:
    """Coefficients of the spline x itself: means of DEGREE knots."""
    return np.lib.stride_tricks.sliding_window_view(knots[1:-1], DEGREE).mean(axis=1)


def _products(along_x: Any, along_y: Any) -> Any:
    """Sparse (N, I * J) of the products B_i(x) B_j(y)."""
    from scipy.sparse import csr_array

    count, width = along_x.shape[0], along_y.shape[1]
    x_index, y_index = (matrix.indices.reshape(count, DEGREE + 1) for matrix in (along_x, along_y))
    x_value, y_value = (matrix.data.reshape(count, DEGREE + 1) for matrix in (along_x, along_y))
    columns = (x_index[:, :, None] * width + y_index[:, None, :]).ravel()
    values = (x_value[:, :, None] * y_value[:, None, :]).ravel()
    starts: list[int] = list(range(0, len(values) + 1, (DEGREE + 1) ** 2))
    return cast("Any", csr_array)((values, columns, starts), shape=(count, along_x.shape[1] * width))


def _stiffness(size: tuple[int, int]) -> Any:
    """Sum of squared second differences of the coefficients along both axes: nothing for a plane of even knots."""
    from scipy import sparse

    library = cast("Any", sparse)
    first, second = (
        library.diags_array([1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(length - 2, length)) for length in size
    )
    return library.kron(first.T @ first, library.eye_array(size[1])) + library.kron(
        library.eye_array(size[0]), second.T @ second
    )
