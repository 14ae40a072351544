"""Stripes of a Gray code say the same compiled and as Python, and what their formulas say in NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from retrue.kernels import pixels, stripes
from tests.kernels.plain import plain


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("along", [0, 1])
def test_bits_are_read_in_the_runs_only(dtype: type[np.unsignedinteger], along: int) -> None:
    rng = np.random.default_rng(along)
    shape, top = (7, 40), np.iinfo(dtype).max
    pairs = rng.integers(0, top, (5, 2, *shape), endpoint=True).astype(dtype)
    wanted = np.zeros(shape, np.uint8)
    wanted[1:6, 3:30] = 1
    wanted[3, 35] = 1
    runs = np.empty((shape[0] * 20, 3), np.int32)
    runs = runs[: pixels.spans(wanted, 2, runs)]
    assert runs[runs[:, 0] == 3].tolist() == [[3, 3, 30], [3, 35, 36]]

    margin = np.abs(pairs[:, 0].astype(int) - pairs[:, 1])
    one = (pairs[:, 0] > pairs[:, 1]).astype(int)
    number = sum((one[: k + 1].sum(axis=0) & 1) << (4 - k) for k in range(5))
    there = np.roll(one, -1, axis=along + 1), np.roll(margin, -1, axis=along + 1)
    changes = one != there[0]
    ordered = np.sort(margin, axis=0)
    expected = (number, ordered[0], ordered[1], (margin * changes).max(axis=0), (there[1] * changes).max(axis=0))
    looked = wanted.view(bool).copy()
    looked[-1 if along == 0 else slice(None), -1 if along == 1 else slice(None)] = False

    found = []
    for kernel in (stripes, plain("stripes")):
        code, near, far = np.zeros(shape, np.int16), np.zeros(shape, dtype), np.zeros(shape, dtype)
        first, second, room = np.full(shape, top), np.full(shape, top), np.empty((4, 513), dtype)
        first, second = first.astype(dtype), second.astype(dtype)
        with np.errstate(over="ignore"):
            for pattern, inverse in pairs:
                kernel.add_bit(pattern, inverse, runs, along, room, code, first, second, near, far)
        found.append((code, first, second, near, far))
    for compiled, python, truth in zip(*found, expected, strict=True):
        np.testing.assert_array_equal(compiled, python)
        np.testing.assert_array_equal(compiled[looked], truth[looked])
        assert not compiled[0].any() or (compiled[0] == top).all()


def test_an_edge_is_where_the_margins_balance() -> None:
    contrast, noise = np.full((1, 5), 200.0, np.float32), np.full((1, 5), 2.0, np.float32)
    place, seen = np.empty(5, np.int32), np.empty((3, 5), np.float32)
    near, far = np.array([[0, 30, 0, 0, 0]], np.uint8), np.array([[0, 90, 0, 0, 0]], np.uint8)

    bias, spacing = np.zeros((3, 4, 2), np.float32), np.full((1, 5), 0.75, np.float32)

    def found(first: int) -> int:
        code = np.array([[first, first, first + 1, first + 1, first + 3]], np.int16)
        good = np.ones((1, 5), np.uint8)
        how = 0.05, 0.3, spacing, bias, 2.0, (0.0, 0.0)
        return stripes.find_edges(code, near, far, contrast, noise, good, (0, 1), 1, *how, place, seen)

    assert (found(4), place[0]) == (1, 1)
    np.testing.assert_allclose(seen[:, 0], [36 / (36 + 4), 0.25, 4.5], rtol=1e-6)
    bias[:, 1], bias[:, 2] = [[0.3, 0.1], [0.1, 0.0], [0.0, 0.0]], [[0.5, 0.3], [0.3, 0.0], [0.2, 0.0]]
    for first, c in ((4, 0.4 + 0.2 * 0.25), (5, 0.2), (7, 0.1)):  # where bit 0 changes, bit 1, and bit 3
        assert found(first) == 1
        assert seen[1, 0] == pytest.approx(0.25 - c * 0.25 * 0.75 * 0.5, rel=1e-6)
    contrast[0, 3] = 100  # light leaks there, one pixel from the edge
    assert found(4) == 0


@pytest.mark.parametrize("along", [0, 1])
def test_moments_are_means_over_cells(along: int) -> None:
    rng = np.random.default_rng(3)
    place = np.sort(rng.choice(8 * 12, 40, replace=False)).astype(np.int32)
    seen = rng.random((3, 40)).astype(np.float32)
    sums, room = np.zeros((9, 2, 3), np.float32), np.zeros((3, 9), np.float32)
    stripes.moments(place, seen, 12, 4, along, 0, room, sums)
    y, x = np.divmod(place, 12)
    a, b = (x % 4 - 1.5, y % 4 - 1.5) if along == 1 else (y % 4 - 1.5, x % 4 - 1.5)
    w, a, v = seen[0], seen[1] + a, seen[2]
    each = [w, w * a, w * a * a, w * b, w * b * b, w * a * b, w * v, w * v * a, w * v * b]
    expected = np.zeros((9, 2, 3))
    for own, total in zip(each, expected, strict=True):
        np.add.at(total, (y // 4, x // 4), own / 16)
    np.testing.assert_allclose(sums, expected, rtol=1e-5, atol=1e-6)
    assert not room.any()


def test_places_of_points() -> None:
    found = np.empty(3, np.intp), np.empty((3, 2), np.int64), np.empty((3, 2))
    pixels.places(np.array([0, 9, 23]), 10, 5, *found)
    assert found[0].tolist() == [50, 59, 73]
    assert found[1].tolist() == [[5, 0], [5, 9], [7, 3]]
    assert found[2].tolist() == [[0, 5], [9, 5], [3, 7]]
