"""The normal equations of a calibration at one point, its robust weights, and the noise of its groups."""

from __future__ import annotations

import numpy as np

from retrue.calibration.jacobians import OF_VIEW, Setup
from retrue.calibration.observations import CornerObservations, Group
from retrue.errors import DegenerateError
from retrue.geometry.arrays import BoolArray, FloatArray

HUBER = 3.0
"""Residuals beyond that many sigmas count linearly, not squared: Gaussian ones are hardly touched."""
DRIFT_PX = 0.02
"""Standard deviation of a projector's picture from capture to capture: heat, vibration, the decoder's own bias."""


Linearised = tuple[tuple[FloatArray, FloatArray], ...]


class NormalEquations:
    """The normal equations at one point: of each group and view, (globals + OF_VIEW) square."""

    def __init__(
        self,
        setup: Setup,
        groups: tuple[Group, ...],
        linearised: Linearised,
        active: BoolArray,
        scales: tuple[FloatArray, ...],
        robust: bool,
    ) -> None:
        views, columns = len(setup.first_from_board), setup.globals + OF_VIEW
        self.active, self.scales = active, scales
        self.groups = groups
        self.errors: list[FloatArray] = []
        self.weights: list[FloatArray] = []
        self.matrices = np.zeros((len(groups), 2, views, columns, columns))
        self.vectors = np.zeros((views, columns))
        for index, (group, scale, (error, jacobian)) in enumerate(zip(groups, scales, linearised, strict=True)):
            weight = robust_weights(error, group, scale, robust)
            self.errors.append(error)
            self.weights.append(weight)
            root = np.sqrt(weight) / (group.sigma[:, None] * scale)
            error, jacobian = error * root, jacobian * root[:, :, None]
            starts = np.searchsorted(group.view, np.arange(views + 1))
            for view in range(views):
                rows = slice(starts[view], starts[view + 1])
                for axis in (0, 1):
                    own = jacobian[rows, axis]
                    self.matrices[index, axis, view] = own.T @ own
                    self.vectors[view] += own.T @ error[rows, axis]
        self.total = np.asarray(self.matrices.sum(axis=(0, 1)), dtype=np.float64)
        """(views, columns, columns) of all groups together, and of what is known of the shifts beforehand."""
        precision = shift_precision(robust)
        self.total[:, [-2, -1], [-2, -1]] += precision
        self.vectors[:, -2:] += precision * setup.shifts

    def reduced(self, active: BoolArray, damping: float = 0.0) -> tuple[FloatArray, FloatArray]:
        """Normal matrix and gradient of the global columns, the boards eliminated."""
        columns = np.flatnonzero(active)
        boards = _damped(self.total[:, -OF_VIEW:, -OF_VIEW:], damping)
        across = self.total[:, :-OF_VIEW, -OF_VIEW:][:, columns]
        inverse = _inverse(boards) @ across.transpose(0, 2, 1)
        direct = _damped(self.total[:, :-OF_VIEW, :-OF_VIEW].sum(axis=0)[np.ix_(columns, columns)], damping)
        matrix = direct - np.einsum("vij,vjk->ik", across, inverse)
        vector = self.vectors[:, :-OF_VIEW].sum(axis=0)[columns] - np.einsum(
            "vji,vj->i", inverse, self.vectors[:, -OF_VIEW:]
        )
        return matrix, vector

    def step(self, damping: float) -> tuple[FloatArray, FloatArray]:
        """The change of all global columns, and of each view's own (views, OF_VIEW)."""
        change = np.zeros(len(self.active))
        if self.active.any():
            matrix, vector = self.reduced(self.active, damping)
            change[self.active] = -_solve(matrix, vector)
        boards = _damped(self.total[:, -OF_VIEW:, -OF_VIEW:], damping)
        right = self.vectors[:, -OF_VIEW:] + np.einsum("vgb,g->vb", self.total[:, :-OF_VIEW, -OF_VIEW:], change)
        return change, -(_inverse(boards) @ right[:, :, None])[:, :, 0]

    def covariance(self) -> FloatArray:
        """Of the active columns."""
        if not self.active.any():
            return np.zeros((0, 0))
        matrix, _ = self.reduced(self.active)
        return _solve(matrix, np.eye(len(matrix)))

    def rescaled(self) -> tuple[FloatArray, ...]:
        """The noise of each group from its residuals, freed of what the unknowns absorbed (its leverage)."""
        columns = np.flatnonzero(self.active)
        board_inverse = _inverse(self.total[:, -OF_VIEW:, -OF_VIEW:])
        across = self.total[:, :-OF_VIEW, -OF_VIEW:][:, columns]
        of_globals = self.covariance()
        to_board = -np.einsum("gh,vhb,vbc->vgc", of_globals, across, board_inverse)
        of_board = board_inverse - np.einsum("vab,vgb,vgc->vac", board_inverse, across, to_board)
        scales: list[FloatArray] = []
        for group, error, weight, scale, matrices in zip(
            self.groups, self.errors, self.weights, self.scales, self.matrices, strict=True
        ):
            squares = np.sum(weight * (error / group.sigma[:, None]) ** 2, axis=0)
            freedom = np.sum(weight * (error != 0), axis=0)
            for axis in (0, 1):
                own = matrices[axis]
                freedom[axis] -= np.einsum(
                    "gh,vhg->", of_globals, own[:, :-OF_VIEW, :-OF_VIEW][:, columns][:, :, columns]
                )
                freedom[axis] -= 2 * np.einsum("vgb,vgb->", to_board, own[:, :-OF_VIEW, -OF_VIEW:][:, columns])
                freedom[axis] -= np.einsum("vbc,vcb->", of_board, own[:, -OF_VIEW:, -OF_VIEW:])
            if isinstance(group, CornerObservations):
                squares, freedom = np.full(2, squares.sum()), np.full(2, freedom.sum())
            scales.append(np.where(freedom > 1, np.sqrt(squares / np.maximum(freedom, 1)), scale).clip(1e-9))
        return tuple(scales)


def shift_precision(robust: bool) -> float:
    """Of the shifts; OpenCV knows none."""
    return DRIFT_PX**-2 if robust else 1e12


def robust_weights(error: FloatArray, group: Group, scale: FloatArray, robust: bool) -> FloatArray:
    if not robust:
        return np.ones(error.shape)
    return np.broadcast_to(HUBER / np.maximum(size_in_sigmas(error, group, scale), HUBER), error.shape)


def size_in_sigmas(error: FloatArray, group: Group, scale: FloatArray) -> FloatArray:
    """Errors in sigmas: of corners as one length (N, 1), of points on the plane along and across apart (N, 2)."""
    size = error / (group.sigma[:, None] * scale)
    return np.linalg.norm(size, axis=1, keepdims=True) if isinstance(group, CornerObservations) else np.abs(size)


def _damped(matrix: FloatArray, damping: float) -> FloatArray:
    return matrix * (1 + damping * np.eye(matrix.shape[-1]))


def _inverse(matrices: FloatArray) -> FloatArray:
    try:
        return np.asarray(np.linalg.inv(matrices), dtype=np.float64)
    except np.linalg.LinAlgError as error:
        raise DegenerateError("calibration: the views do not determine the board's poses") from error


def _solve(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solve a normal system, scaled so that pixels and radians weigh alike."""
    root = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    try:
        scaled = np.linalg.solve(matrix / np.outer(root, root), (right.T / root).T)
    except np.linalg.LinAlgError as error:
        raise DegenerateError("calibration: the views do not determine the unknowns") from error
    return (scaled.T / root).T
