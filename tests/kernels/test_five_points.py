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
    limits, few = np.array([0.004, 0.3]), [np.ascontiguousarray(rays.T) for rays in (x, y)]
    agreement = np.maximum(1 - squares / limits[:, None, None], 0).sum(axis=2)
    assert 0 < agreement[0].argmax() != agreement[1].argmax()
    for kernel in (five_points, plain("five_points")):
        best, most = np.empty(2, dtype=np.int64), np.zeros(2)
        kernel.most_agreed(E, *few, limits, best, most)
        np.testing.assert_array_equal(best, agreement.argmax(axis=1))
        np.testing.assert_allclose(most, agreement.max(axis=1), rtol=1e-12)
        kernel.most_agreed(E, *few, limits, best, most)
        np.testing.assert_array_equal(best, -1)  # none has more
