"""The kernel says what it says uncompiled, and what NumPy says."""

import numpy as np

from retrue.kernels import copies
from tests.kernels.plain import plain

KERNELS = copies, plain("copies")


def test_what_lies_within_reach_of_the_mode() -> None:
    places = np.random.default_rng(2).normal(size=(2, 50))
    places[:, 3] = np.nan
    every, reach = 3, 0.6
    near = (np.abs(places[:, :, None] - places[:, None]) < reach).all(axis=0)
    expected = near[every * int(np.argmax(near[::every].sum(axis=1)))]
    for kernel in KERNELS:
        members = np.zeros(50, dtype=np.uint8)
        kernel.within_reach_of_mode(places, every, reach, members)
        np.testing.assert_array_equal(members, expected)
        kernel.within_reach_of_mode(places[:, :0].copy(), every, reach, members[:0])  # of none, none is


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
