"""Neighbouring points err alike: the decoder, the print and the shape of the board see to that.

The fit weighs every point as if it erred by itself. That costs its estimate little, but its covariance would be too
small by the number of points that share one error. Here the noise of each group of observations, in each coordinate, is
own I + shared K, with K_ij = exp(-d_ij^2 / 2 length^2) between points of one view, d_ij apart; both variances from the
residuals' own moments, freed of what the unknowns absorbed (Rao 1971, MINQUE).
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from retrue.calibration.bundle import Adjusted, NormalEquations, Problem
from retrue.calibration.jacobians import linearise
from retrue.calibration.observations import CornerObservations, Group
from retrue.calibration.setup import OF_VIEW
from retrue.geometry.arrays import FloatArray

LENGTH = 1 / 16
"""Of the correlation, in widths of the picture."""
CHANCE = 2.0
"""A shared variance below that many of its standard deviations is taken for chance."""


def gradient_covariance(fit: Adjusted, groups: tuple[Group, ...]) -> FloatArray:
    """(shared, shared) covariance of the fit's gradient: its normal matrix, had every point an error of its own."""
    linearised = tuple(linearise(fit.setup, group) for group in groups)
    equations = NormalEquations(fit.setup, Problem(groups, fit.active, True), linearised, fit.scales)
    root, matrices = equations.root(), equations.total.copy()
    for group, scale, weight, (error, jacobian) in zip(groups, fit.scales, fit.weights, linearised, strict=True):
        whitened = np.sqrt(weight) / (group.sigma[:, None] * scale)
        kernels = _kernels(fit, group)
        for axis in (0, 1):
            J = jacobian[:, axis] * whitened[:, axis, None]
            taken = _taken(J, group, fit, root)
            own, shared = variances(error[:, axis] * whitened[:, axis], taken, kernels)
            for view, kernel in enumerate(kernels):
                rows = J[group.view == view]
                matrices[view] += rows.T @ ((own - 1) * rows + shared * (kernel @ rows))
    return equations.eliminated(matrices)


def variances(size: FloatArray, taken: FloatArray, kernels: list[FloatArray]) -> tuple[float, float]:
    """Of the noise that each point has of its own, and of that which it shares with its neighbours.

    Parameters
    ----------
    size : (N,) residuals in sigmas, view after view.
    taken : (N, P) U, such that independent noise leaves residuals of the covariance A = I - U U'.
    kernels : of each view, K.
    """
    count = len(size)
    if not size.any():
        return 1.0, 0.0
    starts = np.cumsum([0, *map(len, kernels)])
    views = [slice(*ends) for ends in pairwise(starts)]
    smooth = np.concatenate([K @ taken[view] for K, view in zip(kernels, views, strict=True)])
    crossed, overlap = taken.T @ smooth, float(np.sum(taken * smooth))
    moments = np.array([size @ size, sum(size[view] @ K @ size[view] for K, view in zip(kernels, views, strict=True))])
    expected = np.array(  # tr A, tr AKA; tr KA, tr KAKA
        [
            [count - np.sum(taken**2), count - 2 * overlap + np.sum(crossed * (taken.T @ taken))],
            [
                count - overlap,
                sum(float(np.sum(K * K)) for K in kernels) - 2 * np.sum(smooth**2) + np.sum(crossed**2),
            ],
        ]
    )
    left = expected[1, 1] - expected[0, 1] * expected[1, 0] / expected[0, 0]
    shared = (moments[1] - moments[0] * expected[1, 0] / expected[0, 0]) / left
    if not (left > 0 and shared > CHANCE * np.sqrt(2 / left)):
        return 1.0, 0.0
    own = (moments[0] - expected[0, 1] * shared) / expected[0, 0]
    return (float(own), float(shared)) if own > 0 else (0.0, float(moments[1] / expected[1, 1]))


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
