"""The kernels say to the last bit what they say uncompiled, and what NumPy says to rounding."""

import numpy as np
import pytest

from retrue.kernels import robust
from tests.kernels.plain import plain

VALUES = np.append(np.random.default_rng(0).normal(0, 2, 200), [np.nan, 50.0])
VALUES.setflags(write=False)


def test_the_level_is_where_it_reproduces_itself() -> None:
    found = robust.reweighted_level(VALUES, 1.0, 6.0, 1 / 0.8924, 1e-9, 30)
    assert found == plain("robust").reweighted_level(VALUES, 1.0, 6.0, 1 / 0.8924, 1e-9, 30)
    weights = np.fmax(1 - (VALUES[:200] / (6 * found)) ** 2, 0) ** 2
    assert found == pytest.approx(np.sqrt((weights * VALUES[:200] ** 2).sum() / weights.sum() / 0.8924), rel=1e-9)
    assert robust.reweighted_level(np.full(3, np.nan), 1.0, 6.0, 1.0, 1e-9, 4) == 1e-9


def test_weights_and_block_sums_are_those_of_numpy() -> None:
    weights = np.empty((2, len(VALUES)))
    blocks = np.append(np.arange(200) % 7, [-1, 3])
    number, total = np.zeros((2, 8)), np.zeros((2, 8))
    for k, kernel in enumerate((robust, plain("robust"))):
        kernel.biweights(VALUES, 1.5, 6.0, weights[k])
        kernel.block_sums(VALUES, weights[k], blocks, number[k], total[k])
    for pair in (weights, number, total):
        np.testing.assert_array_equal(pair[0], pair[1])
    np.testing.assert_allclose(weights[0], np.fmax(1 - (VALUES / 9) ** 2, 0) ** 2, rtol=1e-12, atol=1e-15)
    good = slice(0, 200)
    np.testing.assert_allclose(number[0, :7], np.bincount(blocks[good], weights[0, good]), rtol=1e-12)
    np.testing.assert_allclose(total[0, :7], np.bincount(blocks[good], (weights[0] * VALUES)[good]), rtol=1e-12)
