"""Moving least squares as the formula has it, compiled and plain."""

import numpy as np
import pytest

from retrue.kernels import moving_surface
from tests.kernels.plain import plain


@pytest.mark.parametrize("kernel", [moving_surface, plain("moving_surface")])
def test_heights_are_weighted_distances_along_mean_normals(kernel) -> None:
    rng = np.random.default_rng(4)
    points, places, sigma = rng.normal(size=(40, 3)), rng.normal(size=(15, 3)), rng.uniform(0.1, 0.3, 40)
    normals = rng.normal(size=(40, 3)) * 0.3 + [0, 0, 1]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    near = np.array([rng.permutation(41)[:9] for _ in places])  # 40: none
    near[3] = 40
    value, spread, normal = np.full(15, np.nan), np.full(15, np.nan), np.full((15, 3), np.nan)
    kernel.heights(places, points, normals, sigma, near, 0.7, 1.5, value, normal, spread)
    found = 0
    for place, rows, *told in zip(places, near, value, normal, spread, strict=True):
        rows = [row for row in rows if row < 40 and np.linalg.norm(place - points[row]) <= 1.5]
        if not rows:
            assert np.isnan(np.hstack(told)).all()
            continue
        weight = np.exp(-((place - points[rows]) ** 2).sum(axis=1) / 0.7**2) / sigma[rows] ** 2
        weight /= weight.sum()
        mean = weight @ normals[rows]
        mean /= np.linalg.norm(mean)
        along = normals[rows] + mean
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        away = weight @ ((place - points[rows]) * along).sum(axis=1)
        expected = np.hstack([away, mean, np.sqrt((weight**2 * sigma[rows] ** 2).sum())])
        np.testing.assert_allclose(np.hstack(told), expected, rtol=1e-12, atol=1e-14)
        found += 1
    assert found > 7
