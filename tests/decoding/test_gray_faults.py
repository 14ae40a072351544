"""Every way in which a capture can be spoilt is named, in one line, by the picture."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from retrue.decoding.decode import decode
from retrue.errors import CaptureError
from retrue.files.captures import read_capture
from retrue.files.patterns import read_pattern
from retrue.patterns.gray_code import GrayCode
from retrue.patterns.layouts import layout_sequence

FAULTS = Path(__file__).parents[3] / "shared" / "data" / "faults"
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


def test_a_picture_of_stripes_in_the_place_of_black_is_named(pictures):
    """One is missing, another came twice: it was read without a black, or white and black were said to be swapped."""
    said = f"{{}} shows the same as {NAMES[5]}, where white or black is expected"
    assert said.format(NAMES[-1]) in problem([*pictures[:-1], pictures[5]])
    lights_first = [pictures[-2], pictures[3], *pictures[:-2]]
    pattern = layout_sequence("3dunderworld", PATTERN.projector_size)
    assert said.format(NAMES[1]) in problem(lights_first, NAMES, pattern)


@pytest.mark.parametrize("first", [False, True])
def test_stripes_in_the_place_of_white_are_left_out(pictures, plain_shot, first):
    """Pictures that are read without it were said to be late, white and black at the other end."""
    pattern = layout_sequence("3dunderworld" if first else "opencv", PATTERN.projector_size)
    lights, bits = [pictures[5], pictures[-1]], pictures[:-2]
    points = decode(pattern, [*lights, *bits] if first else [*bits, *lights], names=NAMES)
    assert np.abs(points.projector_px - plain_shot.truth(points.camera_px)).max() < 1
    assert points.card.details["read_all_the_same"] == ["white or black is missing, and another picture in its place"]


def test_swapped_white_and_black(plain_shot, pictures):
    said = read_all_the_same(plain_shot, [*pictures[:-2], pictures[-1], pictures[-2]])
    assert "white and black are exchanged" in said


@pytest.mark.parametrize("pair", [1, 3, 6, 8, 13])
def test_swapped_pattern_and_inverse(pictures, pair):
    first = 2 * pair
    pictures[first], pictures[first + 1] = pictures[first + 1], pictures[first]
    assert f"swapped: {NAMES[first]} and {NAMES[first + 1]}" in problem(pictures)


def test_every_inverse_first(plain_shot, pictures):
    bits = [picture for pair in range(14) for picture in (pictures[2 * pair + 1], pictures[2 * pair])]
    assert "inverses come before patterns" in read_all_the_same(plain_shot, [*bits, *pictures[-2:]])


def test_rows_first(plain_shot, pictures):
    said = read_all_the_same(plain_shot, [*pictures[14:28], *pictures[:14], *pictures[28:]])
    assert "row pictures come before the column pictures" in said


def test_least_significant_bits_first(plain_shot, pictures):
    axes = [[pictures[first + 2 * bit + kind] for bit in reversed(range(7)) for kind in range(2)] for first in (0, 14)]
    said = read_all_the_same(plain_shot, [*axes[0], *axes[1], *pictures[-2:]])
    assert "least significant bits come first" in said


@pytest.mark.parametrize("late", [1, 2, 3])
def test_a_camera_that_is_late(plain_shot, pictures, late):
    said = read_all_the_same(plain_shot, [*[pictures[-1]] * late, *pictures[:-late]])
    assert f"late by {late}" in said


@pytest.mark.parametrize("share", [0.15, 0.3])
def test_a_share_of_the_picture_before(plain_shot, pictures, share):
    mixed = [pictures[0]]
    for before, picture in pairwise(pictures):
        mixed.append(np.rint(share * before + (1 - share) * picture.astype(float)).astype(np.uint8))
    assert f"holds {100 * share:.0f} % of the one before it" in read_all_the_same(plain_shot, mixed)


def test_automatic_exposure(plain_shot, pictures):
    exposed = [
        np.clip(np.rint(picture * min(60 / max(picture[:, :100].mean(), 1), 4.0)), 0, 255).astype(np.uint8)
        for picture in pictures
    ]
    assert "switch automatic exposure off" in read_all_the_same(plain_shot, exposed)


def test_a_late_camera_and_rows_first_and_automatic_exposure(plain_shot, pictures):
    order = [*pictures[14:28], *pictures[:14], *pictures[28:]]
    order = [pictures[-1], *order[:-1]]
    exposed = [np.rint(picture * (0.7 + 0.3 * (k % 5) / 4)).astype(np.uint8) for k, picture in enumerate(order)]
    said = read_all_the_same(plain_shot, exposed)
    assert "row pictures" in said
    assert "late by 1" in said
    assert "brightness changes" in said


def test_a_mirrored_projection_is_told(plain_shot, pictures):
    points = decode(PATTERN, [picture[:, ::-1] for picture in pictures])
    assert points.card.details["mirrored"]
    assert "mirrored" in points.card.advice[0]
    assert "mirrored" not in decode(PATTERN, pictures).card.details


def read_all_the_same(shot, pictures):
    """What the card says of a capture that is read, rightly."""
    points = decode(PATTERN, pictures, names=NAMES[: len(pictures)])
    off = points.projector_px - shot.truth(points.camera_px)
    assert len(points) > 0.85 * 240 * 180
    assert np.abs(off).max() < 1
    assert points.card.advice[0].startswith("read all the same: ")
    assert points.card.details["read_all_the_same"]
    return points.card.advice[0]


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


@pytest.mark.skipif(not FAULTS.is_dir(), reason="shared/data/faults is absent")
@pytest.mark.parametrize(
    ("folder", "cause"),
    [
        ("gray-agc_left", "switch automatic exposure off"),
        ("gray-agc_mid", "switch automatic exposure off"),
        ("gray-ghost30", "holds 30 % of the one before it"),
        ("gray-rowsfirst", "the row pictures come before the column pictures"),
    ],
)
def test_captures_as_people_hand_them_in(folder: str, cause: str):
    pattern = read_pattern(FAULTS / folder / "pattern.json")
    points = read_capture(FAULTS / folder / "capture", pattern)
    assert len(points) > 1000
    assert points.card is not None
    assert any(cause in line for line in points.card.advice)


def test_a_late_camera_with_white_and_black_exchanged_is_read(pictures):
    """One of the two is lost then, and the other is told by the brightest that its pixels have seen."""
    *bits, white, black = pictures
    taken = [np.zeros_like(white), *bits, black]
    points = decode(PATTERN, taken)
    assert len(points) > 0.8 * 240 * 180
    assert "late by 1" in points.card.advice[0]
    assert "exchanged" in points.card.advice[0]


@pytest.mark.parametrize("lights", [True, False])
def test_pictures_in_reversed_order(plain_shot, pictures, lights):
    """White and black, in their place, were said to be late by two."""
    backwards = pictures[::-1] if lights else pictures[-3::-1]
    assert "the pictures are in reversed order" in read_all_the_same(plain_shot, backwards)


def test_reversed_order_of_rows_first_and_of_a_late_camera(plain_shot, pictures):
    rows_first = [*pictures[14:28], *pictures[:14], *pictures[28:]]
    for spoilt, cause in (
        (rows_first[::-1], "row pictures come before"),
        ([pictures[0], *pictures[:0:-1]], "late by 1"),
    ):
        said = read_all_the_same(plain_shot, spoilt)
        assert "reversed order" in said
        assert cause in said
