"""Refinement over pose, planes and free points: Jacobians, the bound, and an honest covariance."""

import numpy as np
import pytest

from retrue.errors import DegenerateError
from retrue.geometry.transform import rotation_from_vector, vector_from_rotation
from retrue.geometry.two_view import (
    FREE,
    LITTLE,
    NO_COLUMNS,
    TwoViewPoints,
    TwoViewPose,
    cramer_rao_bound,
    epipolar_residuals,
    normal_equations,
    planes_of_pose,
    pose_covariance,
    residuals,
    tangent_basis,
)

T = np.array([0.9, 0.25, 0.2])
POSE = TwoViewPose(
    rotation_from_vector([0.1, 0.2, -0.1]), T / np.linalg.norm(T), np.array([[0.1, -0.2, 0.4], [-0.3, 0.1, 0.35]])
)


def scene(count: int, rng: np.random.Generator, planes: tuple[int, ...] = (-1, 0, 1)) -> TwoViewPoints:
    x = rng.uniform(-0.3, 0.3, (count, 2))
    plane = rng.choice(planes, count)
    on_plane = (x @ POSE.planes[:, :2].T + POSE.planes[:, 2])[np.arange(count), np.maximum(plane, 0)]
    inverse_depth = np.where(plane >= 0, on_plane, rng.uniform(0.2, 0.5, count))
    y = np.c_[x, np.ones(count)] @ POSE.R.T + inverse_depth[:, None] * POSE.t
    return TwoViewPoints(x, y[:, :2] / y[:, 2:], np.full(count, 3e-4), np.full(count, 2e-4), plane)


def noisy(points: TwoViewPoints, rng: np.random.Generator, scale: float = 1.0) -> TwoViewPoints:
    shape = points.camera_rays.shape
    return TwoViewPoints(
        points.camera_rays + scale * rng.normal(size=shape) * points.camera_sigma[:, None],
        points.projector_rays + scale * rng.normal(size=shape) * points.projector_sigma[:, None],
        points.camera_sigma,
        points.projector_sigma,
        points.plane_index,
    )


def test_jacobians_agree_with_differences() -> None:
    rng = np.random.default_rng(1)
    points = noisy(scene(200, rng), rng, 1e-3)
    steps = 1e-6 * np.eye(11)
    differences = np.array(
        [residuals(POSE.moved(step), points).both - residuals(POSE.moved(-step), points).both for step in steps]
    )
    for family in ([1.0, 0.0], [0.0, 1.0]):
        weights = np.outer(family, rng.uniform(0.5, 1, len(points)))
        information, cross, among = normal_equations(POSE, points, weights, differences / 2e-6)
        information -= np.diag(np.repeat([0, *1 / (POSE.planes**2).sum(axis=1)], (5, 3, 3)))
        information[range(5, 11), range(5, 11)] /= 1 + LITTLE  # what holds a plane of few points
        # |J - D|^2 of each column, from sums of products only; what is left is rounding.
        apart = np.diag(information) - 2 * np.diag(cross) + np.diag(among)
        assert np.abs(apart).max() < 1e-10 * np.diag(information).max()
        assert np.abs(cross - information).max() < 1e-6 * np.abs(information).max()


@pytest.mark.parametrize("planes", [(0,), (-1, 0, 1)])
def test_errors_are_those_of_the_cramer_rao_bound(planes: tuple[int, ...]) -> None:
    rng = np.random.default_rng(2)
    points = scene(200, rng, planes)
    truth = TwoViewPose(POSE.R, POSE.t, POSE.planes[: max(planes) + 1])
    bound = cramer_rao_bound(truth, points)
    trials, normalised, squares = 300, [], []
    for _ in range(trials):
        sample, pose = noisy(points, rng), truth
        for _ in range(4):
            found = residuals(pose, sample)
            information, gradient, _ = normal_equations(pose, sample, np.ones((2, len(sample))), found.both[None])
            pose = pose.moved(-np.linalg.solve(information, gradient[:, 0]))
        error = np.r_[vector_from_rotation(pose.R @ truth.R.T), tangent_basis(truth.t).T @ pose.t]
        normalised.append(error @ np.linalg.solve(bound, error))
        found = residuals(pose, sample)
        squares.append(np.nansum(found.both**2))
    assert np.mean(normalised) == pytest.approx(5, abs=4 * np.sqrt(2 * 5 / trials))
    freedom = len(points) + int((points.plane_index >= 0).sum()) - 5 - 3 * len(truth.planes)
    assert np.mean(squares) == pytest.approx(freedom, abs=4 * np.sqrt(2 * freedom / trials))


def test_planes_follow_from_pose_and_homography() -> None:
    homographies = [5 * (POSE.R + np.outer(POSE.t, n)) for n in POSE.planes]
    assert np.abs(planes_of_pose(POSE.R, POSE.t, homographies) - POSE.planes).max() < 1e-12


def test_a_pose_that_nothing_determines_is_refused() -> None:
    with pytest.raises(DegenerateError):
        pose_covariance(np.diag([1.0, 1, 1, 1, 0]))
    points = scene(4, np.random.default_rng(0), (-1,))
    with pytest.raises(DegenerateError):
        cramer_rao_bound(TwoViewPose(POSE.R, POSE.t), points)


def test_a_plane_without_points_leaves_the_pose_determined() -> None:
    rng = np.random.default_rng(4)
    points = noisy(scene(200, rng, (-1, 0)), rng)
    information, _, _ = normal_equations(POSE, points, np.ones((2, len(points))), NO_COLUMNS)
    alone = TwoViewPose(POSE.R, POSE.t, POSE.planes[:1])
    expected, _, _ = normal_equations(alone, points, np.ones((2, len(points))), NO_COLUMNS)
    assert np.allclose(pose_covariance(information), pose_covariance(expected), rtol=1e-6)


def test_residuals_are_distances_in_sigmas() -> None:
    """Along the line: the mapped point is sought among all on the plane; across it: Sampson's distance."""
    rng = np.random.default_rng(5)
    points = noisy(scene(60, rng), rng)
    found = residuals(POSE, points)
    assert np.array_equal(np.isnan(found.along), points.plane_index == FREE)
    assert np.allclose(found.epipolar, epipolar_residuals(POSE, points), rtol=2e-3, atol=1e-3)
    exact = TwoViewPoints(
        points.camera_rays, points.projector_rays, 0 * points.camera_sigma, points.projector_sigma, points.plane_index
    )
    found = residuals(POSE, exact)
    for k in np.flatnonzero(exact.plane_index != FREE):
        x = np.array([*exact.camera_rays[k], 1])
        mapped = POSE.R @ x + (POSE.planes[exact.plane_index[k]] @ x) * POSE.t
        apart = (exact.projector_rays[k] - mapped[:2] / mapped[2]) / exact.projector_sigma[k]
        assert np.hypot(*found.both[:, k]) == pytest.approx(np.hypot(*apart), rel=1e-9)
