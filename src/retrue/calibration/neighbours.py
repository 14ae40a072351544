"""Neighbouring points err alike: the decoder, the print and the shape of the board see to that.

The fit weighs every point as if it erred by itself. That costs its estimate little, but its covariance would be too
small by the number of points that share one error. Here the noise of each group of observations, in each coordinate, is
own I + shared K, with K_ij = exp(-d_ij^2 / 2 length^2) between points of one view, d_ij apart; both variances from the
residuals' own moments, freed of what the unknowns absorbed (Rao 1971, MINQUE). What a board's corners share in all
views joins them, see `printed`: views do not average it out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, cast

import numpy as np
from scipy import sparse

from retrue.calibration.bundle import Adjusted, NormalEquations, Problem
from retrue.calibration.jacobians import linearise
from retrue.calibration.observations import CornerObservations, Group
from retrue.calibration.printed import Sparse, printed_factors
from retrue.calibration.setup import OF_VIEW
from retrue.geometry.arrays import FloatArray, IntArray

LENGTH = 1 / 16
"""Of the correlation, in widths of the picture."""
CHANCE = 2.0
"""A shared variance below that many of its standard deviations is taken for chance."""


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """One coordinate of a group, in sigmas: residuals (N,), derivatives (N, columns), U and K of `variances`.

    repeated : of each kind of noise that all views share, F (N, K).
    """

    view: IntArray
    size: FloatArray
    J: FloatArray
    taken: FloatArray
    kernels: list[FloatArray]
    repeated: list[Sparse]


def gradient_covariance(fit: Adjusted, groups: tuple[Group, ...]) -> FloatArray:
    """(shared, shared) covariance of the fit's gradient: its normal matrix, had every point an error of its own."""
    linearised = tuple(linearise(fit.setup, group) for group in groups)
    equations = NormalEquations(fit.setup, Problem(groups, fit.active, True), linearised, fit.scales)
    root, matrices = equations.root(), equations.total.copy()
    corners, apart = list[_Rows](), list[list[_Rows]]()
    printed = printed_factors(fit.setup, groups, linearised)
    noise = zip(groups, fit.scales, fit.weights, linearised, printed, strict=True)
    for group, scale, weight, (error, jacobian), factors in noise:
        whitened = np.broadcast_to(np.sqrt(weight) / (group.sigma[:, None] * scale), error.shape)
        kernels, both = _kernels(fit, group), list[_Rows]()
        for axis, own in enumerate(whitened.T):
            J = jacobian[:, axis] * own[:, None]
            repeated = [factor.multiply(own[:, None]).tocsr() for factor in factors[axis]]
            both.append(_Rows(group.view, error[:, axis] * own, J, _taken(J, group, fit, root), kernels, repeated))
        if isinstance(group, CornerObservations):
            corners += both
        else:
            apart += [[rows] for rows in both]
    through: list[FloatArray] = []
    for parts in (corners, *apart):
        own, shared, *others = variances(
            np.concatenate([part.size for part in parts]),
            np.concatenate([part.taken for part in parts]),
            [kernel for part in parts for kernel in part.kernels],
            [
                cast("Any", sparse).vstack(own, format="csr")
                for own in zip(*(part.repeated for part in parts), strict=True)
            ],
        )
        for part in parts:
            for view, kernel in enumerate(part.kernels):
                rows = part.J[part.view == view]
                matrices[view] += rows.T @ ((own - 1) * rows + shared * (kernel @ rows))
        for kind, variance in enumerate(others):
            through.append(np.sqrt(variance) * equations.repeated(_by_view(parts, kind, len(matrices))))
    return equations.eliminated(matrices) + sum(part @ part.T for part in through)


def _by_view(parts: list[_Rows], kind: int, views: int) -> FloatArray:
    """(views, columns, K) of each view's gradient by that noise."""
    seen = [[part.view == view for part in parts] for view in range(views)]
    return np.stack(
        [
            np.sum([part.J[rows].T @ part.repeated[kind][rows] for part, rows in zip(parts, own, strict=True)], axis=0)
            for own in seen
        ]
    )


def variances(
    size: FloatArray, taken: FloatArray, kernels: list[FloatArray], repeated: Sequence[Sparse] = ()
) -> tuple[float, ...]:
    """Of the noise that each point has of its own, of that which it shares with its neighbours, and of the `repeated`.

    Parameters
    ----------
    size : (N,) residuals in sigmas, view after view.
    taken : (N, P) U, such that independent noise leaves residuals of the covariance A = I - U U'.
    kernels : of each view, K.
    repeated : of each kind of noise that views share, F (N, K): its covariance is F F'.
    """
    count = len(size)
    if not size.any():
        return 1.0, *(0.0,) * (1 + len(repeated))
    starts = np.cumsum([0, *map(len, kernels)])
    views = [slice(*ends) for ends in pairwise(starts)]
    smooth = np.concatenate([K @ taken[view] for K, view in zip(kernels, views, strict=True)])
    near = sum(size[view] @ K @ size[view] for K, view in zip(kernels, views, strict=True))
    inner, crossed, overlap = taken.T @ taken, taken.T @ smooth, float(np.sum(taken * smooth))
    moments = np.array([size @ size, near, *(np.sum((size @ factor) ** 2) for factor in repeated)])
    expected = np.zeros((len(moments), len(moments)))  # tr V A of what is own, tr V A W A of the rest
    expected[:2, :2] = [
        [count - np.trace(inner), count - 2 * overlap + np.sum(crossed * inner)],
        [count - overlap, sum(float(np.sum(K * K)) for K in kernels) - 2 * np.sum(smooth**2) + np.sum(crossed**2)],
    ]
    absorbed = [taken.T @ factor for factor in repeated]
    for kind, (factor, own) in enumerate(zip(repeated, absorbed, strict=True), start=2):
        whole = factor.power(2).sum()
        expected[0, kind] = whole - 2 * np.sum(own**2) + np.sum(own * (inner @ own))
        expected[kind, 0] = whole - np.sum(own**2)
        alike = sum(factor[view].multiply(K @ factor[view]).sum() for K, view in zip(kernels, views, strict=True))
        expected[1, kind] = alike - 2 * np.sum(own * (smooth.T @ factor)) + np.sum(own * (crossed @ own))
        expected[kind, 1] = expected[1, kind]
        for other, (second, its) in enumerate(zip(repeated, absorbed, strict=True), start=2):
            expected[kind, other] = np.sum(((factor.T @ second).toarray() - own.T @ its) ** 2)
    return _told(moments, expected)


def _told(moments: FloatArray, expected: FloatArray) -> tuple[float, ...]:
    """The variances that explain the moments, without those that may be chance."""
    kept = list(range(len(moments)))
    while True:
        inverse = np.linalg.pinv(expected[np.ix_(kept, kept)])
        found = inverse @ moments[kept]
        surety = found / np.sqrt(2 * np.maximum(np.diag(inverse), 1e-300))
        surety[np.equal(kept, 0)] = np.inf if found[0] > 0 or len(kept) == 1 else -np.inf
        if surety[least := int(np.argmin(surety))] > CHANCE or len(kept) == 1:
            break
        del kept[least]
    variance = np.zeros(len(moments))
    variance[kept] = found
    return tuple(variance.tolist()) if kept != [0] else (1.0, *variance[1:].tolist())


def _taken(J: FloatArray, group: Group, fit: Adjusted, root: FloatArray) -> FloatArray:
    """U of `variances`: the derivatives (N, columns) by all free unknowns, times the root of their covariance."""
    free = int(fit.active.sum())
    taken = J[:, :-OF_VIEW][:, fit.active] @ root[:free]
    for view in range(len(fit.setup.first_from_board)):
        own = group.view == view
        taken[own] += J[own, -OF_VIEW:] @ root[free + view * OF_VIEW : free + (view + 1) * OF_VIEW]
    return taken


def _kernels(fit: Adjusted, group: Group) -> list[FloatArray]:
    """Of each view, how alike its points err."""
    corners = isinstance(group, CornerObservations)
    pixels = group.pixels if corners else group.camera_px
    length = LENGTH * fit.setup.devices[group.device if corners else 0].size[0]
    kernels: list[FloatArray] = []
    for view in range(len(fit.setup.first_from_board)):
        own = pixels[group.view == view]
        square = np.sum(own**2, axis=1)
        distance = np.maximum(square[:, None] + square - 2 * own @ own.T, 0)
        kernels.append(np.exp(-0.5 * distance / length**2))
    return kernels
