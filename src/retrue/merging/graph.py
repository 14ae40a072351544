"""From pairs to poses: all of them at once, so that every loop closes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from retrue.geometry.arrays import FloatArray
from retrue.geometry.robust import MAD_TO_SIGMA, biweight
from retrue.geometry.transform import RigidTransform, skew
from retrue.merging.pairs import Counterparts, counterparts, moved, normal_equations
from retrue.merging.view import View, neighbour_tree

MOST_STEPS = 15
SETTLED = 1e-4  # of the cell: points move less than this
LOOP_FREEDOM = 6
MOST_ASKED = 4000  # counterparts of a pair, whose neighbours tell how far errors are alike
RINGS = 16  # of one cell each, about a counterpart; beyond, what all share is held to be a pose


@dataclass(frozen=True, slots=True, eq=False)
class Adjusted:
    """All poses, and how well they fit.

    Attributes
    ----------
    poses : object_from_view by view; the first of the group is the object's frame.
    covariance : (6 N, 6 N) of a turn and shift of each view in the object's frame, views in the order of `poses`.
    level : noise of the distances, in the views' own sigmas.
    residuals : RMS distance of each pair's counterparts, and how many there were.
    closures : of each pair that closes a loop, by how many sigmas the pair's own pose misses what the others say.
    """

    poses: dict[int, RigidTransform]
    covariance: FloatArray
    level: float
    residuals: dict[tuple[int, int], tuple[float, int]]
    closures: dict[tuple[int, int], float]


def adjust(
    views: Mapping[int, View], poses: dict[int, RigidTransform], pairs: Sequence[tuple[int, int]], cell: float
) -> Adjusted:
    """Poses at which all pairs' surfaces lie on each other best: least squares over the views' noise, robust.

    Every pair says by its normal equations what turn and shift of its second view against its first one it wants,
    all in the object's frame; the first view stays. Both directions of a pair are asked, each at half its weight,
    for they are of the same points.

    Pairs that see one place share their views' errors: of n views the n (n - 1) / 2 differences, each of variance 2,
    tell of their heights as much as 2 / n of them would by themselves (the Laplacian of n heights about their unknown
    mean is that of all differences over n, not over 2).
    """
    order = list(poses)
    place = {view: number for number, view in enumerate(order)}
    size = 6 * len(order)
    level = 1.0
    information = np.eye(size)
    directed = [*pairs, *((second, first) for first, second in pairs)]
    for _ in range(MOST_STEPS):
        found = [
            counterparts(views[first], views[second], poses[first].inverse() @ poses[second], cell)
            for first, second in directed
        ]
        ratios = np.abs(np.concatenate([each.distance / each.sigma for each in found]))
        level = max(MAD_TO_SIGMA * float(np.median(ratios)), 1e-9)
        information, gradient = np.zeros((size, size)), np.zeros(size)
        shares = _shares(views, directed, found)
        for (first, second), each, share in zip(directed, found, shares, strict=True):
            H, g, _ = normal_equations(each, level, share)
            turn = _adjoint(poses[first])  # from the object's frame to the first view's
            H, g = turn.T @ H @ turn / 2, turn.T @ g / 2
            a, b = (slice(6 * place[view], 6 * place[view] + 6) for view in (first, second))
            for rows, row_sign in ((a, -1), (b, 1)):
                gradient[rows] += row_sign * g
                for columns, column_sign in ((a, -1), (b, 1)):
                    information[rows, columns] += row_sign * column_sign * H
        step = np.zeros(size)
        step[6:] = -np.linalg.solve(information[6:, 6:], gradient[6:])
        poses = {view: moved(pose, step[6 * place[view] : 6 * place[view] + 6]) for view, pose in poses.items()}
        if _largest_move(views, poses, step, place) < SETTLED * cell:
            break
    settled = {
        (first, second): counterparts(views[first], views[second], poses[first].inverse() @ poses[second], cell)
        for first, second in pairs
    }
    covariance = np.zeros((size, size))
    of_gradients, of_poses = shared_errors(list(settled.values()), level, cell)
    covariance[6:, 6:] = of_poses * level**2 * np.linalg.inv(information[6:, 6:])
    residuals: dict[tuple[int, int], tuple[float, int]] = {}
    closures: dict[tuple[int, int], float] = {}
    for (first, second), found in settled.items():
        H, g, _ = normal_equations(found, level)
        missed = max(g @ np.linalg.pinv(H) @ g, 0.0) / LOOP_FREEDOM / of_gradients
        closures[first, second] = float(np.sqrt(missed) / level)
        residuals[first, second] = (float(np.sqrt(np.mean(found.distance**2))), len(found.distance))
    return Adjusted(poses, covariance, level, residuals, closures)


def shared_errors(pairs: Sequence[Counterparts], level: float, cell: float) -> tuple[float, float]:
    """How many times the variance of gradients, and that of poses, is what it were if each counterpart erred by itself.

    Neighbours share errors: they were thinned from the same points, and decoders smooth. A turn or shift is a sum over
    the whole surface, of whose variance sum_ij psi_i psi_j is what is seen, psi the residuals of counterparts under
    Tukey's biweight: each by itself, and pairs as far apart as they are alike, to the first ring that shows otherwise.
    A pose yields to a gradient by the slopes of psi, where `normal_equations` have its weights.

    Sources: Geyer, "Practical Markov chain Monte Carlo", Statistical Science 7, 1992 (where to stop); Conley, "GMM
    estimation with cross sectional dependence", Journal of Econometrics 92, 1999.
    """
    rings, weight, slope = np.zeros(RINGS + 1), 0.0, 0.0
    for found in pairs:
        z = found.distance / (level * found.sigma)
        weights = biweight(z)
        psi = weights * z
        rings[0] += psi @ psi
        weight, slope = weight + weights.sum(), slope + (5 * weights - 4 * np.sqrt(weights)).sum()
        asked = np.arange(0, len(psi), -(-len(psi) // MOST_ASKED))
        tree, few = neighbour_tree(found.places), neighbour_tree(found.places[asked])
        near = few.sparse_distance_matrix(tree, RINGS * cell, output_type="ndarray")
        one, other, apart = asked[near["i"]], near["j"], np.minimum((near["v"] / cell).astype(int), RINGS - 1)
        alike = np.where(one == other, 0.0, psi[one] * psi[other])
        rings[1:] += len(psi) / len(asked) * np.bincount(apart, alike, RINGS)
    alone = np.flatnonzero(rings < 0)
    gradients = float(rings[: alone[0] if len(alone) else None].sum() / weight)
    return gradients, gradients * float(weight / slope) ** 2


def _shares(
    views: Mapping[int, View], directed: Sequence[tuple[int, int]], found: Sequence[Counterparts]
) -> list[FloatArray]:
    """Of each counterpart 2 / n, n the number of views that see its point."""
    seen = {view: np.ones(len(views[view].points)) for pair in directed for view in pair}
    for (_, second), each in zip(directed, found, strict=True):
        seen[second][each.rows] += 1
    return [2 / seen[second][each.rows] for (_, second), each in zip(directed, found, strict=True)]


def _adjoint(object_from_view: RigidTransform) -> FloatArray:
    """(6, 6): a small turn and shift in the object's frame, as one in the view's."""
    R, t = object_from_view.R, object_from_view.t
    whole = np.zeros((6, 6))
    whole[:3, :3] = whole[3:, 3:] = R.T
    whole[3:, :3] = -R.T @ skew(t)
    return whole


def _largest_move(
    views: Mapping[int, View], poses: dict[int, RigidTransform], step: FloatArray, place: dict[int, int]
) -> float:
    """RMS over the points of the view that moved most."""
    moves: list[float] = []
    for view, pose in poses.items():
        turn, shift = step[6 * place[view] :][:3], step[6 * place[view] :][3:6]
        away = np.cross(turn, pose.apply(views[view].points)) + shift
        moves.append(float(np.sqrt((away**2).sum(axis=1).mean())))
    return max(moves)
