"""The kernels say to the last bit what they say uncompiled, and what NumPy says to rounding."""

import numpy as np
import pytest

from retrue.geometry.robust import CUTOFF, biweight_loss
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


def test_weights_and_shared_parts_are_those_of_numpy() -> None:
    weights, variance, shared = np.empty((2, len(VALUES))), np.empty((2, len(VALUES))), []
    blocks = np.append(np.arange(200) % 7, [-1, 3])
    values = VALUES + np.append(np.arange(200) % 7 % 2 * 3.0, [0, 0])
    for k, kernel in enumerate((robust, plain("robust"))):
        shared.append(kernel.shared_part(values, 1.5, 6.0, blocks, *np.empty((2, 8)), weights[k], variance[k]))
    assert shared[0] == shared[1] > 0
    for pair in (weights, variance):
        np.testing.assert_array_equal(pair[0], pair[1])
    np.testing.assert_allclose(weights[0], np.fmax(1 - (values / 9) ** 2, 0) ** 2, rtol=1e-12, atol=1e-15)
    good = slice(0, 200)
    number = np.bincount(blocks[good], weights[0, good])
    total = np.bincount(blocks[good], (weights[0] * values)[good])
    excess = (total**2 / number).sum() / 1.5**2 - 7
    assert shared[0] == pytest.approx(1.5 * np.sqrt(excess / number.sum()))
    np.testing.assert_allclose(variance[0, good], 1.5**2 + shared[0] ** 2 * number[blocks[good]])
    assert np.isinf(variance[0, 200])


def test_no_shared_part_is_seen_where_blocks_scatter_as_their_points_do() -> None:
    blocks, weights, variance = np.arange(202) % 7, np.empty(202), np.empty(202)
    assert robust.shared_part(VALUES, 2.0, 6.0, blocks, *np.empty((2, 8)), weights, variance) == 0
    assert (variance == 4).all()


def test_neighbouring_blocks_that_are_alike_tell_less() -> None:
    rng, side = np.random.default_rng(5), 4
    number = np.append(rng.uniform(0, 20, 2 * side**2), 0.0)
    means = np.repeat([0.7, -0.9, 0.4, 0.8], 8) + rng.normal(0, 0.2, 2 * side**2)
    total = np.append(number[:-1] * means, 0.0)
    found = [kernel.alikeness(number, total, 1.1, side) for kernel in (robust, plain("robust"))]
    assert found[0] == found[1] > 1
    grid, known = means.reshape(2, side, side), number[:-1].reshape(2, side, side) > 3
    beside = (grid[:, :, 1:] * grid[:, :, :-1])[known[:, :, 1:] & known[:, :, :-1]]
    below = (grid[:, 1:] * grid[:, :-1])[known[:, 1:] & known[:, :-1]]
    correlation, lag = np.append(beside, below).mean() / 1.1**2, np.arange(1, side)
    assert found[0] == pytest.approx((1 + 2 * ((1 - lag / side) * correlation**lag).sum()) ** 2)
    assert robust.alikeness(np.zeros(17), np.zeros(17), 1.0, 4) == 1  # none has a neighbour that tells
    assert robust.alikeness(np.full(17, 9.0), np.full(17, 9.0), 0.5, 4) == pytest.approx(16)  # all are as one


@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 1.0])
def test_quantiles_are_those_of_numpy(share: float) -> None:
    for count in (1, 2, 3, 10, 101):
        values = np.append(np.random.default_rng(count).normal(size=count).round(1), [np.nan, np.inf])
        expected = np.quantile(np.abs(values[:-2]), share)
        for kernel in (robust, plain("robust")):
            assert kernel.absolute_quantile(values, 1, share, np.empty(count + 2)) == pytest.approx(expected)
    assert robust.absolute_quantile(np.arange(10.0), 3, 0.5, np.empty(4)) == 4.5
    assert robust.absolute_quantile(np.array([np.nan]), 1, 0.5, np.empty(1)) == 0


def test_each_plane_weighs_at_its_own_level_and_the_rest_within_reach() -> None:
    rng = np.random.default_rng(2)
    both, plane = rng.normal(0, 1, (2, 60)), np.arange(60) % 3 - 1
    both[:, plane == 1] *= 5
    both[0, plane == -1] *= 100
    both[1, plane == -1] = np.nan
    found = []
    for kernel in (robust, plain("robust")):
        levels, weights = np.empty(3), np.empty((2, 60))
        reach = kernel.gather_weights(both, plane, 2, np.inf, 90.0, 1.4826, 6.0, 1e-9, np.empty(120), levels, weights)
        found.append((reach, levels, weights))
    assert found[0][0] == found[1][0] == 30
    np.testing.assert_array_equal(found[0][1], found[1][1])
    np.testing.assert_array_equal(found[0][2], found[1][2])
    for index in (0, 1):
        assert found[0][1][index + 1] == pytest.approx(1.4826 * np.median(np.abs(both[:, plane == index])))
    relative = both / found[0][1][plane + 1]
    expected = np.fmax(1 - (relative / 6) ** 2, 0) ** 2 / found[0][1][plane + 1] ** 2
    np.testing.assert_allclose(found[0][2], expected, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("count", [149, 151, 900])
@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 0.99])
def test_quantiles_of_many_are_those_of_all(count: int, share: float) -> None:
    rng = np.random.default_rng(count)
    normal = rng.normal(size=count)
    for values in (normal, np.sort(normal), np.round(normal), np.zeros(count), np.where(normal > 1, np.nan, normal)):
        expected = np.nanquantile(np.abs(values), share)
        for kernel in (robust, plain("robust")):
            assert kernel.absolute_quantile(values, 1, share, np.empty(count + 1)) == pytest.approx(expected)


def test_what_lies_between_is_counted() -> None:
    values, counts = np.array([0.5, -2.0, 7.0, np.nan, -9.0, 80.0, 0.0]), np.empty(2, dtype=np.int64)
    rows = np.array([1, 1, 1, 1, 1, 1, 0], dtype=np.uint8)
    for kernel in (robust, plain("robust")):
        kernel.count_between(values, rows, 2.0, 1.0, 3.0, 30.0, counts)
        assert counts.tolist() == [1, 2]


def test_rows_that_are_silenced() -> None:
    families, weights = np.stack([VALUES, VALUES**2]), np.ones((2, len(VALUES)))
    rows = np.arange(len(VALUES)) % 3 == 0
    for kernel in (robust, plain("robust")):
        values, left = np.zeros((2, *families.shape))
        kernel.silence(families, weights, rows.view(np.uint8), values, left)
        np.testing.assert_array_equal(values, np.where(rows, np.nan, families))
        np.testing.assert_array_equal(left, np.where(rows, 0.0, weights))


def test_a_loss_is_added_up_to_the_most() -> None:
    values = np.random.default_rng(6).normal(0, 3, (40, 2))
    values[3], values[7] = np.nan, 1e9
    found = []
    for kernel in (robust, plain("robust")):
        total = np.linspace(0, 1, 40)
        kernel.add_loss(values, 1, 0.7, 2.0, CUTOFF, 12.0, total)
        found.append(total)
    np.testing.assert_array_equal(*found)
    expected = np.linspace(0, 1, 40) + np.minimum(biweight_loss(values[:, 1] / 0.7) + 2.0, 12.0)
    np.testing.assert_allclose(found[0], expected)
