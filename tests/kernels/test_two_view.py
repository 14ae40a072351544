"""The kernel says to the last bit what it says uncompiled, and adds up no more than it is asked to."""

import numpy as np
import pytest

from retrue.kernels import two_view
from tests.kernels.plain import plain

NOTHING = np.empty((2, 0))
NO_TURNS = np.empty((0, 2, 0)), np.empty((0, 2, 0))


def points(count: int) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(3)
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    planes = rng.normal([0, 0, 1], 0.3, (2, 3))
    rays, sigmas = rng.uniform(-0.4, 0.4, (2, count, 2)), rng.uniform(1e-4, 3e-4, (2, count))
    return R, np.eye(3), planes, *rays, *sigmas, rng.integers(-1, 2, count)


def test_compiled_and_plain_residuals_agree_to_the_last_bit() -> None:
    both = np.empty((2, 2, 40))
    for kernel, found in zip((two_view, plain("two_view")), both, strict=True):
        kernel.two_view(*points(40), found, NOTHING, np.empty((0, 2, 0)), *NO_TURNS, np.empty((0, 0, 0)))
    np.testing.assert_array_equal(both[0], both[1])
    assert np.isfinite(both[0, 0]).all()
    assert 0 < np.isnan(both[0, 1]).sum() < 40


def test_compiled_and_plain_sums_agree_to_the_last_bit() -> None:
    rng = np.random.default_rng(4)
    weights, columns = rng.uniform(-0.5, 1, (2, 40)), rng.normal(size=(3, 2, 40))
    blocks = np.zeros((2, 3, 11, 11))
    for kernel, found in zip((two_view, plain("two_view")), blocks, strict=True):
        kernel.two_view(*points(40), NOTHING, weights, columns, *NO_TURNS, found)
    np.testing.assert_array_equal(blocks[0], blocks[1])
    kept = np.where(weights[0] > 0, weights[0], 0)
    expected = np.tril(np.einsum("n,in,jn->ij", kept, columns[:, 0], columns[:, 0]))
    np.testing.assert_allclose(blocks[0, -1, 8:, 8:], expected, rtol=1e-12)


def test_turned_rays_change_both_residuals_as_finite_differences_say() -> None:
    rng = np.random.default_rng(5)
    camera, projector = rng.normal(size=(20, 2, 3)), rng.normal(size=(20, 2, 2))
    R, axes, planes, x, y, sigma_x, sigma_y, index = points(20)
    index[:] = np.arange(20) % 2
    h = np.einsum("nij,nj->ni", R + axes[0][:, None] * planes[index][:, None, :], np.column_stack([x, np.ones(20)]))
    y = h[:, :2] / h[:, 2:] + rng.normal(0, 1e-7, (20, 2))

    def residuals(step: np.ndarray) -> np.ndarray:
        found = np.empty((2, 20))
        rays = x + camera @ step[:3], np.ascontiguousarray(y + projector @ step[3:])
        sigmas = sigma_x * np.exp(-step[0]), sigma_y * np.exp(-step[3])
        nothing = np.empty((0, 2, 0)), *NO_TURNS, np.empty((0, 0, 0))
        two_view.two_view(R, axes, planes, *rays, *sigmas, index, found, NOTHING, *nothing)
        return found

    both = residuals(np.zeros(5))
    steps = np.eye(5) * 1e-7
    expected = np.array([(residuals(step) - residuals(-step)) / 2e-7 for step in steps])
    for family in range(2):
        weights = np.zeros((2, 20))
        weights[family] = 1.0
        blocks = np.zeros((2, 3, 14, 14))
        for kernel, found in zip((two_view, plain("two_view")), blocks, strict=True):
            kernel.two_view(
                R, axes, planes, x, y, sigma_x, sigma_y, index, NOTHING, weights, both[None], camera, projector, found
            )
        np.testing.assert_array_equal(blocks[0], blocks[1])
        found = blocks[0].sum(axis=0)[9:, 9:]
        wanted = np.tril(expected[:, family] @ expected[:, family].T)
        np.testing.assert_allclose(found, wanted, atol=1e-4 * np.abs(wanted).max())


def test_more_columns_than_a_row_holds_are_refused() -> None:
    with pytest.raises(ValueError, match="columns"):
        two_view.two_view(*points(4), NOTHING, np.ones((2, 4)), np.ones((33, 2, 4)), *NO_TURNS, np.zeros((3, 41, 41)))
