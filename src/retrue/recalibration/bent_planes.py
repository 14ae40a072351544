"""Sheets, sidings and hedges, which pass for planes and are none: compared with the same ones bent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from retrue.errors import DegenerateError
from retrue.geometry.arrays import BoolArray, FloatArray
from retrue.geometry.two_view import POSE_PARAMETERS, solve_normal_equations
from retrue.recalibration.bows import BOWS, CURVED
from retrue.recalibration.parameters import LENSES
from retrue.recalibration.posterior import Posterior, fit_posterior

BENT = 16.3  # of chi-square with three degrees of freedom: a flat plane once in a thousand


def bent_planes(posterior: Posterior) -> BoolArray:
    """(P,) planes that are bent by more than walls are, by more than noise and lenses make flat ones look.

    Their bows b are fitted again, hardly held by what walls are. With A the information of all but the lenses and B
    its part with those, of covariance P, a flat plane has b of covariance (A^-1 + A^-1 B P B^T A^-1)_bb + 1: a lens
    that errs within its calibration bends all planes that it sees, and is no reason to give them up.
    """
    count = len(posterior.pose.planes)
    nothing = np.zeros(count, dtype=np.bool_)
    if not count:
        return nothing
    all_of_them = ~nothing
    loose = replace(posterior.measured, curved=all_of_them)
    try:
        bent = fit_posterior(loose, posterior.parameters.as_curved(all_of_them), posterior.prior, 6)
        covariance = _of_bows(bent) + np.eye(BOWS * count) / CURVED**2
    except DegenerateError:
        return nothing
    bows, blocks = bent.parameters.bows, _diagonal_blocks(covariance, BOWS)
    squares: FloatArray = (bows * np.linalg.solve(blocks, bows[..., None])[..., 0]).sum(axis=1)
    return squares > BENT


def _of_bows(posterior: Posterior) -> FloatArray:
    """(3 P, 3 P) covariance of the bows, all else being free, the lenses within their prior."""
    information, first = posterior.information, POSE_PARAMETERS + 3 * len(posterior.pose.planes)
    lens = np.arange(first, first + LENSES)
    if posterior.prior.free:
        return solve_normal_equations(information, np.eye(len(information)))[lens[-1] + 1 :, lens[-1] + 1 :]
    own = np.delete(np.arange(len(information)), lens)
    inverse = solve_normal_equations(information[np.ix_(own, own)], np.eye(len(own)))[first:]
    follows = inverse @ information[np.ix_(own, lens)]
    return inverse[:, first:] + follows @ posterior.prior.lens.covariance @ follows.T


def _diagonal_blocks(matrix: FloatArray, side: int) -> FloatArray:
    """(N, side, side) of a matrix (N side, N side)."""
    first = np.arange(0, len(matrix), side)[:, None] + np.arange(side)
    return matrix[first[:, :, None], first[:, None]]
