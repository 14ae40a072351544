"""Matches that agree: the kernel says what it says uncompiled, and what the equation says."""

import numpy as np

from retrue.kernels import five_points
from tests.kernels.plain import plain


def test_sampson_squares() -> None:
    rng = np.random.default_rng(0)
    E, x, y = rng.normal(size=(3, 3)), rng.normal(size=(30, 2)), rng.normal(size=(30, 2))
    found = np.empty((2, 30))
    for kernel, squares in zip((five_points, plain("five_points")), found, strict=True):
        kernel.sampson_squares(E, x, y, squares)
    np.testing.assert_array_equal(found[0], found[1])
    x, y = np.column_stack([x, np.ones(30)]), np.column_stack([y, np.ones(30)])
    lines = np.concatenate([(x @ E.T)[:, :2], (y @ E)[:, :2]], axis=1)
    np.testing.assert_allclose(found[0], np.einsum("ni,ij,nj->n", y, E, x) ** 2 / (lines**2).sum(axis=1), rtol=1e-9)


def test_the_one_that_most_agree_with() -> None:
    rng = np.random.default_rng(1)
    E, x, y = rng.normal(size=(12, 3, 3)), rng.normal(size=(40, 2)), rng.normal(size=(40, 2))
    squares = np.empty((12, 40))
    for one, row in zip(E, squares, strict=True):
        five_points.sampson_squares(one, x, y, row)
    best = int(np.argmax(np.maximum(1 - squares / 0.05, 0).sum(axis=1)))
    assert best > 0
    assert five_points.most_agreed(E, x, y, 0.05) == best
    assert plain("five_points").most_agreed(E, x, y, 0.05) == best
