"""Refinement of one relative pose over any number of planes and free points, and its covariance.

The unknowns are R (3), the direction of t (2) and n of each plane (3), with |t| = 1. No 3D point is
a parameter: a free point leaves its epipolar residual; a point on a plane leaves a second one,
along the epipolar line, given the first. Both are whitened, so that their squares sum to the chi-square of the
full bundle adjustment, and both are linearised at the corrected rays, so that the fit settles
where the full bundle adjustment does.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from retrue.errors import DegenerateError
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.geometry.transform import RigidTransform, skew
from retrue.geometry.triangulation import distances_of_essential
from retrue.kernels import steps
from retrue.kernels import two_view as kernel

POSE_PARAMETERS = 5
PARAMETERS = 8  # of one point: the pose, and n of its plane
NO_RESIDUALS, NO_WEIGHTS = np.empty((2, 0)), np.empty((2, 0))
NO_COLUMNS, NO_BLOCKS = np.empty((0, 2, 0)), np.empty((0, 0, 0))
LITTLE = 1e-9  # of a plane's own information, more
NO_TURNS = np.empty((0, 2, 0)), np.empty((0, 2, 0))
NO_BOWS = np.empty((0, 0)), np.empty((0, 0))
FREE = -1
"""Index of the plane of a point that lies on none."""
PlaneBows = tuple[FloatArray, FloatArray]
"""(N, B) share of its plane's disparity that each bow moves a point by; (P, B) how far each plane is bowed."""
_Placed = tuple[
    FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, IntArray, FloatArray, FloatArray
]


@dataclass(frozen=True, slots=True, eq=False)
class TwoViewPoints:
    """N matched rays and what is known of their noise.

    Attributes
    ----------
    camera_rays, projector_rays : (N, 2) undistorted, normalised.
    camera_sigma, projector_sigma : (N,) noise per axis, in the unit of the rays. Zero stands for exact.
    plane_index : (N,) which plane each point may lie on, or `FREE`.
    """

    camera_rays: FloatArray
    projector_rays: FloatArray
    camera_sigma: FloatArray
    projector_sigma: FloatArray
    plane_index: IntArray

    def __len__(self) -> int:
        return len(self.camera_rays)

    def select(self, rows: IntArray | slice | np.ndarray) -> TwoViewPoints:
        """The same, with only those rows."""
        parts = [getattr(self, name) for name in self.__dataclass_fields__]
        if isinstance(rows, slice):
            return TwoViewPoints(*(part[rows] for part in parts))
        rows = np.flatnonzero(rows) if rows.dtype == np.bool_ else rows  # to find them once for all
        return TwoViewPoints(*(np.take(part, rows, axis=0) for part in parts))

    def without_planes(self, gone: BoolArray) -> TwoViewPoints:
        """The same where the points of those planes (P,) lie on none, and the others are numbered anew."""
        number = np.append(np.where(gone, FREE, np.cumsum(~gone) - 1), FREE)  # the last is that of FREE
        return replace(self, plane_index=number[self.plane_index])


@dataclass(frozen=True, slots=True, eq=False)
class TwoViewPose:
    """A pose up to scale, with the planes that it sees.

    Attributes
    ----------
    R : (3, 3) projector from camera.
    t : (3,) unit direction.
    planes : (P, 3) n of each plane, n . X = 1, in units of |t|.
    """

    R: FloatArray
    t: FloatArray
    planes: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))

    def moved(self, step: FloatArray) -> TwoViewPose:
        """R <- exp([w]x) R, t <- unit(t + B d), n <- n + e for step = (w, d, e ...) of (5 + 3 P,)."""
        R, t = np.empty((3, 3)), np.empty(3)
        steps.turned(np.ascontiguousarray(self.R), direction_axes(self.t), np.ascontiguousarray(step), R, t)
        return TwoViewPose(R, t, self.planes + step[POSE_PARAMETERS:].reshape(-1, 3))


@dataclass(frozen=True, slots=True, eq=False)
class Residuals:
    """Whitened residuals (2, N), of points that may lie on a plane.

    Attributes
    ----------
    both : across the epipolar line; and along it, NaN of a point on no plane.
    """

    both: FloatArray

    @property
    def epipolar(self) -> FloatArray:
        """(N,) across the epipolar line."""
        return self.both[0]

    @property
    def along(self) -> FloatArray:
        """(N,) along the epipolar line, given the one across it."""
        return self.both[1]


def tangent_basis(t: FloatArray) -> FloatArray:
    """(3, 2) orthonormal basis of the plane normal to the unit vector t.

    >>> tangent_basis(np.array([0.0, 0.0, 1.0])).round(9).tolist()
    [[0.0, -1.0], [1.0, 0.0], [0.0, 0.0]]
    """
    return direction_axes(t)[1:].T


def direction_axes(t: FloatArray) -> FloatArray:
    """(3, 3) rows: the unit vector t, and the two of its `tangent_basis`."""
    axes = np.empty((3, 3))
    steps.axes(np.ascontiguousarray(t), axes)
    return axes


def epipolar_residuals(pose: RigidTransform | TwoViewPose, points: TwoViewPoints) -> FloatArray:
    """`sampson_distances` (N,) of points in their own sigmas: chi with one degree of freedom each.

    >>> points = TwoViewPoints(*np.array([[[0.0, 0.0]], [[0.1, 3e-3]]]), *np.full((2, 1), 1e-3), np.array([-1]))
    >>> epipolar_residuals(TwoViewPose(np.eye(3), np.array([1.0, 0, 0])), points).round(4).tolist()
    [-2.1213]
    """
    sigmas = points.camera_sigma, points.projector_sigma
    return distances_of_essential(skew(pose.t) @ pose.R, points.camera_rays, points.projector_rays, *sigmas)


def residuals(pose: TwoViewPose, points: TwoViewPoints, bows: PlaneBows = NO_BOWS) -> Residuals:
    """Both families of residuals at a pose, linearised at the corrected rays (see `TwoViewPose`)."""
    both = np.empty((2, len(points)))
    kernel.two_view(*_placed(pose, points, bows), both, NO_WEIGHTS, NO_COLUMNS, *NO_TURNS, NO_BLOCKS)
    return Residuals(both)


def corrected_rays(
    pose: TwoViewPose, points: TwoViewPoints, weights: FloatArray, bows: PlaneBows = NO_BOWS
) -> FloatArray:
    """(2, N, 2) rays of both devices that the normal equations are made at: where the pose has what they show.

    That is on the plane, of points that weigh along the epipolar line, and on their epipolar lines of the others.
    """
    corrected = np.empty((2, len(points), 2))
    kernel.corrected_rays(*_placed(pose, points, bows), weights, corrected)
    return corrected


def behind(pose: TwoViewPose, points: TwoViewPoints, level: float) -> BoolArray:
    """(N,) points behind the camera, the projector or their own plane; those on none by more than four sigma of depth.

    `level` is the noise as a multiple of the points' own sigma.
    """
    found = np.empty(len(points), dtype=np.bool_)
    kernel.behind(*_placed(pose, points, NO_BOWS)[:8], level, found.view(np.uint8))
    return found


def normal_equations(
    pose: TwoViewPose, points: TwoViewPoints, weights: FloatArray, columns: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """J^T W J (S, S), J^T W C (S, K) and C^T W C (K, K) of the S = 5 + 3 P unknowns.

    Parameters
    ----------
    weights : (2, N) of the residuals across and along the epipolar line.
    columns : C (K, 2, N): the residuals themselves, or how they change with what is no unknown; at most 32.

    A plane whose points all lost their weight is held where it is, by one unit of information relative to its n and
    a billionth of its own: next to nothing where it has points, and enough not to leave the pose undetermined.
    """
    count = len(pose.planes)
    blocks = normal_blocks(pose, points, weights, columns)
    size = POSE_PARAMETERS + 3 * count
    own = np.arange(POSE_PARAMETERS, size).reshape(count, 3)
    information, cross = np.zeros((size, size)), np.zeros((size, len(columns)))
    both = blocks.sum(axis=0)
    information[:5, :5], cross[:5] = both[:5, :5], both[8:, :5].T
    information[5:, :5] = blocks[:-1, 5:8, :5].reshape(own.size, 5)
    information[own[:, :, None], own[:, None]] = blocks[:-1, 5:8, 5:8]
    cross[5:] = blocks[:-1, 8:, 5:8].transpose(0, 2, 1).reshape(own.size, len(columns))
    held = 1 / np.maximum((pose.planes**2).sum(axis=1), 1e-12)
    information[own, own] += held[:, None] + LITTLE * information[own, own]
    return _symmetric(information), cross, _symmetric(both[8:, 8:])


def normal_blocks(
    pose: TwoViewPose,
    points: TwoViewPoints,
    weights: FloatArray,
    columns: FloatArray,
    turns: tuple[FloatArray, FloatArray] = NO_TURNS,
    bows: PlaneBows = NO_BOWS,
) -> FloatArray:
    """[J C]^T W [J C] (P + 1, 8 + K, 8 + K), lower triangles: along the line of each plane's points; across it of all.

    Of each the pose (5), n of the plane (3) and the K columns, as in `normal_equations`; columns (K, 1, N) are across
    the line alone, and so are the blocks then. After those come further unknowns that move the rays of the camera and
    of the projector, by `turns` (N, 2, A) each at the `corrected_rays`, and the bows (B) of the plane.
    """
    width = PARAMETERS + len(columns) + 2 * turns[0].shape[2] + bows[0].shape[1]
    blocks = np.zeros((len(pose.planes) + 1, width, width))
    placed = _placed(pose, points, bows)
    kernel.two_view(*placed, NO_RESIDUALS, weights, np.ascontiguousarray(columns), *turns, blocks)
    return blocks


def step_equations(
    pose: TwoViewPose,
    points: TwoViewPoints,
    weights: FloatArray,
    found: Residuals,
    turns: tuple[FloatArray, FloatArray] = NO_TURNS,
    bows: PlaneBows = NO_BOWS,
) -> tuple[FloatArray, FloatArray]:
    """J^T W J (S, S) and J^T W r (S,) of the pose, the planes (3 P), what turns the rays (2 A), and the bows (B P).

    Bows have a prior of variance 1; planes are held as in `normal_equations`.
    """
    blocks = normal_blocks(pose, points, weights, found.both[None], turns, bows)
    size = POSE_PARAMETERS + (3 + bows[0].shape[1]) * len(pose.planes) + 2 * turns[0].shape[2]
    information, gradient = np.empty((size, size)), np.empty(size)
    steps.assemble(np.ascontiguousarray(pose.planes), bows[1], blocks, information, gradient)
    return information, gradient


def solve_normal_equations(information: FloatArray, right: FloatArray, damping: float = 0.0) -> FloatArray:
    """The step for one right-hand side (S,), or steps for many (S, K); DegenerateError where nothing determines one.

    The diagonal of `information` counts 1 + damping times: Levenberg and Marquardt's step.
    """
    size = len(information)
    columns = np.ascontiguousarray(right).reshape(size, -1)
    solution, room = np.empty(columns.shape), np.empty((size, size + columns.shape[1]))
    if not steps.solve(np.ascontiguousarray(information), columns, damping, room, solution):
        raise DegenerateError("pose: the points do not determine it; show a plane that fills more of the picture")
    return solution.reshape(right.shape)


def _symmetric(lower: FloatArray) -> FloatArray:
    full = lower + lower.T
    full.flat[:: len(lower) + 1] /= 2
    return full


def _placed(pose: TwoViewPose, points: TwoViewPoints, bows: PlaneBows) -> _Placed:
    """What the kernels begin with, as they take it."""
    return (
        np.ascontiguousarray(pose.R),
        direction_axes(pose.t),
        np.ascontiguousarray(pose.planes),
        np.ascontiguousarray(points.camera_rays),
        np.ascontiguousarray(points.projector_rays),
        np.ascontiguousarray(points.camera_sigma),
        np.ascontiguousarray(points.projector_sigma),
        np.ascontiguousarray(points.plane_index),
        *bows,
    )


def pose_covariance(information: FloatArray) -> FloatArray:
    """(5, 5) covariance of (rotation vector in the projector frame, direction of t in `tangent_basis`).

    The Cramer-Rao bound where `information` comes from true parameters and true variances. Raises
    DegenerateError where the data do not determine the pose.

    >>> pose_covariance(np.diag([4.0, 4, 4, 1, 1])).diagonal().tolist()
    [0.25, 0.25, 0.25, 1.0, 1.0]
    """
    scale = np.sqrt(np.maximum(np.diag(information), 0.0))
    if not (scale > 0).all():
        raise DegenerateError("pose: the points do not determine it; show a plane that fills more of the picture")
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    if not values[0] > 1e-13 * values[-1]:
        raise DegenerateError("pose: the points do not determine it; show a plane that fills more of the picture")
    root = (vectors[:POSE_PARAMETERS] / np.sqrt(values)) / scale[:POSE_PARAMETERS, None]
    return root @ root.T


def cramer_rao_bound(pose: TwoViewPose, points: TwoViewPoints) -> FloatArray:
    """(5, 5) smallest covariance that any unbiased estimator can have, for noise-free points at the true pose.

    Parameters as in `residuals`; the sigmas of `points` are the true ones. Source: docs/method.md.
    """
    information, _, _ = normal_equations(pose, points, np.ones((2, len(points))), NO_COLUMNS)
    return pose_covariance(information)


def planes_of_pose(R: FloatArray, t: FloatArray, homographies: list[FloatArray]) -> FloatArray:
    """n (P, 3) of each plane for a given pose: the least-squares solution of lambda H = R + t n^T, eq. (28).

    >>> H = np.eye(3) + np.outer([1.0, 0, 0], [0.1, 0.2, 0.3])
    >>> planes_of_pose(np.eye(3), np.array([1.0, 0, 0]), [2 * H]).round(9).tolist()
    [[0.1, 0.2, 0.3]]
    """
    planes = np.empty((len(homographies), 3))
    if homographies:
        steps.planes_of_pose(np.ascontiguousarray(R), np.ascontiguousarray(t), np.stack(homographies), planes)
    return planes


def pose_difference(pose: TwoViewPose, other: TwoViewPose) -> FloatArray:
    """(5,) from a pose to another, in the frame of that, see `pose_covariance`; an angle also where t is far off."""
    step, given = np.empty(POSE_PARAMETERS), [np.ascontiguousarray(part) for part in (pose.R, pose.t, other.R)]
    steps.difference(given[0], given[1], given[2], direction_axes(other.t), step)
    return step
