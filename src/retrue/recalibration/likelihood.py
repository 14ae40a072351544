"""What each residual costs in the noise of its own fit, where points of a block share an error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from retrue.geometry.arrays import FloatArray
from retrue.geometry.robust import Noise, biweight_loss
from retrue.recalibration.fit import PoseFit
from retrue.recalibration.measured import MISFIT_PX, Measured


def negative_log_likelihood(fit: PoseFit, measured: Measured) -> FloatArray:
    """(2, N) twice that of each residual across and along its epipolar line, up to a constant, less the expected one.

    With s the noise of each point by itself and b that of its block, n explained points of mean m each have
    rho((r - m) / s) + m^2 / (s^2 + n b^2) + 2 log s + log(1 + n b^2 / s^2) / n: the log likelihood of a Gaussian with
    such a covariance, shared out. s is not below what real lenses leave over. NaN where there is no residual, 0 of
    points on no plane along the line.
    """
    blocks, found = measured.support.blocks, np.empty(fit.robust_weights.shape)
    residuals = zip(fit.alike, fit.levels_alike, fit.robust_weights, fit.noises, strict=True)
    families = zip(residuals, blocks, _expected(fit), found, strict=True)
    for (values, level, weights, noise), block, expected, loss in families:
        row, explained = block + 1, np.where(weights > 0, values, 0.0)
        weighted = weights * explained
        numbers, sums = np.bincount(row, weights), np.bincount(row, weighted)
        means = sums / np.maximum(numbers, 1e-300)
        within = 1 - float(sums @ means) / max(float(weighted @ explained), 1e-300)
        own = level**2 * max(within, 0.0) + MISFIT_PX**2
        together = numbers * (noise.shared**2 * noise.alikeness)
        of_block = means**2 / (own + together) + np.log1p(together / own) / np.maximum(numbers, 1.0) + np.log(own)
        loss[:] = biweight_loss((values - means[row]) / np.sqrt(own)) + of_block[row]
        loss[weights > 0] -= expected
        loss[block < 0] = 0.0
    return found


def _expected(fit: PoseFit) -> FloatArray:
    """(2,) what residuals cost that are all noise, less what they do where noise is alike along all axes.

    Of usual variance v about its lines a family costs v / (v + m^2) + log(v + m^2), m being the misfit of real lenses.
    By how much that differs from pose to pose, because noise is louder along one axis, is no evidence for either. What
    a pose does not explain costs what it does, whatever noise is.
    """
    if fit.uneven is None:
        return np.zeros(2)
    usual, even, least = fit.uneven.usual, fit.uneven.even, MISFIT_PX**2
    return np.log((usual + least) / (even + least)) + usual / (usual + least) - even / (even + least)


def with_misfit(fit: PoseFit, measured: Measured) -> PoseFit:
    """The same with what lenses leave over, as many pixels of a point that is known well as of one that is not.

    Those known best soon tell no more together than the lens lets one of them tell, see `Support.usual_points`.
    """
    noises: list[Noise] = []
    for noise, number in zip(fit.noises, measured.support.usual_points, strict=True):
        shared = float(np.hypot(noise.shared, measured.misfit))
        noises.append(replace(noise, shared=shared, variance=noise.variance + measured.misfit**2 * number))
    return replace(fit, epipolar_noise=noises[0], along_noise=noises[1])
