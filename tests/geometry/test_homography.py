"""The homography estimator reaches the bound, and refuses what does not determine one."""

import numpy as np
import pytest

from retrue.errors import DegenerateError, InputError
from retrue.geometry.homography import (
    apply_homography,
    fit_homography,
    fit_homography_linear,
    homography_residuals,
)

TRUTH = np.array([[1.1, 0.05, 0.2], [-0.1, 0.95, -0.1], [0.3, -0.2, 1.0]])


def gold_standard_cost(h: np.ndarray, source: np.ndarray, target: np.ndarray) -> float:
    """Full bundle adjustment, the slow way: the true source points are unknowns too."""
    from scipy.optimize import least_squares

    count = len(source)

    def errors(unknown: np.ndarray) -> np.ndarray:
        points = unknown[9:].reshape(count, 2)
        mapped = apply_homography(unknown[:9].reshape(3, 3), points)
        return np.concatenate([(points - source).ravel(), (mapped - target).ravel()])

    start = np.concatenate([h.ravel(), source.ravel()])
    return 2 * float(least_squares(errors, start, xtol=1e-15, ftol=1e-15, gtol=1e-15).cost)


def test_it_settles_where_the_full_bundle_adjustment_does() -> None:
    rng = np.random.default_rng(3)
    source = rng.uniform(-0.5, 0.5, (12, 2))
    target = apply_homography(TRUTH, source) + rng.normal(0, 0.02, (12, 2))
    source = source + rng.normal(0, 0.02, (12, 2))
    H = fit_homography(source, target, iterations=20)
    cost = float((homography_residuals(H, source, target) ** 2).sum())
    best = gold_standard_cost(H, source, target)
    assert cost == pytest.approx(best, rel=2e-3)  # the residual itself is a first-order one


def test_residuals_are_chi_square_with_2n_minus_8_degrees_of_freedom() -> None:
    rng = np.random.default_rng(4)
    source, sums = rng.uniform(-0.5, 0.5, (50, 2)), []
    target = apply_homography(TRUTH, source)
    for _ in range(200):
        noisy_source = source + rng.normal(0, 1e-3, source.shape)
        noisy_target = target + rng.normal(0, 2e-3, target.shape)
        H = fit_homography(noisy_source, noisy_target, source_sigma=1e-3, target_sigma=2e-3)
        sums.append((homography_residuals(H, noisy_source, noisy_target, 1e-3, 2e-3) ** 2).sum())
    assert np.mean(sums) == pytest.approx(92, abs=4 * np.sqrt(2 * 92 / 200))


def test_sign_puts_points_in_front() -> None:
    source = np.random.default_rng(5).uniform(-0.5, 0.5, (9, 2))
    H = fit_homography(source, apply_homography(-TRUTH, source))
    assert (source @ H[2, :2] + H[2, 2] > 0).all()


@pytest.mark.parametrize("fit", [fit_homography, fit_homography_linear])
def test_what_does_not_determine_a_homography_is_refused(fit: object) -> None:
    line = np.stack([np.arange(6.0), 2 * np.arange(6.0)], axis=1)
    three_of_four = np.array([[0, 0], [1, 1], [2, 2], [0, 1.0]])
    for points in (line, three_of_four, np.ones((5, 2))):
        with pytest.raises(DegenerateError):
            fit(points, points)  # type: ignore[operator]
    for bad in (line[:3], np.full((5, 2), np.nan), np.ones((5, 3))):
        with pytest.raises(InputError):
            fit(bad, bad)  # type: ignore[operator]
