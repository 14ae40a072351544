"""Corners of a board are printed off their places, and alike in every pose: no number of poses averages that out.

The fit takes each for an error of its own. Its covariance has to know that they repeat: corner c is off by d_c in the
plane of the board, a device sees it B_vc d_c off in view v, and over all corners d has the covariance

    own I + lines L + slow K,

L one for the same coordinate of corners that share it (a plotter's step, a line of the drawing), K_cd = exp(-|x_c -
x_d|^2 / 2 length^2) (paper that stretches). The variances come from the residuals with those of other noise, see
`neighbours`.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from scipy import sparse

from retrue.calibration.bundle import Linearised
from retrue.calibration.observations import CornerObservations, Group
from retrue.calibration.setup import Setup
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray

LENGTH = 1 / 4
"""Of what paper stretches by, in widths of the board."""
Sparse = Any
"""A matrix of SciPy's that holds few numbers; their types are not to be had."""


def printed_factors(setup: Setup, groups: tuple[Group, ...], linearised: Linearised) -> list[list[list[Sparse]]]:
    """Of each group and of each coordinate in it, F of the corners' own errors, of those of lines, and of slow ones.

    (N, K) derivatives of the pixels by errors of unit variance that do not depend on each other; none of other points.
    """
    corners = [group for group in groups if isinstance(group, CornerObservations)]
    xy, place = np.unique(np.concatenate([group.board_points[:, :2] for group in corners]), axis=0, return_inverse=True)
    places = iter(np.split(place.reshape(-1), np.cumsum([len(group.view) for group in corners])))
    R = np.stack([pose.R for pose in setup.first_from_board])
    slow, lines = _slow(xy), [np.unique(own, return_inverse=True)[1].reshape(-1) for own in xy.T]
    across, turned = _across(xy), None
    factors: list[list[list[Sparse]]] = []
    for group, (error, jacobian) in zip(groups, linearised, strict=True):
        if not isinstance(group, CornerObservations):
            factors.append([[], []])
            continue
        own, columns = next(places), setup.columns.board_pose
        B = jacobian[:, :, columns.stop - 3 : columns.stop] @ R[group.view][:, :, :2]
        if turned is None:
            off: FloatArray = -np.linalg.solve(B, error[:, :, None])[:, :, 0].astype(np.float64)
            turned = _turned(group.view, len(R), off, own, across)
        back = turned[group.view]
        own, B = np.where(back, across[own], own), np.where(back[:, None, None], -B, B)
        factors.append([_of_coordinate(B[:, axis], own, lines, slow) for axis in (0, 1)])
    return factors


def _of_coordinate(B: FloatArray, place: IntArray, lines: list[IntArray], slow: FloatArray) -> list[Sparse]:
    """Of a coordinate that moves by B (N, 2) a unit of error, in corners of these places."""
    axes = range(2)
    return [
        _placed(B, [2 * place + axis for axis in axes], 2 * len(slow)),
        _placed(B, [lines[axis][place] + axis * len(slow) for axis in axes], 2 * len(slow)),
        cast("Any", sparse).csr_array(np.concatenate([B[:, axis, None] * slow[place] for axis in axes], axis=1)),
    ]


def _placed(B: FloatArray, columns: list[IntArray], count: int) -> Sparse:
    rows = np.tile(np.arange(len(B)), 2)
    return cast("Any", sparse).csr_array((B.T.ravel(), (rows, np.concatenate(columns))), shape=(len(B), count))


def _slow(xy: FloatArray) -> FloatArray:
    """(C, K) S with K = S S'."""
    distance = np.sum((xy[:, None] - xy) ** 2, axis=2) / (LENGTH * np.ptp(xy, axis=0).max()) ** 2
    values, vectors = np.linalg.eigh(np.exp(-0.5 * distance))
    large = values > 1e-6 * values[-1]
    return np.asarray(vectors[:, large] * np.sqrt(values[large]), dtype=np.float64)


def _across(xy: FloatArray) -> IntArray:
    """Of each corner, the one that lies where it does on the board turned by half a turn; itself where none does."""
    both = np.concatenate([xy, xy.min(axis=0) + xy.max(axis=0) - xy])
    found, place = np.unique(np.round(both / np.ptp(xy), 9), axis=0, return_inverse=True)
    place = place.reshape(-1)
    if len(found) > len(xy):
        return np.arange(len(xy))
    return np.asarray(np.argsort(place[: len(xy)])[place[len(xy) :]], dtype=np.int64)


def _turned(view: IntArray, views: int, off: FloatArray, place: IntArray, across: IntArray) -> BoolArray:
    """Which views count the corners from the other end, as a chessboard lets them: told by what repeats.

    off : (N, 2) where the corners of these places lie in the plane of the board, off where they should.
    """
    turned, seen = np.zeros(views, dtype=bool), np.zeros((views, len(across), 2))
    seen[view, place] = off
    total = seen[0].copy()
    for index in range(1, views):
        back = -seen[index][across]
        turned[index] = np.sum(total * back) > np.sum(total * seen[index])
        total += back if turned[index] else seen[index]
    return turned
