"""What a kernel leaves to NumPy is answered or refused all the same, and so is what no kernel takes."""

import numpy as np
import pytest

from retrue.errors import DegenerateError, InputError
from retrue.geometry import planar_pose
from retrue.geometry.homography import apply_homography, fit_homography
from retrue.geometry.planar_pose import planar_pose_candidates, planar_pose_candidates_batch
from retrue.geometry.transform import rotation_from_vector


def random_homographies(count: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    R = np.array([rotation_from_vector(w) for w in rng.normal(0, 0.5, (count, 3))])
    n = rng.normal([0, 0, 1], 0.4, (count, 3))
    return (R + rng.normal(0, 0.4, (count, 3, 1)) * n[:, None]) * rng.normal(0, 1, (count, 1, 1))


def test_poses_agree_with_singular_values() -> None:
    stack = random_homographies(2000)
    mine = planar_pose_candidates_batch(stack)
    single = [[pose.R for pose in planar_pose_candidates(H)] for H in stack[:200]]
    rows = planar_pose._rows_by_singular_values(stack, planar_pose.OPTICAL_AXIS).reshape(-1, 2, 5, 3)
    for name, expected in (
        ("R", rows[:, :, :3]),
        ("translation_over_distance", rows[:, :, 3]),
        ("normal", rows[:, :, 4]),
    ):
        assert np.abs(getattr(mine, name) - expected).max() < 1e-10
    assert np.array_equal(np.array(single), mine.R[:200])


def test_an_ill_conditioned_homography_has_poses_too() -> None:
    H = np.diag([1e6, 1.0, 0.5])
    for pose in planar_pose_candidates(H):
        again = pose.homography
        assert np.abs(again / again[0, 0] - H / 1e6).max() < 1e-9


def test_points_almost_on_a_line_are_fitted_all_the_same() -> None:
    rng = np.random.default_rng(3)
    H = random_homographies(1)[0]
    source = np.column_stack([np.linspace(-0.4, 0.4, 40), rng.uniform(-1e-6, 1e-6, 40)])
    fitted = fit_homography(source, apply_homography(H, source))
    assert np.abs(apply_homography(fitted, source) - apply_homography(H, source)).max() < 1e-9


@pytest.mark.parametrize(
    "as_given", [np.ndarray.tolist, np.asfortranarray, np.float32, lambda x: np.repeat(x, 2, 0)[::2]]
)
def test_any_array_will_do(as_given) -> None:
    rng = np.random.default_rng(4)
    H = random_homographies(1)[0]
    source = rng.uniform(-0.4, 0.4, (30, 2)).astype(np.float32).astype(float)
    target = apply_homography(H, source).astype(np.float32).astype(float)
    weights = np.ones(30)
    expected = fit_homography(source, target, weights=weights)
    assert (
        np.abs(fit_homography(as_given(source), as_given(target), weights=as_given(weights)) - expected).max() < 1e-13
    )
    rounded = H.astype(np.float32).astype(float)
    for mine, pose in zip(planar_pose_candidates(as_given(rounded)), planar_pose_candidates(rounded), strict=True):
        assert np.array_equal(mine.R, pose.R)


def test_hopeless_input_is_refused() -> None:
    line = np.stack([np.arange(60.0), 2 * np.arange(60.0)], axis=1)
    three_of_four = np.array([[0, 0], [1, 1], [2, 2], [0, 1.0]])
    for points in (line, three_of_four, np.ones((5, 2))):
        with pytest.raises(DegenerateError):
            fit_homography(points, points)
    for bad in (line[:3], np.full((5, 2), np.nan), np.ones((5, 3))):
        with pytest.raises(InputError):
            fit_homography(bad, bad)
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    with pytest.raises(InputError, match="weights >= 0, found -1"):
        fit_homography(square, square, weights=[1, 1, 1, -1])
    for H in (np.zeros((3, 3)), np.eye(3), np.diag([1.0, 1.0, 0.0]), np.full((3, 3), np.nan)):
        with pytest.raises((DegenerateError, InputError)):
            planar_pose_candidates(H)
        assert np.isnan(planar_pose_candidates_batch(H[None]).R).all()
