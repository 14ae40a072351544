"""How far planes scatter beside what their own edges say."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from retrue.decoding.gray.scatter import scatter_level

SHAPE = (301, 250)
OWN = np.float32(0.01)


def noise(seed: int) -> np.ndarray:
    """Of planes whose windows overlap, with a standard deviation of `OWN`."""
    smooth = ndimage.gaussian_filter(np.random.default_rng(seed).normal(size=SHAPE), 1.25)
    return OWN * smooth / smooth.std()


@pytest.mark.parametrize("shape", ["flat", "ball"])
def test_the_scatter_is_that_of_each_place(shape: str) -> None:
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    louder = np.where(x < 125, 1.0, 3.0)
    bent = 0.002 * ((x - 100.0) ** 2 + (y - 150.0) ** 2) * (shape == "ball")
    value = (0.7 * x + 0.1 * y + bent + louder * noise(1)).astype(np.float32)
    level = scatter_level(value, np.full(SHAPE, OWN**2), np.ones(SHAPE, np.uint8))
    assert level.shape == SHAPE
    for part, expected in ((level[:, 20:105], 1.0), (level[:, 145:-20], 9.0)):
        assert np.mean(part) == pytest.approx(expected, rel=0.2)


def test_where_few_tell_planes_are_believed() -> None:
    value, own = (5 * noise(2)).astype(np.float32), np.full(SHAPE, OWN**2)
    whole = np.zeros(SHAPE, np.uint8)
    whole[96:112, 100:110] = 1
    level = scatter_level(value, own, whole)
    assert (level[:60] == 1).all()
    assert 1 < level[104, 105] < scatter_level(value, own, np.ones(SHAPE, np.uint8))[96:112, 100:110].max()
    assert (scatter_level(value[:9, :9], own[:9, :9], whole[96:105, 100:109]) == 1).all()
