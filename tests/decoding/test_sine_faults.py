"""Sequences of sines in another order, backwards, late or with a share of the picture before: read, or named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest

from retrue.correspondences import Correspondences
from retrue.decoding.decode import decode
from retrue.decoding.sequence.hypotheses import take_sample
from retrue.decoding.sequence.sine_gains import fit_sine_gains
from retrue.errors import CaptureError
from retrue.geometry.arrays import FloatArray, Image
from retrue.patterns.sequence import Frame, FrameSequence

SIZE, CAMERA = (96, 72), (200, 150)


def sines(axis: int, periods: tuple[int, ...] = (8, 1)) -> list[Frame]:
    name = ("column", "row")[axis]
    return [Frame("phase", name, period_px=SIZE[axis] / p, shift=k / 4) for p in periods for k in range(4)]


FRAMES = [sines(0), sines(1)]
PATTERN = FrameSequence(SIZE, tuple(FRAMES[0] + FRAMES[1]))


def seen(frames: list[Frame]) -> list[Image]:
    """As a camera sees them, twice as large and a little turned."""
    rng = np.random.default_rng(4)
    turn = np.array([[1.9, 0.1, 6.0], [-0.1, 1.9, 12.0]])
    shown = FrameSequence(SIZE, tuple(frames)).render()
    lit = [8 + 0.7 * cv2.warpAffine(picture.astype(np.float32), turn, CAMERA) for picture in shown]
    return [np.clip(np.rint(picture + rng.normal(0, 0.8, picture.shape)), 0, 255).astype(np.uint8) for picture in lit]


def true_px(points: Correspondences) -> FloatArray:
    turn = np.linalg.inv(np.array([[1.9, 0.1], [-0.1, 1.9]]))
    return np.asarray((points.camera_px - [6.0, 12.0]) @ turn.T)


def error(points: Correspondences) -> float:
    """The largest inside: at the border a pixel sees the end of the picture, too."""
    return float(np.nanpercentile(np.abs(points.projector_px - true_px(points)), 95))


def backwards(frames: list[Frame], period: float) -> list[Frame]:
    return [replace(f, shift=-f.shift) if f.period_px == period and f.shift is not None else f for f in frames]


@pytest.mark.parametrize(
    ("frames", "said"),
    [
        (FRAMES[1] + FRAMES[0], "row pictures come before"),
        (sines(0, (1, 8)) + sines(1, (1, 8)), "coarse sines come before"),
        (backwards(backwards(FRAMES[0] + FRAMES[1], 96), 72), "shifts of the coarsest sines run the other way"),
    ],
)
def test_another_order_is_read_and_said(frames: list[Frame], said: str) -> None:
    points = decode(PATTERN, seen(frames))
    assert points.card is not None
    assert said in points.card.advice[0]
    assert len(points) > 10_000
    assert error(points) < 0.5


@pytest.mark.parametrize("turned", [lambda p: p[:, ::-1], lambda p: p[::-1], np.rot90])
def test_orders_of_which_none_stands_upright_are_named_not_chosen(turned: Callable[[Image], Image]) -> None:
    """Coarse shifts backwards and mirrored sideways, fine ones and mirrored upwards: these pictures are the same."""
    frames = backwards(backwards(FRAMES[0] + FRAMES[1], 96), 72)
    with pytest.raises(CaptureError, match=r"finer sines.*, or .*coarsest sines.* fit either"):
        decode(PATTERN, [turned(picture) for picture in seen(frames)])


def test_of_columns_alone_a_camera_on_its_side_does_not_tell_which_way_up() -> None:
    pictures = seen(backwards(FRAMES[0], 96))
    assert error(decode(FrameSequence(SIZE, tuple(FRAMES[0])), pictures)) < 0.5
    with pytest.raises(CaptureError, match="lies on its side"):
        decode(FrameSequence(SIZE, tuple(FRAMES[0])), [np.rot90(picture) for picture in pictures])


def test_a_coarse_sine_at_the_end_of_its_scale_tells_no_turn() -> None:
    """One of its pictures twice as bright: where white paint is at 255, its phase is another, and so is the turn."""
    three = tuple(replace(f, shift=k % 4 / 3) for k, f in enumerate(FRAMES[0] + FRAMES[1]) if k % 4 < 3)
    paint = np.where(np.arange(CAMERA[0]) % 40 < 10, 1.0, 0.4)
    light = [picture * paint for picture in seen(list(three))]
    light[5] *= 2
    pictures = [np.clip(np.rint(picture), 0, 255).astype(np.uint8) for picture in light]
    points = decode(FrameSequence(SIZE, three), pictures)
    assert points.card is not None
    assert points.card.rejected["saturated"] > 500
    off = np.abs(points.projector_px - true_px(points)).max(axis=1)
    assert np.count_nonzero(off > 3) < 1e-3 * len(points)


def test_what_is_as_expected_is_read_without_a_word() -> None:
    points = decode(PATTERN, seen(FRAMES[0] + FRAMES[1]))
    assert points.card is not None
    assert not any("read all the same" in line for line in points.card.advice)
    assert error(points) < 0.5


def test_a_share_of_the_picture_before_is_taken_out() -> None:
    pictures = [picture.astype(float) for picture in seen(FRAMES[0] + FRAMES[1])]
    mixed = [pictures[0], *(0.75 * now + 0.25 * before for before, now in pairwise(pictures))]
    points = decode(PATTERN, [np.rint(picture).astype(np.uint8) for picture in mixed])
    assert points.card is not None
    assert "25 % of the one before" in points.card.advice[0]
    assert error(points) < 0.5


@pytest.mark.parametrize("rows_first", [False, True])
def test_automatic_exposure_is_taken_out(rows_first: bool) -> None:
    gains = np.random.default_rng(5).uniform(0.5, 1.3, 16)
    pictures = seen(FRAMES[1] + FRAMES[0] if rows_first else FRAMES[0] + FRAMES[1])
    points = decode(PATTERN, [np.rint(gain * own).astype(np.uint8) for gain, own in zip(gains, pictures, strict=True)])
    assert points.card is not None
    assert ("row pictures" in points.card.advice[0]) == rows_first
    assert "brightness changes" in points.card.advice[0]
    assert points.card.details["gain_spread"] == pytest.approx(gains.max() / gains.min(), rel=0.02)
    assert error(points) < 0.5


def test_gains_that_one_sine_of_three_shifts_cannot_tell_are_ones() -> None:
    spec = FrameSequence(SIZE, tuple(Frame("phase", "column", period_px=96.0, shift=k / 3) for k in range(3)))
    sample = take_sample(seen(list(spec.frames)), np.random.default_rng(0))
    assert sample is not None
    gains = fit_sine_gains(sample, spec, np.zeros(sample.here.shape[1], bool))
    assert gains.tolist() == [1.0, 1.0, 1.0]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda pictures: [np.full_like(pictures[0], 3)] * 2 + pictures[:-2], "the camera is late by 2"),
        (lambda pictures: [*pictures[:3], pictures[2], *pictures[4:]], "picture 3 and picture 4 show the same"),
        (lambda pictures: seen(sines(0, (10, 1)) + sines(1, (10, 1))), "10 periods in one"),
        (lambda pictures: pictures[:5] + pictures[6:], "expected 16 pictures"),
    ],
)
def test_what_cannot_be_read_is_named(change, said: str) -> None:
    with pytest.raises(CaptureError, match=said):
        decode(PATTERN, change(seen(FRAMES[0] + FRAMES[1])))


@pytest.mark.parametrize("shifts", [4, 5])
def test_a_picture_that_shows_something_else_is_left_out_or_named(shifts: int) -> None:
    """Another one, or nothing at all: the others of its sine tell which; of four shifts it may be its opposite."""
    spec = FrameSequence(
        SIZE,
        tuple(
            Frame("phase", name, period_px=side / periods, shift=k / shifts)
            for name, side in zip(("column", "row"), SIZE, strict=True)
            for periods in (8, 1)
            for k in range(shifts)
        ),
    )
    good = seen(list(spec.frames))
    for odd in (good[shifts + 2], np.full_like(good[1], 90)):
        pictures = [good[0], odd, *good[2:]]
        if shifts == 4:
            with pytest.raises(CaptureError, match="one of picture 2, picture 4 shows something else"):
                decode(spec, pictures)
            continue
        points = decode(spec, pictures)
        assert points.card is not None
        assert points.card.advice[0].startswith("read all the same: picture 2 shows something else")
        assert error(points) < 0.5


@pytest.mark.parametrize("shifts", [3, 4])
def test_a_picture_on_its_head_is_named_where_it_is_not_the_only_odd_one(shifts: int) -> None:
    """Of three shifts each explains what any does; of four, one that is turned shows what its opposite does."""
    frames = [replace(f, shift=k % 4 / shifts) for own in FRAMES for k, f in enumerate(own) if k % 4 < shifts]
    pictures = seen(frames)
    pictures[1] = pictures[1][::-1, ::-1]
    with pytest.raises(CaptureError, match="picture 2 stands on its head"):
        decode(FrameSequence(SIZE, tuple(frames)), pictures)


def test_backwards_shifts_leave_no_pixel_a_whole_turn_off() -> None:
    spec = FrameSequence(SIZE, tuple(sines(0) + sines(1)))
    run = [replace(f, shift=-f.shift) if f.shift else f for f in spec.frames]
    points = decode(spec, seen(run))
    assert "on its head" in points.card.advice[0]
    turn = np.linalg.inv(np.array([[1.9, 0.1], [-0.1, 1.9]]))
    off = np.array(SIZE) - (points.camera_px - [6.0, 12.0]) @ turn.T - points.projector_px
    assert np.abs(off).max() < 2


def test_a_pixel_that_sees_the_end_of_the_picture_is_no_point() -> None:
    turn = np.array([[1.9, 0.1, 6.0], [-0.1, 1.9, 12.0]])
    shown = [cv2.warpAffine(picture.astype(np.float32), turn, CAMERA) for picture in PATTERN.render()]
    blurred = [8 + 0.7 * cv2.GaussianBlur(picture, (0, 0), 1.5) for picture in shown]
    points = decode(PATTERN, [np.rint(picture).astype(np.uint8) for picture in blurred])
    off = points.projector_px - (points.camera_px - [6.0, 12.0]) @ np.linalg.inv(turn[:, :2]).T
    assert len(points) > 0.93 * np.prod(SIZE) * 1.9**2
    assert np.abs(off).max() < 0.4
    assert np.sqrt(np.mean(off**2)) < 0.05
