"""One bundle adjustment over intrinsics, relative pose and board poses.

Levenberg-Marquardt with a robust loss. Each view has eight unknowns of its own, which are eliminated (Schur
complement), so that a step solves one system of at most twenty-seven unknowns, however many views there are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from retrue.calibration.jacobians import linearise
from retrue.calibration.observations import CornerObservations, Group
from retrue.calibration.setup import OF_VIEW, Setup
from retrue.errors import DegenerateError
from retrue.geometry.arrays import BoolArray, FloatArray
from retrue.geometry.robust import MAD_TO_SIGMA

SETTLED_FALL = 0.02
"""Fall of chi-square below which a fit has settled: far less than one sigma of anything."""
HUBER = 3.0
"""Residuals beyond that many sigmas count linearly, not squared: Gaussian ones are hardly touched."""
DRIFT_PX = 0.02
"""Standard deviation of a projector's picture from capture to capture: heat, vibration, the decoder's own bias."""
Linearised = tuple[tuple[FloatArray, FloatArray], ...]


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """What is fitted: which groups, by which of the shared columns, and whether large residuals count less."""

    groups: tuple[Group, ...]
    active: BoolArray
    robust: bool


@dataclass(frozen=True, slots=True, eq=False)
class Adjusted:
    """The best fit.

    Attributes
    ----------
    setup : the estimate.
    active : (shared,) which of the columns that all views share were free.
    scales : of each group (2,), the noise of both coordinates in units of the observations' own sigma.
    errors : of each group, predicted minus measured pixels (N, 2), as `linearise` gives them.
    weights : of each group (N, 2), robust weights; 1 for what fits.
    covariance : (shared, shared) of the shared parameters, the views' own free too; zero for those held.
    normal : (shared, shared) normal matrix of all shared parameters, the views' own eliminated.
    gradient : (shared,) of half the cost, by all shared parameters; zero for the free ones.
    """

    setup: Setup
    active: BoolArray
    scales: tuple[FloatArray, ...]
    errors: tuple[FloatArray, ...]
    weights: tuple[FloatArray, ...]
    covariance: FloatArray
    normal: FloatArray
    gradient: FloatArray


def adjust(
    setup: Setup,
    groups: tuple[Group, ...],
    active: BoolArray,
    *,
    robust: bool = True,
    scales: tuple[FloatArray, ...] | None = None,
) -> Adjusted:
    """Minimise the residuals of all groups over the active columns and all board poses.

    The groups' noise levels are estimated with the rest (variance components), from `scales` in one round, or from
    nothing in three. Not `robust`: plain least squares, every pixel weighing the same, which is what OpenCV minimises.
    Raises `DegenerateError` where the observations do not determine the unknowns.
    """
    if not robust:
        groups = tuple(replace(group, sigma=np.ones(len(group.sigma))) for group in groups)
    problem = Problem(groups, active, robust)
    linearised = _linearised(setup, groups)
    if not all(np.isfinite(error).all() for error, _ in linearised):
        raise DegenerateError("calibration: the starting point puts part of the board behind a device")
    rounds = 3 if scales is None and robust else 1
    if scales is None:
        pairs = zip(linearised, groups, strict=True)
        scales = tuple(_robust_scale(error, group) if robust else np.ones(2) for (error, _), group in pairs)
    for _ in range(rounds):
        setup, linearised = _minimise(setup, problem, linearised, scales)
        before, scales = scales, NormalEquations(setup, problem, linearised, scales).rescaled()
        if not robust:
            common = float(np.sqrt(np.mean(np.concatenate(scales) ** 2)))
            scales = tuple([np.full(2, common) for _ in groups])
        if np.allclose(np.concatenate(scales), np.concatenate(before), rtol=0.05):
            break
    equations = NormalEquations(setup, problem, linearised, scales)
    return Adjusted(
        setup,
        active,
        scales,
        tuple(equations.errors),
        tuple(equations.weights),
        equations.shared_covariance(),
        *equations.reduced(np.ones_like(active)),
    )


def _minimise(
    setup: Setup, problem: Problem, linearised: Linearised, scales: tuple[FloatArray, ...]
) -> tuple[Setup, Linearised]:
    damping, cost = 1e-10, _cost(setup, problem, linearised, scales)
    for _ in range(50):
        equations = NormalEquations(setup, problem, linearised, scales)
        while damping < 1e12:
            if (candidate := setup.moved(*equations.step(damping))) is not None:
                there = _linearised(candidate, problem.groups)
                new_cost = _cost(candidate, problem, there, scales)
                if new_cost < cost:
                    setup, linearised, damping = candidate, there, max(damping / 10, 1e-12)
                    break
            damping *= 10
        else:
            return setup, linearised
        if cost - new_cost < (SETTLED_FALL if problem.robust else 1e-12 * cost):
            return setup, linearised
        cost = new_cost
    return setup, linearised


def _linearised(setup: Setup, groups: tuple[Group, ...]) -> Linearised:
    return tuple(linearise(setup, group) for group in groups)


def _cost(setup: Setup, problem: Problem, linearised: Linearised, scales: tuple[FloatArray, ...]) -> float:
    total = float(shift_precision(problem.robust) * np.sum(setup.shifts**2))
    for group, scale, (error, _) in zip(problem.groups, scales, linearised, strict=True):
        size = size_in_sigmas(error, group, scale)
        if not np.isfinite(size).all():
            return np.inf
        loss = np.where(size > HUBER, HUBER * (2 * size - HUBER), size**2) if problem.robust else size**2
        total += float(loss.sum())
    return total


def _robust_scale(error: FloatArray, group: Group) -> FloatArray:
    """The noise of both coordinates, from the median."""
    size = np.abs(error) / group.sigma[:, None]
    return np.maximum(MAD_TO_SIGMA * np.median(size, axis=0), 1e-6) if len(size) else np.ones(2)


class NormalEquations:
    """The normal equations at one point: of each group and view, `Columns.all` square."""

    def __init__(self, setup: Setup, problem: Problem, linearised: Linearised, scales: tuple[FloatArray, ...]) -> None:
        groups, robust = problem.groups, problem.robust
        views, columns = len(setup.first_from_board), setup.columns.all
        self.groups, self.active, self.scales = groups, problem.active, scales
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
        shift = np.arange(columns)[setup.columns.shift]
        self.total[:, shift, shift] += precision
        self.vectors[:, shift] += precision * setup.shifts

    def reduced(self, active: BoolArray, damping: float = 0.0) -> tuple[FloatArray, FloatArray]:
        """Normal matrix and gradient of the shared columns, the boards eliminated."""
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

    def eliminated(self, matrices: FloatArray) -> FloatArray:
        """Covariance of `reduced`'s gradient, from that of every view's (views, columns, columns).

        Of `total` it is the normal matrix itself.
        """
        left = self._onto_shared()
        return np.asarray((left @ matrices @ left.transpose(0, 2, 1)).sum(axis=0), dtype=np.float64)

    def repeated(self, gradients: FloatArray) -> FloatArray:
        """`reduced`'s gradient (shared, K), from every view's (views, columns, K) by errors that all views share."""
        return np.asarray((self._onto_shared() @ gradients).sum(axis=0), dtype=np.float64)

    def _onto_shared(self) -> FloatArray:
        absorbed = self.total[:, :-OF_VIEW, -OF_VIEW:] @ _inverse(self.total[:, -OF_VIEW:, -OF_VIEW:])
        shared = np.broadcast_to(np.eye(absorbed.shape[1]), (len(absorbed), *[absorbed.shape[1]] * 2))
        return np.concatenate([shared, -absorbed], axis=2)

    def root(self) -> FloatArray:
        """(active + views' own, the same) L with L L' the covariance of all free unknowns, shared ones first."""
        columns, views = np.flatnonzero(self.active), len(self.total)
        free = len(columns)
        matrix = np.zeros((free + views * OF_VIEW, free + views * OF_VIEW))
        for view, total in enumerate(self.total):
            places = [*range(free), *range(free + view * OF_VIEW, free + (view + 1) * OF_VIEW)]
            own = [*columns.tolist(), *range(len(self.active), len(total))]
            matrix[np.ix_(places, places)] += total[np.ix_(own, own)]
        size = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        values, vectors = np.linalg.eigh(matrix / np.outer(size, size))
        return vectors / np.sqrt(np.maximum(values, 1e-14)) / size[:, None]

    def step(self, damping: float) -> tuple[FloatArray, FloatArray]:
        """The change of all shared columns, and of each view's own (views, OF_VIEW)."""
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

    def shared_covariance(self) -> FloatArray:
        """Of all shared columns, zero where they are not active."""
        covariance = np.zeros((len(self.active), len(self.active)))
        covariance[np.ix_(self.active, self.active)] = self.covariance()
        return covariance

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
