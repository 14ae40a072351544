"""What lies around places, blocks and points: the kernels say what they say uncompiled, and what NumPy does."""

import numpy as np
import pytest

from retrue.decoding.light import around, mean_levels
from retrue.geometry.two_view import TwoViewPoints
from retrue.kernels import surroundings
from retrue.recalibration.turned import turned_over
from tests.kernels.plain import plain

BOTH = surroundings, plain("surroundings")


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
def test_pixels_about_places(depth: type[np.unsignedinteger]) -> None:
    rng = np.random.default_rng(0)
    picture = rng.integers(0, np.iinfo(depth).max, (7, 9, 3), dtype=depth, endpoint=True)
    centres = np.concatenate([rng.uniform(-2, 10, (20, 2)), [[0.5, 1.5], [2.5, 3.5]]])
    column, row = np.round(centres).astype(np.int64).T
    down, right = (offset.ravel() for offset in np.mgrid[-1:2, -1:2])
    expected = picture[np.clip(row[:, None] + down, 0, 6), np.clip(column[:, None] + right, 0, 8)]
    np.testing.assert_array_equal(around(picture, centres), expected)
    np.testing.assert_array_equal(mean_levels(picture, centres), expected.mean(axis=1, dtype=np.float64))
    for kernel in BOTH:
        found, means = np.zeros_like(expected), np.empty((len(centres), 3))
        kernel.gather(picture.reshape(-1), 7, 9, 3, np.round(centres).astype(np.int64), found.reshape(-1))
        kernel.mean_levels(found, means)
        np.testing.assert_array_equal(found, expected)
        np.testing.assert_array_equal(means, expected.mean(axis=1, dtype=np.float64))


def test_mean_of_the_blocks_around() -> None:
    rng = np.random.default_rng(1)
    values = rng.uniform(0, 1, (4, 6, 3))
    values[rng.random(values.shape) < 0.4] = np.nan
    values[0, :2] = values[1, :2] = np.nan
    centres = np.stack(np.meshgrid(np.arange(6.0), np.arange(4.0)), axis=-1) * 10
    centres[2, 3] = np.nan
    share, farthest = rng.uniform(0.1, 1, (3, 3)), np.full((3, 3), 12.0)  # none across the corner
    expected = np.full(values.shape, np.nan)
    for r, c, k in np.ndindex(values.shape):
        known = [
            (share[i + 1, j + 1], values[r + i, c + j, k])
            for i, j in ((-1, 0), (0, -1), (0, 0), (0, 1), (1, 0))
            if 0 <= r + i < 4 and 0 <= c + j < 6 and np.isfinite(values[r + i, c + j, k])
            if np.isfinite(centres[r, c, 0] + centres[r + i, c + j, 0])
        ]
        if known:
            weights, found = zip(*known, strict=True)
            expected[r, c, k] = np.average(found, weights=weights)
    assert np.isnan(expected[0, 0]).all()
    means = np.zeros((2, *values.shape))
    for kernel, mean in zip(BOTH, means, strict=True):
        kernel.mean_of_blocks(values, centres, share, farthest, mean)
    np.testing.assert_array_equal(means[0], means[1])
    np.testing.assert_allclose(means[0], expected, rtol=1e-12)


def test_triangles_that_run_the_other_way_round() -> None:
    rng = np.random.default_rng(2)
    x = rng.uniform(-1, 1, (60, 2))
    y = x * np.where(np.arange(60) < 30, -1, 1)[:, None] ** [1, 0] + [3, 0]  # a half is mirrored
    neighbours = np.argsort(
        ((x[:, None] - x) ** 2).sum(axis=2) + 100 * ((np.arange(60)[:, None] < 30) != (np.arange(60) < 30))
    )
    neighbours = np.ascontiguousarray(neighbours[:, 1:5])
    found = np.empty((2, 60), dtype=np.bool_)
    for kernel, own in zip(BOTH, found, strict=True):
        kernel.turned_over(x, y, neighbours, 1e-6, 3, own.view(np.uint8))
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[0], np.arange(60) < 30)
    points = TwoViewPoints(x, y, np.ones(60), np.ones(60), np.full(60, -1))
    np.testing.assert_array_equal(turned_over(points, neighbours, 1e-3 / 3), found[0])
    assert not turned_over(points, neighbours, 10.0).any()  # noise may have made them all


def test_copies_of_places() -> None:
    rng = np.random.default_rng(3)
    camera = rng.uniform(-20, 20, (300, 2))
    projector = camera * 1.5
    camera[200:], projector[200:] = camera[:100] + rng.normal(0, 0.2, (100, 2)), projector[:100]
    projector[250:] += rng.normal(0, 1, (50, 2))  # of some the other picture says that they are none
    noise = rng.integers(1, 4, 300).astype(np.float64)
    noise[[3, 205]] = np.nan
    expected, reach = np.ones(300, dtype=np.bool_), 0.6
    for offset in ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5)):
        cells = [tuple(cell) for cell in np.floor(camera / (2 * reach) + offset)]
        for cell in set(cells):
            rows = [k for k in range(300) if expected[k] and cells[k] == cell]
            for k in rows:
                best = min(rows, key=lambda k: (np.isnan(noise[k]), noise[k], k))
                gaps = [np.linalg.norm(pixels[k] - pixels[best]) for pixels in (camera, projector)]
                expected[k] &= k == best or not max(gaps) < reach
    assert 30 < np.count_nonzero(~expected) < 90
    for kernel in BOTH:
        kept = np.ones(300, dtype=np.bool_)
        room = np.empty((300, 2)), np.empty(300, np.intc), np.empty(600, np.intc)
        kernel.drop_copies(camera, projector, noise, reach, *room, kept.view(np.uint8))
        np.testing.assert_array_equal(kept, expected)
