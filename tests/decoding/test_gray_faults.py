"""Every way in which a capture can be spoilt is named, in one line, by the picture."""

from __future__ import annotations

import numpy as np
import pytest

from retrue.decoding.decode import decode
from retrue.errors import CaptureError
from retrue.patterns.gray_code import GrayCode

PATTERN = GrayCode((128, 96))
NAMES = [f"shot_{number:02d}.png" for number in range(PATTERN.picture_count)]


def problem(pictures, names=NAMES, pattern=PATTERN):
    with pytest.raises(CaptureError) as caught:
        decode(pattern, pictures, names=names)
    message = str(caught.value)
    assert "\n" not in message
    return message


def without(items, index):
    return [*items[:index], *items[index + 1 :]]


def test_numbered_file_missing(pictures):
    message = problem(without(pictures, 7), without(NAMES, 7))
    assert "expected 30 pictures" in message
    assert "found 29" in message
    assert "number 7 is missing" in message


@pytest.mark.parametrize("index", [4, 7, 16, 27])
def test_missing_file_found_by_its_orphan(pictures, index):
    message = problem(without(pictures, index), NAMES[:-1])
    pair = index // 2
    what = f"column bit {pair}" if pair < 7 else f"row bit {pair - 7}"
    assert what in message
    assert "no counterpart" in message


def test_missing_black(pictures):
    assert "white or black is missing" in problem(pictures[:-1], NAMES[:-1])


def test_doubled_file(pictures):
    message = problem([*pictures[:8], *pictures[7:]], [*NAMES[:8], "again.png", *NAMES[8:]])
    assert "again.png shows the same as shot_07.png" in message


@pytest.mark.parametrize("index", [1, 5, 6, 13, 18, 27])
def test_late_frame_repeats_the_one_before(pictures, index):
    pictures[index] = pictures[index - 1]
    assert f"{NAMES[index]} shows the same as {NAMES[index - 1]}" in problem(pictures)


def test_black_frame(pictures):
    pictures[9] = pictures[-1]
    assert f"{NAMES[9]} is black" in problem(pictures)


def test_all_frames_black(pictures):
    assert "nothing is lit" in problem([pictures[-1]] * len(pictures))


def test_swapped_white_and_black(pictures):
    message = problem([*pictures[:-2], pictures[-1], pictures[-2]])
    assert "white and black are swapped" in message
    assert f"{NAMES[-2]} is darker than {NAMES[-1]}" in message


@pytest.mark.parametrize("pair", [1, 3, 6, 8, 13])
def test_swapped_pattern_and_inverse(pictures, pair):
    first = 2 * pair
    pictures[first], pictures[first + 1] = pictures[first + 1], pictures[first]
    assert f"swapped: {NAMES[first]} and {NAMES[first + 1]}" in problem(pictures)


def test_every_inverse_first(pictures):
    bits = [picture for pair in range(14) for picture in (pictures[2 * pair + 1], pictures[2 * pair])]
    assert "not in order" in problem([*bits, *pictures[-2:]])


def test_least_significant_bit_first(pictures):
    columns = [pictures[2 * bit + kind] for bit in reversed(range(7)) for kind in range(2)]
    assert "column pictures are not in order" in problem([*columns, *pictures[14:]])


def test_sizes_differ(pictures):
    pictures[3] = pictures[3][:-1]
    assert f"{NAMES[3]} is 240 x 179" in problem(pictures)


def test_depths_differ(pictures):
    pictures[3] = pictures[3].astype(np.uint16) * 257
    assert NAMES[3] in problem(pictures)


def test_projector_size_of_another_bit_count(pictures):
    message = problem(pictures, pattern=GrayCode((256, 96)))
    assert "found 30" in message
    assert "projector size" in message


@pytest.mark.parametrize(("size", "axis"), [((100, 96), "columns"), ((128, 70), "rows")])
def test_projector_size_that_the_codes_exceed(pictures, size, axis):
    message = problem(pictures, pattern=GrayCode(size))
    assert "codes exceed the projector" in message
    assert axis in message


def test_no_pictures():
    assert "found 0" in problem([], [])
