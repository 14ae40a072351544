"""Refinement over pose, planes and free points: Jacobians, the bound, and an honest covariance."""

import numpy as np
import pytest

from retrue.errors import DegenerateError
from retrue.geometry.transform import rotation_from_vector, vector_from_rotation
from retrue.geometry.two_view import (
    TwoViewPoints,
    TwoViewPose,
    cramer_rao_bound,
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
    found = residuals(POSE, points)
    plane = points.plane_index[found.rows]
    for k in range(5 + 6):
        step = np.zeros(11)
        step[k] = 1e-6
        ahead, behind = residuals(POSE.moved(step), points), residuals(POSE.moved(-step), points)
        along = (ahead.along - behind.along) / 2e-6
        expected = found.along_jacobian[k] if k < 5 else found.along_jacobian[5 + (k - 5) % 3] * (plane == (k - 5) // 3)
        assert np.abs(along - expected).max() < 1e-5 * np.abs(along).max()
        epipolar = (ahead.epipolar - behind.epipolar) / 2e-6
        expected = found.epipolar_jacobian[k] if k < 5 else 0 * epipolar
        assert np.abs(epipolar - expected).max() <= 1e-5 * np.abs(epipolar).max()


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
            ones = np.ones(len(sample)), np.ones(len(found.rows))
            information, gradient = normal_equations(pose, sample, found, *ones)
            pose = pose.moved(-np.linalg.solve(information, gradient))
        error = np.r_[vector_from_rotation(pose.R @ truth.R.T), tangent_basis(truth.t).T @ pose.t]
        normalised.append(error @ np.linalg.solve(bound, error))
        found = residuals(pose, sample)
        squares.append((found.epipolar**2).sum() + (found.along**2).sum())
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
    found = residuals(POSE, points)
    information, _ = normal_equations(POSE, points, found, np.ones(len(points)), np.ones(len(found.rows)))
    alone = TwoViewPose(POSE.R, POSE.t, POSE.planes[:1])
    expected, _ = normal_equations(alone, points, found, np.ones(len(points)), np.ones(len(found.rows)))
    assert np.allclose(pose_covariance(information), pose_covariance(expected), rtol=1e-6)
