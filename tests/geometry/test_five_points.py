"""Five points: the truth is among the solutions, whatever the scene, and outliers do not hide it."""

from __future__ import annotations

import numpy as np
import pytest

from retrue.geometry.five_points import best_essentials, five_point_essentials, poses_of_essential, sampson_squares
from retrue.geometry.transform import RigidTransform, rotation_from_vector, skew

ALL = np.arange(5)[None]


def essential(pose: RigidTransform) -> np.ndarray:
    E = skew(pose.t) @ pose.R
    return E / np.linalg.norm(E)


def random_pose(rng: np.random.Generator) -> RigidTransform:
    t = rng.normal(size=3)
    return RigidTransform(rotation_from_vector(rng.uniform(-0.2, 0.2, 3)), t / np.linalg.norm(t))


def matches(pose: RigidTransform, count: int, rng: np.random.Generator, plane: bool = False) -> tuple[np.ndarray, ...]:
    """(N, 2) rays of points that both devices have in front."""
    x = rng.uniform(-0.4, 0.4, (count, 2))
    depth = 1 / (0.25 + x @ [0.1, -0.05]) if plane else rng.uniform(2.5, 6, count)
    y = pose.apply(depth[:, None] * np.c_[x, np.ones(count)])
    return x, y[:, :2] / y[:, 2:]


def distance(found: np.ndarray, truth: np.ndarray) -> float:
    """Of the nearest of the matrices (K, 3, 3), sign aside."""
    apart = [np.abs(found - sign * truth).max(axis=(1, 2)) for sign in (1, -1)]
    return float(np.min(apart))


@pytest.mark.parametrize("plane", [False, True])
def test_every_sample_of_exact_points_finds_the_truth(plane: bool) -> None:
    rng = np.random.default_rng(0)
    for _ in range(200):
        pose = random_pose(rng)
        x, y = matches(pose, 5, rng, plane)
        # On a plane solutions come near to each other, and rounding moves them by more.
        assert distance(five_point_essentials(x, y, ALL), essential(pose)) < (1e-7 if plane else 1e-9)


def test_every_solution_is_an_essential_matrix_that_the_matches_agree_with() -> None:
    rng = np.random.default_rng(1)
    counts = []
    for _ in range(50):
        x, y = matches(random_pose(rng), 5, rng)
        found = five_point_essentials(x, y, ALL)
        counts.append(len(found))
        for E in found:
            assert np.abs(np.einsum("ni,ij,nj->n", np.c_[y, np.ones(5)], E, np.c_[x, np.ones(5)])).max() < 1e-12
            assert np.abs(2 * E @ E.T @ E - np.trace(E @ E.T) * E).max() < 1e-6
            assert np.linalg.norm(E) == pytest.approx(1)
    assert max(counts) <= 10
    assert np.mean(counts) > 3


def test_of_a_degenerate_sample_there_is_none() -> None:
    x, y = np.zeros((2, 5, 2))
    assert len(five_point_essentials(x, y, ALL)) == 0
    assert best_essentials(x, y, [1e-3], lambda count: np.zeros((count, 5), dtype=np.int64), np.arange(5)) == []


@pytest.mark.parametrize("wrong", [0.33, 0.6])
def test_the_best_of_samples_is_near_the_truth_where_many_points_are_wrong(wrong: float) -> None:
    rng = np.random.default_rng(2)
    noise = 2e-4
    for _ in range(10):
        pose = random_pose(rng)
        x, y = matches(pose, 400, rng)
        good = rng.random(400) > wrong
        y = np.where(good[:, None], y, rng.uniform(-0.4, 0.4, y.shape)) + rng.normal(0, noise, y.shape)
        (E,) = best_essentials(x, y, [noise], lambda count: rng.integers(0, 400, (count, 5)), np.arange(400))
        agree = sampson_squares(E, x, y) < (5 * noise) ** 2
        assert np.mean(agree[good]) > 0.5
        assert np.mean(agree[~good]) < 0.1


def test_one_of_the_four_poses_is_the_one_that_made_the_matrix_and_all_are_proper() -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        pose = random_pose(rng)
        scale = rng.choice([-1, 1]) * rng.uniform(0.1, 10)
        poses = poses_of_essential(scale * essential(pose))
        assert len(poses) == 4
        for R, t in poses:
            np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
            assert np.linalg.det(R) == pytest.approx(1)
            assert np.linalg.norm(t) == pytest.approx(1)
        assert min(np.abs(R - pose.R).max() + np.abs(t - pose.t).max() for R, t in poses) < 1e-9


def test_the_sampson_distance_is_that_to_the_epipolar_line_to_first_order() -> None:
    rng = np.random.default_rng(4)
    pose = random_pose(rng)
    x, y = matches(pose, 50, rng)
    assert sampson_squares(essential(pose), x, y).max() < 1e-24
    lines = np.c_[x, np.ones(50)] @ essential(pose).T
    back = np.c_[y, np.ones(50)] @ essential(pose)
    normal = lines[:, :2] / np.linalg.norm(lines[:, :2], axis=1, keepdims=True)
    step = 1e-6
    expected = (step**2) * (lines[:, :2] ** 2).sum(1) / ((lines[:, :2] ** 2).sum(1) + (back[:, :2] ** 2).sum(1))
    np.testing.assert_allclose(sampson_squares(essential(pose), x, y + step * normal), expected, rtol=1e-3)
