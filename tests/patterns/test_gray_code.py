"""The Gray-code pattern against the definition."""

from __future__ import annotations

import numpy as np
import pytest

from retrue.errors import InputError
from retrue.patterns.gray_code import GrayCode


def read_back(pictures, bits):
    code = np.zeros(pictures[0].shape, int)
    bit = np.zeros(pictures[0].shape, int)
    for index in range(bits):
        bit ^= pictures[2 * index] > pictures[2 * index + 1]
        code = 2 * code + bit
    return code


@pytest.mark.parametrize(
    ("size", "step", "offset"), [((37, 20), 1, (0, 0)), ((64, 48), 5, (0, 0)), ((40, 24), 1, (12, 4))]
)
def test_pictures_spell_the_stripe_numbers(size, step, offset):
    pattern = GrayCode(size, step, offset)
    pictures = pattern.render()
    assert len(pictures) == pattern.picture_count == len(pattern.names)
    y, x = np.mgrid[: size[1], : size[0]]
    columns = read_back(pictures, pattern.bits[0])
    rows = read_back(pictures[2 * pattern.bits[0] :], pattern.bits[1])
    assert np.array_equal(columns, x // step + offset[0])
    assert np.array_equal(rows, y // step + offset[1])


def test_order_of_the_contract():
    pictures = GrayCode((8, 4)).render()
    assert pictures[0][0].tolist() == [0, 0, 0, 0, 255, 255, 255, 255]
    assert pictures[4][0].tolist() == [0, 255, 255, 0, 0, 255, 255, 0]
    assert all(np.array_equal(pictures[2 * pair], 255 - pictures[2 * pair + 1]) for pair in range(6))
    assert pictures[-2].min() == 255
    assert pictures[-1].max() == 0
    assert GrayCode((8, 4)).names[:3] == ["column bit 0 pattern", "column bit 0 inverse", "column bit 1 pattern"]


def test_bits_are_only_as_many_as_needed():
    assert GrayCode((1024, 768)).bits == (10, 10)
    assert GrayCode((1025, 512)).bits == (11, 9)
    assert GrayCode((1280, 800), step=4).bits == (9, 8)
    assert GrayCode((768, 768), offset=(128, 128)).bits == (10, 10)


@pytest.mark.parametrize(
    ("size", "step", "offset"),
    [
        ((0, 4), 1, (0, 0)),
        ((8, 20000), 1, (0, 0)),
        ((8, 4), 0, (0, 0)),
        ((8, 4), 5, (0, 0)),
        ((8, 4), 1, (-1, 0)),
        ((16384, 4), 1, (1, 0)),
    ],
)
def test_impossible_specs_are_refused(size, step, offset):
    with pytest.raises(InputError):
        GrayCode(size, step, offset)
