"""The robust homography: near the bound among wrong matches, honest about its inliers, and silent on chance."""

import numpy as np
import pytest

from retrue.errors import DegenerateError, InputError
from retrue.geometry.homography import apply_homography, fit_homography
from retrue.geometry.robust_homography import fit_homography_robust, local_noise

TRUTH = np.array([[1.1, 0.05, 0.2], [-0.1, 0.95, -0.1], [0.3, -0.2, 1.0]])


def matches(count: int, wrong: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    source = rng.uniform(-0.3, 0.3, (count, 2))
    target = apply_homography(TRUTH, source) + rng.normal(0, 3e-4, (count, 2))
    bad = rng.random(count) < wrong
    target[bad] = rng.uniform(-0.4, 0.6, (int(bad.sum()), 2))
    return source, target, bad


@pytest.mark.parametrize("wrong", [0.0, 0.2, 0.5])
@pytest.mark.parametrize("count", [50, 400])
def test_wrong_matches_cost_little_more_than_their_number(count: int, wrong: float) -> None:
    rng = np.random.default_rng(1)
    corners = np.array([[-0.3, -0.3], [0.3, -0.3], [0.3, 0.3], [-0.3, 0.3]])
    found_error, best_error = [], []
    for seed in range(16):
        source, target, bad = matches(count, wrong, rng)
        found = fit_homography_robust(source, target, seed=seed)
        assert found.noise == pytest.approx(3e-4, rel=0.6)
        oracle = fit_homography(source[~bad], target[~bad], source_sigma=0)
        for H, errors in ((found.homography, found_error), (oracle, best_error)):
            errors.append(apply_homography(H, corners) - apply_homography(TRUTH, corners))
    assert np.sqrt(np.mean(np.square(found_error))) < 1.1 * np.sqrt(np.mean(np.square(best_error)))


@pytest.mark.parametrize("count", [16, 20])
def test_of_few_points_half_may_be_wrong(count: int) -> None:
    """Neighbours tell the noise badly then; the plane whose points agree most closely is found all the same."""
    rng = np.random.default_rng(7)
    corners = np.array([[-0.3, -0.3], [0.3, -0.3], [0.3, 0.3], [-0.3, 0.3]])
    astray = 0
    for seed in range(60):
        source = rng.uniform(-0.3, 0.3, (count, 2))
        target = apply_homography(TRUTH, source) + rng.normal(0, 3e-4, (count, 2))
        bad = rng.permutation(count) < count // 2
        target[bad] = rng.uniform(-0.4, 0.6, (count // 2, 2))
        found = fit_homography_robust(source, target, seed=seed).homography
        oracle = fit_homography(source[~bad], target[~bad], source_sigma=0)
        error, least = (
            np.abs(apply_homography(H, corners) - apply_homography(TRUTH, corners)).max() for H in (found, oracle)
        )
        astray += not error < max(3 * least, 2e-3)
    assert astray <= 1


def test_exact_points_and_a_given_noise_work() -> None:
    source, _, _ = matches(30, 0, np.random.default_rng(2))
    target = apply_homography(TRUTH, source)
    target[:8] += 0.1
    for noise in (None, 1e-4):
        found = fit_homography_robust(source, target, noise=noise)
        assert np.flatnonzero(~found.inliers).tolist() == list(range(8))
        assert np.abs(found.homography / found.homography[2, 2] - TRUTH).max() < 1e-8


def test_smooth_noise_of_a_dense_code_hides_no_plane() -> None:
    source = np.stack(np.meshgrid(np.linspace(-0.3, 0.3, 40), np.linspace(-0.3, 0.3, 40)), axis=-1).reshape(-1, 2)
    rng = np.random.default_rng(4)
    waves, phases = rng.normal(0, 30, (8, 2, 2)), rng.uniform(0, 2 * np.pi, (8, 2))
    smooth = 1e-4 * np.sin(np.einsum("nj,kcj->nkc", source, waves) + phases).sum(axis=1)
    found = fit_homography_robust(source, apply_homography(TRUTH, source) + smooth)
    assert found.inliers.mean() > 0.95
    assert found.noise == pytest.approx(smooth.std(), rel=0.5)


def test_matches_by_chance_are_refused() -> None:
    rng = np.random.default_rng(3)
    with pytest.raises(DegenerateError):
        fit_homography_robust(rng.uniform(-1, 1, (300, 2)), rng.uniform(-1, 1, (300, 2)))
    with pytest.raises(DegenerateError):
        fit_homography_robust(np.ones((20, 2)), np.ones((20, 2)))
    with pytest.raises(InputError):
        fit_homography_robust(np.ones((7, 2)), np.ones((7, 2)))
    with pytest.raises(InputError):
        fit_homography_robust(np.ones((20, 2)), np.ones((20, 2)), noise=float("nan"))


@pytest.mark.parametrize(("rows", "noise"), [(5, 3e-4), (12, 3e-4), (1, 0.0)])
def test_points_on_rows_that_lie_far_apart_tell_their_noise(rows: int, noise: float) -> None:
    """All neighbours of one are in its own row, and a line has no affine map; of fewer points they are farther away,
    where the map is no more affine. One row alone tells nothing.
    """
    rng = np.random.default_rng(3)
    x, y = np.meshgrid(np.linspace(-0.3, 0.3, 600), np.linspace(-0.3, 0.3, rows))
    source = np.column_stack([x.ravel(), y.ravel()])
    target = apply_homography(TRUTH, source) + rng.normal(0, 3e-4, source.shape)
    assert 0.5 * noise <= local_noise(source, target, rng) <= 4 * noise
