"""Sequences as other people's scanners record them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from retrue.decoding.decode import decode
from retrue.errors import CaptureError
from retrue.patterns.gray_code import GrayCode
from retrue.patterns.layouts import gray_frames, sine_frames
from retrue.patterns.sequence import Frame
from tests.decoding.test_sequences import CAMERA, SIZE, both, errors, oblique, shot_of

LIGHTS = [Frame("white"), Frame("black")]


def bits(axis, side, lowest=0):
    return gray_frames(axis, range(lowest, (side - 1).bit_length())[::-1], inverses=False)


def test_a_coarse_bit_on_its_head_is_named():
    shot = shot_of(both(lambda axis, side: bits(axis, side, 2)))
    pictures = [*shot.pictures]
    pictures[0] = pictures[0][::-1, ::-1]
    names = [f"b{k:02d}.png" for k in range(len(pictures))]
    with pytest.raises(CaptureError, match=r"b00\.png stands on its head"):
        decode(shot.pattern, pictures, names=names)


@pytest.mark.parametrize(("turned", "inverses"), [(9, True), (3, False), (8, False)])
def test_a_picture_on_its_head_is_named(turned, inverses):
    shot = shot_of([*LIGHTS, *both(lambda axis, side: gray_frames(axis, range(3, 9)[::-1], inverses=inverses))])
    pictures = [own[::-1, ::-1] if k == turned else own for k, own in enumerate(shot.pictures)]
    names = [f"b{k:02d}.png" for k in range(len(pictures))]
    with pytest.raises(CaptureError, match=rf"b{turned:02d}\.png stands on its head"):
        decode(shot.pattern, pictures, names=names)


def test_a_picture_that_is_bright_wherever_light_falls_may_stand_on_its_head():
    """Only where the light ends does it differ from what it should show."""
    frames = both(lambda axis, side: gray_frames(axis, range(10)[::-1], inverses=True))  # of 512 columns: bit 9 is dark
    shot = shot_of(frames, mapping=lambda x, y: oblique(x - 40.0, y - 20.0))
    pictures = [own[::-1, ::-1] if k == 1 else own for k, own in enumerate(shot.pictures)]
    names = [f"b{k:02d}.png" for k in range(len(pictures))]
    with pytest.raises(CaptureError, match=r"b01\.png stands on its head"):
        decode(shot.pattern, pictures, names=names)


@pytest.mark.parametrize("turned", [10, 14, 34])
def test_what_is_no_pair_is_not_read(turned):
    """Of whole codes, too, half of whose points would be left."""
    pairs = both(lambda axis, side: gray_frames(axis, range((side - 1).bit_length())[::-1], inverses=True))
    shot = shot_of([*pairs, *LIGHTS])
    pictures = [own[::-1, ::-1] if k == turned else own for k, own in enumerate(shot.pictures)]
    names = [f"b{k:02d}.png" for k in range(len(pictures))]
    with pytest.raises(CaptureError, match=rf"b{turned:02d}\.png"):
        decode(shot.pattern, pictures, names=names)


@pytest.mark.parametrize("code", [GrayCode(SIZE), None])
@pytest.mark.parametrize("scale", [2.4, 3.3])
def test_stripes_narrower_than_a_pixel_are_left_to_wider_ones(code, scale):
    """A projector of more pixels than the camera has: next to each other these see stripes two or three apart."""
    pairs = both(lambda axis, side: gray_frames(axis, range((side - 1).bit_length())[::-1], inverses=True))
    shot = shot_of([*pairs, *LIGHTS], lambda x, y: (scale * x + 3, scale * y + 0.03 * x + 2))
    points = decode(code or shot.pattern, shot.pictures)
    assert len(points) > 0.9 * SIZE[0] * SIZE[1] / scale**2
    assert np.abs(errors(shot, points)).max() < 2
    assert points.card.details["points_by_bits_left_out"][0] == 0


def stepped(x, y):
    """Two surfaces, little apart along the rows of the projector."""
    near = x > 0.4 * CAMERA[0]
    return 1.1 * x + 8 + 40 * near, 1.1 * y + 6 + 3 * near


def test_coarse_stripes_do_not_bridge_a_step():
    shot = shot_of([*LIGHTS, *bits("column", SIZE[0]), *bits("row", SIZE[1], 2)], stepped)
    pictures = [
        np.roll(own[::-1, ::-1], 1, 1) if frame.axis == "column" and frame.bit == 0 else own
        for frame, own in zip(shot.pattern.frames, shot.pictures, strict=True)
    ]
    points = decode(shot.pattern, pictures)
    off = np.abs(errors(shot, points)[:, 1])
    assert len(points) > 0.5 * pictures[0].size
    assert np.mean(off > 1) < 0.01


@pytest.mark.parametrize(("height", "width"), [(6, 25), (8, 20), (15, 40)])
def test_wide_stripes_are_not_read_across_a_bump(height, width):
    """A quarter of a stripe is two of the projector's pixels where it is eight wide: so far off points were read."""

    def bumped(x, y):
        bump = height * np.exp(-((x - 210) ** 2 + (y - 160) ** 2) / (2 * width**2))
        return 20 + 0.55 * x + bump, 15 + 0.55 * y + 0.6 * bump

    shot = shot_of([*LIGHTS, *both(lambda axis, side: bits(axis, side, 3))], bumped)
    points = decode(shot.pattern, shot.pictures)
    assert len(points) > 0.85 * CAMERA[0] * CAMERA[1]
    assert np.abs(errors(shot, points)).max() < 0.75


def test_a_cue_that_is_no_whole_number_of_periods():
    shot = shot_of(both(lambda axis, side: [*sine_frames(axis, 20.0, 4), *sine_frames(axis, float(side), 4)]))
    points = decode(shot.pattern, shot.pictures)
    assert len(points) > 0.8 * CAMERA[0] * CAMERA[1]
    assert np.abs(errors(shot, points)).max() < 4


def through_a_curve(pictures):
    """Blurred, and then as a camera that shows the dark brighter."""
    blurred = [cv2.GaussianBlur(own, (0, 0), 1.5) for own in pictures]
    return [np.rint(255 * (own / 255) ** 0.45).astype(np.uint8) for own in blurred]


def test_a_camera_s_curve_is_no_noise():
    frames = both(lambda axis, side: gray_frames(axis, range(9)[::-1], inverses=True))
    shot = shot_of([*LIGHTS, *frames], noise=0.0)
    points = decode(shot.pattern, through_a_curve(shot.pictures))
    assert len(points) > 0.3 * CAMERA[0] * CAMERA[1]
    assert np.mean(np.abs(errors(shot, points)).max(axis=1) > 4) < 1e-3


def test_stripes_as_wide_as_a_period_tell_its_turn_through_a_camera_s_curve():
    frames = both(lambda axis, side: [*bits(axis, side, 4), *sine_frames(axis, 16.0, 8)])
    shot = shot_of([*LIGHTS, *frames], noise=0.0)
    points = decode(shot.pattern, through_a_curve(shot.pictures))
    assert len(points) > 0.9 * CAMERA[0] * CAMERA[1]
    assert np.mean(np.abs(errors(shot, points)).max(axis=1) > 4) < 1e-3


@pytest.mark.parametrize("depth", [10, 12, 14])
def test_pictures_of_a_sensor_with_fewer_bits_than_their_files(depth):
    shot = shot_of(both(lambda axis, side: [*sine_frames(axis, 16.0, 4), *bits(axis, side, 3)]))
    deep = [np.minimum(own.astype(np.uint16) * 257 >> (16 - depth), (1 << depth) - 1) for own in shot.pictures]
    ours, theirs = (decode(shot.pattern, pictures) for pictures in (shot.pictures, deep))
    assert abs(len(theirs) - len(ours)) < 0.01 * len(ours)
    assert np.median(np.abs(errors(shot, theirs))) < 0.1
    assert theirs.colors.max() > 150


def test_the_end_of_the_scale_of_twelve_bits_is_known():
    shot = shot_of([*sine_frames("column", 16.0, 3), *sine_frames("column", float(SIZE[0]), 3)])
    bright = [np.minimum(own.astype(np.uint16) * 23, 4095) for own in shot.pictures]
    eight = [(own >> 4).astype(np.uint8) for own in bright]
    points, theirs = decode(shot.pattern, eight), decode(shot.pattern, bright)
    assert points.card.rejected["saturated"] > 0.05 * bright[0].size
    assert theirs.card.rejected["saturated"] == pytest.approx(points.card.rejected["saturated"], rel=0.2)
    assert np.abs(errors(shot, theirs))[:, 0].max() < 4
