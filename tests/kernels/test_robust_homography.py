"""The kernels say to the last bit what they say uncompiled, and find what is there to be found."""

import numpy as np
import pytest

from retrue.kernels import robust_homography
from tests.kernels.plain import plain

TRUTH = np.array([[1.1, 0.05, 0.2], [-0.1, 0.95, -0.1], [0.3, -0.2, 1.0]])
BOTH = (robust_homography, plain("robust_homography"))


def points(count: int, wrong: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    x = rng.uniform(-0.4, 0.4, (count, 2))
    y = np.column_stack([x, np.ones(count)]) @ TRUTH.T
    y = y[:, :2] / y[:, 2:] + rng.normal(0, 1e-3, (count, 2))
    y[:wrong] = rng.uniform(-0.4, 0.6, (wrong, 2))
    return x, y


def test_samples_are_the_same_compiled_and_plain_and_the_best_of_them_are_kept() -> None:
    x, y = points(60, 20)
    best = np.zeros((2, 4, 10))
    for kernel, found in zip(BOTH, best, strict=True):
        kernel.search(x, y, 50, 8e-3, 2**63 - 5, 160, found)
    np.testing.assert_array_equal(best[0], best[1])
    assert (np.diff(best[0, :, 0]) <= 0).all()
    assert 20 < best[0, 0, 0] < 36
    in_parts = np.zeros((4, 10))
    for start in range(0, 160, 40):
        robust_homography.search(x, y, 50, 8e-3, 2**63 - 5 + 256 * start, 40, in_parts)
    np.testing.assert_array_equal(in_parts, best[0])


def test_a_refined_homography_is_that_of_the_points_that_agree() -> None:
    x, y = points(200, 60)
    H = np.tile(TRUTH.ravel() + 0.002, (2, 1))
    supports = [kernel.refine(x, y, 200, 4e-3, 50.0, 8, start) for kernel, start in zip(BOTH, H, strict=True)]
    assert supports[0] == supports[1]
    np.testing.assert_array_equal(H[0], H[1])
    distances = np.empty((2, 200))
    for kernel, found in zip(BOTH, distances, strict=True):
        kernel.transfer_distances(x, y, H[0], found)
    np.testing.assert_array_equal(distances[0], distances[1])
    assert supports[0] == pytest.approx(np.fmax(1 - (distances[0] / 4e-3) ** 2, 0).sum())
    assert np.abs(H[0] - TRUTH.ravel()).max() < 2e-3
    assert robust_homography.refine(x, y, 200, 4e-3, 150.0, 8, H[0]) == -1
    assert robust_homography.refine(x, y, 200, 4e-3, 5.0, 8, np.zeros(9)) == -1


def test_local_scatter_is_the_same_compiled_and_plain_and_as_large_as_the_noise() -> None:
    x, y = points(300, 0)
    rng = np.random.default_rng(1)
    triplets = rng.permuted(np.tile(np.arange(12), (20, 1)), axis=1)[:, :3].copy()
    scatter = np.empty((2, 30))
    for kernel, found in zip(BOTH, scatter, strict=True):
        kernel.local_scatter(x, y, np.arange(30), triplets, found)
    np.testing.assert_array_equal(scatter[0], scatter[1])
    assert 0.5e-3 < np.sqrt(np.median(scatter[0])) < 2e-3
