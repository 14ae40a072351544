"""The kernel says what it says uncompiled, and what NumPy says."""

import numpy as np
import pytest

from retrue.kernels import copies
from tests.kernels.plain import plain

KERNELS = copies, plain("copies")


@pytest.mark.parametrize("strips", [2, 7, 64])
@pytest.mark.parametrize("reach", [0.02, 0.6, 30.0])
def test_what_lies_within_reach_of_the_mode(strips: int, reach: float) -> None:
    rng = np.random.default_rng(2)
    places = np.concatenate([rng.normal(size=(2, 50)), rng.integers(0, 4, (2, 50)) * reach], axis=1)
    places[:, 3], places[0, 7], places[0, 12] = np.nan, np.inf, -np.inf
    every = 3
    with np.errstate(invalid="ignore"):
        near = (np.abs(places[:, :, None] - places[:, None]) < reach).all(axis=0)
    expected = near[every * int(np.argmax(near[::every].sum(axis=1)))]
    for kernel in KERNELS:
        room = np.empty(strips + 2, dtype=np.int64), np.empty((2, 100))
        members = np.zeros(100, dtype=np.uint8)
        kernel.within_reach_of_mode(places, every, reach, *room, members)
        np.testing.assert_array_equal(members, expected)
        kernel.within_reach_of_mode(places[:, :0].copy(), every, reach, *room, members[:0])  # of none, none is
        lost = np.full((2, 5), np.nan)
        kernel.within_reach_of_mode(lost, 1, reach, *room, members[:5])
        assert not members[:5].any()


def test_the_step_that_puts_a_point_where_it_is() -> None:
    rng = np.random.default_rng(3)
    forth = np.column_stack([rng.uniform(-0.5, 0.5, (30, 2)), rng.uniform(0.9, 1.1, 30)])
    inverse_depth, found = rng.uniform(0.5, 2.0, 30), []
    places = forth[:, :2] / forth[:, 2:] + rng.normal(0, 0.1, (30, 2))
    for kernel in KERNELS:
        weights, relative, gaps = np.empty((2, 30)), np.empty((2, 30, 2)), np.empty(30)
        kernel.steps(places, forth, inverse_depth, weights, relative, gaps)
        found.append((weights, relative, gaps))
    for compiled, uncompiled in zip(*found, strict=True):
        np.testing.assert_array_equal(compiled, uncompiled)
    weights, relative, gaps = found[0]
    gap = places - forth[:, :2] / forth[:, 2:]
    np.testing.assert_array_equal(gaps, np.abs(gap).max(axis=1))
    for axis in (0, 1):
        length, angle = np.exp(relative[axis, :, 0]), relative[axis, :, 1]
        p = length[:, None] * np.roll(np.column_stack([np.cos(angle), np.sin(angle)]), axis, axis=1)
        moved = forth[:, :2] + weights[axis][:, None] * p
        np.testing.assert_allclose(moved / forth[:, 2:], places)
        assert (np.abs(angle) <= np.pi / 2).all()
        np.testing.assert_array_equal(np.abs(weights[axis]), inverse_depth)


def test_the_shift_that_most_agree_with() -> None:
    rng = np.random.default_rng(4)
    gradient, right = rng.normal(size=(2, 40)), np.array([3.0, -5.0])
    missed = right @ gradient + rng.normal(0, 0.01, 40)
    missed[::3], missed[7] = rng.normal(0, 5, 14), np.nan
    drawn = np.arange(1, 40, 3)
    pairs = np.array([(i, j) for k, i in enumerate(drawn) for j in drawn[k + 1 :] if 7 not in (i, j)])
    shifts = np.linalg.solve(gradient.T[pairs], missed[pairs][..., None])[..., 0]
    counts = (np.abs(missed - shifts @ gradient) < 0.05).sum(axis=1)
    for kernel in KERNELS:
        shift, parallel = np.empty(2), np.empty(2)
        assert kernel.shift_of_most(gradient, missed, drawn, 0.05, shift) == counts.max() > 20
        np.testing.assert_allclose(shift, shifts[np.argmax(counts)], rtol=1e-6)
        along = np.stack([np.zeros(40), gradient[1]])  # what nothing tells of is left as it is
        assert kernel.shift_of_most(along, -5 * gradient[1], drawn, 0.05, parallel) == 40
        np.testing.assert_allclose(parallel, [0, -5], atol=1e-6)
        assert kernel.shift_of_most(gradient, missed, drawn[:1], 0.05, shift) == -1  # one tells none
