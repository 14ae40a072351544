"""The kernel says to the last bit what it says uncompiled, and adds up no more than it is asked to."""

import numpy as np
import pytest

from retrue.kernels import two_view
from tests.kernels.plain import plain

NOTHING = np.empty((2, 0))


def points(count: int) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(3)
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    planes = rng.normal([0, 0, 1], 0.3, (2, 3))
    rays, sigmas = rng.uniform(-0.4, 0.4, (2, count, 2)), rng.uniform(1e-4, 3e-4, (2, count))
    return R, np.eye(3), planes, *rays, *sigmas, rng.integers(-1, 2, count)


def test_compiled_and_plain_residuals_agree_to_the_last_bit() -> None:
    both = np.empty((2, 2, 40))
    for kernel, found in zip((two_view, plain("two_view")), both, strict=True):
        kernel.two_view(*points(40), found, NOTHING, np.empty((0, 2, 0)), np.empty((0, 0, 0)))
    np.testing.assert_array_equal(both[0], both[1])
    assert np.isfinite(both[0, 0]).all()
    assert 0 < np.isnan(both[0, 1]).sum() < 40


def test_compiled_and_plain_sums_agree_to_the_last_bit() -> None:
    rng = np.random.default_rng(4)
    weights, columns = rng.uniform(-0.5, 1, (2, 40)), rng.normal(size=(3, 2, 40))
    blocks = np.zeros((2, 3, 11, 11))
    for kernel, found in zip((two_view, plain("two_view")), blocks, strict=True):
        kernel.two_view(*points(40), NOTHING, weights, columns, found)
    np.testing.assert_array_equal(blocks[0], blocks[1])
    kept = np.where(weights[0] > 0, weights[0], 0)
    expected = np.tril(np.einsum("n,in,jn->ij", kept, columns[:, 0], columns[:, 0]))
    np.testing.assert_allclose(blocks[0, -1, 8:, 8:], expected, rtol=1e-12)


def test_more_columns_than_a_row_holds_are_refused() -> None:
    with pytest.raises(ValueError, match="columns"):
        two_view.two_view(*points(4), NOTHING, np.ones((2, 4)), np.ones((33, 2, 4)), np.zeros((3, 41, 41)))
