"""Pose from a plane: the truth is always among the two candidates, and they are each other's twin."""

import numpy as np
import pytest

from retrue.errors import DegenerateError, InputError
from retrue.geometry.homography import apply_homography, fit_homography
from retrue.geometry.paper_solver import paper_pose_candidates
from retrue.geometry.planar_pose import PlanarPose, in_front, planar_pose_candidates, twin_pose
from retrue.geometry.transform import direction_angle, rotation_from_vector


def random_pose(rng: np.random.Generator, kind: str = "any") -> PlanarPose:
    """A rig and a plane that both devices see from the same side, t at least 1 deg off the plane's normal."""
    while True:
        R = rotation_from_vector(rng.normal(0, 0.4, 3))
        t = rng.normal(0, 0.5, 3)
        if kind == "rectified":
            R, t[2] = np.eye(3), 0.0
        if kind == "t3 < 0":
            t[2] = -abs(t[2])
        normal = rng.normal(size=3)
        normal *= np.sign(normal[2]) / np.linalg.norm(normal)
        pose = PlanarPose(R, t, normal)
        fold = min(direction_angle(t, R @ normal), direction_angle(-t, R @ normal))
        corners = [[-0.3, -0.3], [0.3, -0.3], [0.3, 0.3], [-0.3, 0.3]]
        if np.degrees(fold) > 1 and normal[2] > 0.2 and in_front(pose, corners).all():
            return pose


@pytest.mark.parametrize("kind", ["any", "rectified", "t3 < 0"])
def test_truth_is_among_the_two_candidates_from_points(kind: str) -> None:
    rng = np.random.default_rng(7)
    for _ in range(300):
        truth = random_pose(rng, kind)
        camera = rng.uniform(-0.3, 0.3, (20, 2))
        H = fit_homography(camera, apply_homography(truth.homography, camera))
        candidates = planar_pose_candidates(H)
        errors = [
            max(
                np.abs(pose.R - truth.R).max(),
                np.abs(pose.translation_over_distance - truth.translation_over_distance).max(),
                np.abs(pose.normal - truth.normal).max(),
            )
            for pose in candidates
        ]
        assert min(errors) < 1e-9
        for pose in candidates:
            assert np.abs(pose.R @ pose.R.T - np.eye(3)).max() < 1e-13
            assert np.linalg.det(pose.R) > 0


def test_the_twin_in_closed_form_is_the_other_candidate() -> None:
    rng = np.random.default_rng(8)
    for _ in range(300):
        first, second = planar_pose_candidates(random_pose(rng).homography)
        for one, other in ((first, second), (second, first)):
            twin = twin_pose(one)
            assert np.abs(twin.R - other.R).max() < 1e-9
            assert np.abs(twin.homography - other.homography).max() < 1e-9


def test_scale_and_sign_of_the_homography_do_not_matter() -> None:
    H = random_pose(np.random.default_rng(1)).homography
    for pose, same in zip(planar_pose_candidates(H), planar_pose_candidates(-3e5 * H), strict=True):
        assert np.abs(pose.homography - same.homography).max() < 1e-12


def test_paper_solver_finds_the_truth_where_t3_is_positive_and_misses_a_rectified_pair() -> None:
    rng = np.random.default_rng(9)
    for _ in range(200):
        truth = random_pose(rng)
        if truth.translation_over_distance[2] < 0.02:
            continue
        poses = paper_pose_candidates(truth.homography)
        assert min(np.abs(pose.R - truth.R).max() for pose in poses) < 1e-5
        for pose in poses:
            assert np.linalg.det(pose.R) > 0
            assert np.abs(pose.R @ pose.R.T - np.eye(3)).max() < 1e-12
    rectified = random_pose(rng, "rectified")
    found = paper_pose_candidates(rectified.homography)
    assert not any(np.abs(pose.R - rectified.R).max() < 1e-6 for pose in found if pose.R.any())


@pytest.mark.parametrize(
    ("homography", "error"),
    [
        (np.zeros((3, 3)), (DegenerateError, InputError)),
        (np.eye(3), DegenerateError),
        (np.diag([1.0, 1.0, 0.0]), DegenerateError),
        (np.full((3, 3), np.nan), InputError),
        (np.eye(2), InputError),
    ],
)
def test_hopeless_homographies_are_refused(homography: np.ndarray, error: type[Exception]) -> None:
    with pytest.raises(error):
        planar_pose_candidates(homography)
