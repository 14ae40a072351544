"""The kernel finds what it finds uncompiled, to rounding (its sums are reordered), and declines the same."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from retrue.kernels import homography
from tests.kernels.plain import plain

EQUAL = LINEAR = np.ones(0)


def pairs(count: int, seed: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    rng = np.random.default_rng(seed)
    H = np.eye(3) + rng.normal(0, 0.2, (3, 3))
    source = rng.uniform(-0.4, 0.4, (count, 2))
    mapped = np.column_stack([source, np.ones(count)]) @ H.T
    return source, mapped[:, :2] / mapped[:, 2:] + rng.normal(0, 1e-3, (count, 2))


@pytest.mark.parametrize("count", [4, 5, 8, 50, 128, 129, 400])
@pytest.mark.parametrize("sigmas", [(1.0, 1.0), (0.0, 1.0), (2.0, 0.0)])
def test_compiled_and_plain_agree(count: int, sigmas: tuple[float, float]) -> None:
    source, target = pairs(count, count)
    weights = np.random.default_rng(0).uniform(0.1, 1, count) if count % 2 else EQUAL
    mine, plains = np.empty((3, 3)), np.empty((3, 3))
    assert homography.fit_homography(source, target, weights, LINEAR, *sigmas, 5, 1e-6, mine)
    assert plain("homography").fit_homography(source, target, weights, LINEAR, *sigmas, 5, 1e-6, plains)
    assert np.abs(mine - plains).max() < 1e-10
    start = np.eye(3).ravel()
    assert homography.fit_homography(source, target, weights, start, *sigmas, 9, 1e-6, mine)
    assert plain("homography").fit_homography(source, target, weights, start, *sigmas, 9, 1e-6, plains)
    assert np.abs(mine - plains).max() < 1e-10


def test_it_is_the_maximum_of_the_likelihood() -> None:
    """Over H and the true source points at once."""
    source, target = pairs(30, 7)
    H = np.empty((3, 3))
    assert homography.fit_homography(source, target, EQUAL, LINEAR, 1.0, 0.5, 20, 1e-12, H)

    def residuals(unknown: NDArray[np.float64]) -> NDArray[np.float64]:
        s = unknown[8:].reshape(-1, 2)
        mapped = np.column_stack([s, np.ones(30)]) @ np.append(unknown[:8], 1.0).reshape(3, 3).T
        return np.concatenate([(source - s).ravel(), (target - mapped[:, :2] / mapped[:, 2:]).ravel() / 0.5])

    start = np.concatenate([(H / H[2, 2]).ravel()[:8] + 1e-4, source.ravel()])
    best = least_squares(residuals, start, xtol=1e-15, ftol=1e-15, gtol=1e-15).x[:8]
    assert np.abs(best - (H / H[2, 2]).ravel()[:8]).max() < 1e-5


@pytest.mark.parametrize("kernel", [homography, plain("homography")])
def test_what_does_not_serve_is_declined(kernel: object) -> None:
    source, target = pairs(20, 1)
    line, out = np.repeat(np.arange(20.0)[:, None], 2, axis=1), np.empty((3, 3))
    bad = np.full(20, 1.0)
    bad[3] = np.nan
    for case in (
        (source[:3], target[:3], EQUAL),
        (source, target[:19], EQUAL),
        (source, target, np.ones(5)),
        (source, target, bad),
        (source, target, -np.ones(20)),
        (line, line, EQUAL),
        (np.ones((20, 2)), target, EQUAL),
        (source, np.full((20, 2), np.nan), EQUAL),
    ):
        assert not kernel.fit_homography(*case, LINEAR, 1.0, 1.0, 5, 1e-6, out)
