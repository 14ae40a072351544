"""The kernel says to the last bit what it says uncompiled, and answers only what is well posed."""

import numpy as np

from retrue.kernels import planar_pose
from tests.kernels.plain import plain

AXIS = 0.0, 0.0, 1.0


def solved(kernel: object, stack: np.ndarray) -> tuple[bool, np.ndarray]:
    rows = np.empty((10 * len(stack), 3))
    return kernel.planar_poses_of_stack(stack, *AXIS, rows), rows


def test_compiled_and_plain_agree_to_the_last_bit() -> None:
    stack = np.random.default_rng(0).normal(0, 1, (300, 3, 3))
    stack[::7, 2] = stack[::7, 1]  # singular
    stack[::11] = np.eye(3)
    stack[::13] = 0
    mine, rows = solved(planar_pose, stack)
    plains, plain_rows = solved(plain("planar_pose"), stack)
    assert not mine
    assert not plains
    assert 0.1 < np.isnan(rows).mean() < 0.5
    np.testing.assert_array_equal(rows, plain_rows)


def test_one_and_many_are_the_same() -> None:
    stack = np.random.default_rng(1).normal(0, 1, (50, 3, 3))
    _, rows = solved(planar_pose, stack)
    for H, expected in zip(stack, rows.reshape(-1, 10, 3), strict=True):
        out = np.empty((10, 3))
        assert planar_pose.planar_poses(H, *AXIS, out) == (not np.isnan(expected).any())
        np.testing.assert_array_equal(out, expected)


def test_another_shape_is_not_answered() -> None:
    assert not planar_pose.planar_poses(np.eye(4), *AXIS, np.empty((10, 3)))
