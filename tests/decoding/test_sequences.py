"""Sequences of other roles and orders than the Gray code's: what is missing, sines, one axis, depth by pixel."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from retrue.decoding.decode import decode
from retrue.decoding.sequence.decode_sequence import HARDLY_ANY
from retrue.decoding.sequence.diagnosis import shows_another_code
from retrue.errors import CaptureError
from retrue.patterns.gray_code import GrayCode
from retrue.patterns.layouts import gray_frames, layout_sequence, sine_frames
from retrue.patterns.sequence import Frame, FrameSequence
from tests.decoding.conftest import Shot, shoot

SIZE = (512, 384)
CAMERA = (420, 320)


def oblique(x, y):
    """A plane at about a projector pixel a camera pixel."""
    z = 1 + 1e-4 * x + 1e-4 * y
    return (8.2 + 1.13 * x + 0.05 * y) / z, (6.7 - 0.04 * x + 1.09 * y) / z


def shot_of(frames, mapping=oblique, albedo=0.8, noise=1.0, gamma=1.0, seed=1):
    """Each pixel sees the frame's own brightness at its centre: sines without the steps of a projector's pixels."""
    rng = np.random.default_rng(seed)
    pattern = FrameSequence(SIZE, tuple(frames))
    x, y = np.meshgrid(np.arange(float(CAMERA[0])), np.arange(float(CAMERA[1])))
    where = mapping(x, y)
    lit = np.logical_and.reduce([(w >= -0.5) & (w < side - 0.5) for w, side in zip(where, SIZE, strict=True)])
    pictures = []
    for frame in pattern.frames:
        light = frame.brightness(where[frame.axis == "row"] + (0.5 if frame.code == "gray" else 0.0))
        seen = 230 * (albedo * (0.02 + 0.95 * light * lit)) ** gamma
        pictures.append(np.clip(np.rint(seen + rng.normal(0, noise, seen.shape)), 0, 255).astype(np.uint8))
    return Shot(pattern, pictures, mapping)


def seen_through(blur_px, albedo, frames, noise=1.0, seed=1):
    """As `shot_of`, of paint (h, w), by a camera that blurs."""
    rng = np.random.default_rng(seed)
    sharp = shot_of(frames, albedo=1.0, noise=0.0)
    pictures = []
    for picture in sharp.pictures:
        light = cv2.GaussianBlur(picture * albedo, (0, 0), blur_px)
        pictures.append(np.clip(np.rint(light + rng.normal(0, noise, light.shape)), 0, 255).astype(np.uint8))
    return Shot(sharp.pattern, pictures, sharp.mapping)


def both(frames_of):
    return [*frames_of("column", SIZE[0]), *frames_of("row", SIZE[1])]


CODES = {
    "cue": lambda axis, side: [*sine_frames(axis, side / 16, 4), *sine_frames(axis, float(side), 3)],
    "coprime": lambda axis, side: [*sine_frames(axis, 25.0, 4), *sine_frames(axis, 27.0, 4)],
    "three periods": lambda axis, side: [f for p in (21.0, 22.0, 23.3) for f in sine_frames(axis, p, 4)],
    "gray": lambda axis, side: [*sine_frames(axis, 16.0, 4), *gray_frames(axis, range(3, 9)[::-1], inverses=True)],
    "wide gray": lambda axis, side: [*sine_frames(axis, 16.0, 4), *gray_frames(axis, range(4, 9)[::-1], inverses=True)],
}


def errors(shot, points):
    return points.projector_px - shot.truth(points.camera_px)


@pytest.mark.parametrize("code", CODES)
def test_sines_are_unwrapped_and_their_noise_is_known(code):
    shot = shot_of(both(CODES[code]), noise=1.5)
    points = decode(shot.pattern, shot.pictures)
    off = errors(shot, points)
    assert len(points) > 0.8 * CAMERA[0] * CAMERA[1]
    assert np.abs(off).max() < 4  # no wrong turn
    relative = np.abs(off) / points.projector_sigma_px[:, None]
    assert np.mean(relative < 1) == pytest.approx(0.683, abs=0.02)
    assert np.mean(relative < 2) == pytest.approx(0.954, abs=0.02)
    assert np.mean(relative < 3) == pytest.approx(0.997, abs=0.01)


@pytest.mark.parametrize("code", ["cue", "coprime", "gray"])
def test_the_ripple_of_gamma_is_taken_out(code):
    shot = shot_of(both(CODES[code]), gamma=0.6)
    points = decode(shot.pattern, shot.pictures)
    assert len(points) > 0.95 * CAMERA[0] * CAMERA[1]
    rms, sigma = (np.sqrt(np.mean(v**2)) for v in (errors(shot, points), points.projector_sigma_px))
    assert rms < 1.35 * sigma


def test_light_of_sines_is_their_modulation():
    albedo = np.broadcast_to(np.linspace(0.2, 0.9, CAMERA[0]), CAMERA[::-1])
    shot = shot_of(both(CODES["cue"]), albedo=albedo)
    points = decode(shot.pattern, shot.pictures)
    x, y = points.camera_px.astype(int).T
    assert np.median(np.abs(points.light / (230 * 0.95 * albedo[y, x]) - 1)) < 0.02


def test_saturated_pixels_are_left_out_and_counted():
    shot = shot_of(both(CODES["cue"]), albedo=np.broadcast_to(np.linspace(0.5, 1.4, CAMERA[0]), CAMERA[::-1]))
    points = decode(shot.pattern, shot.pictures)
    assert points.card.rejected["saturated"] > 0.1 * CAMERA[0] * CAMERA[1]
    assert np.mean(np.abs(errors(shot, points)) / points.projector_sigma_px[:, None] < 3) > 0.98
    assert points.card.seen == len(points) + sum(points.card.rejected.values())


def test_dim_sines_lose_points_but_make_no_wrong_turn():
    shot = shot_of(both(CODES["cue"]), albedo=0.2, noise=1.5)
    points = decode(shot.pattern, shot.pictures)
    assert points.card.rejected["turn"] > 0
    assert (np.abs(errors(shot, points)) < 8).all()


def test_a_jump_of_depth_gives_no_point_in_between():
    def mapping(x, y):
        u, v = oblique(x, y)
        return np.where(x > 200.3, u - 50.7, u), v

    shot = shot_of(both(CODES["cue"]), mapping=mapping)
    shot = replace(shot, pictures=[cv2.blur(picture, (3, 3)) for picture in shot.pictures])
    points = decode(shot.pattern, shot.pictures)
    near = np.abs(points.camera_px[:, 0] - 200.5) < 4
    assert np.abs(errors(shot, points)[near]).max() < 8
    assert len(points) > 0.9 * CAMERA[0] * CAMERA[1]


@pytest.mark.parametrize("axis", ["column", "row"])
@pytest.mark.parametrize("code", ["cue", "bits"])
def test_one_axis_tells_one_coordinate(axis, code):
    side = SIZE[axis == "row"]
    bits = gray_frames(axis, range(9)[::-1], inverses=True)
    shot = shot_of(CODES["cue"](axis, side) if code == "cue" else bits)
    points = decode(shot.pattern, shot.pictures)
    known = int(axis == "row")
    assert points.axes == (known,)
    assert len(points) > 0.7 * CAMERA[0] * CAMERA[1]
    assert np.abs(errors(shot, points)[:, known]).max() < 1


def test_columns_by_sines_and_rows_by_bits():
    shot = shot_of([*CODES["cue"]("column", SIZE[0]), *gray_frames("row", range(9)[::-1], inverses=True)])
    off = errors(shot, decode(shot.pattern, shot.pictures))
    assert len(off) > 0.7 * CAMERA[0] * CAMERA[1]
    assert np.abs(off).max() < 1


GRAY_SIZE = (128, 96)
PAIRS = layout_sequence("procam-calibration", GRAY_SIZE).frames
LEFT_OUT = {
    "inverses": lambda frame: frame.inverse,
    "white and black": lambda frame: frame.axis is None,
    "inverses, white and black": lambda frame: frame.inverse or frame.axis is None,
    "patterns": lambda frame: frame.code == "gray" and not frame.inverse,
    "the lowest bits": lambda frame: frame.bit == 0,
    "an inverse here and there": lambda frame: frame.inverse and frame.bit in (2, 3),
}


@pytest.mark.parametrize("what", LEFT_OUT)
def test_of_a_gray_code_may_be_missing(plain_shot, pictures, what):
    kept = [index for index, frame in enumerate(PAIRS) if not LEFT_OUT[what](frame)]
    pattern = FrameSequence(GRAY_SIZE, tuple(PAIRS[index] for index in kept))
    off = errors(plain_shot, decode(pattern, [pictures[index] for index in kept]))
    assert len(off) > 0.9 * 240 * 180
    assert np.sqrt(np.mean(off**2)) < 0.08
    assert np.abs(off).max() < 0.6


def test_frames_may_come_in_any_order_and_some_be_ignored(plain_shot, pictures):
    order = np.random.default_rng(5).permutation(len(PAIRS))
    frames = [PAIRS[index] for index in order]
    shuffled = [pictures[index] for index in order]
    pattern = FrameSequence(GRAY_SIZE, (Frame("ignore"), *frames))
    off = errors(plain_shot, decode(pattern, [pictures[3], *shuffled]))
    assert np.sqrt(np.mean(off**2)) < 0.03


def test_files_name_the_order(plain_shot, pictures):
    names = [f"{(7 * index) % len(PAIRS):02d}.png" for index in range(len(PAIRS))]
    pattern = FrameSequence(GRAY_SIZE, PAIRS, files=tuple(names))
    order = np.argsort(names)
    points = decode(pattern, [pictures[index] for index in order], names=[names[index] for index in order])
    assert np.sqrt(np.mean(errors(plain_shot, points) ** 2)) < 0.03
    with pytest.raises(CaptureError, match="found no"):
        decode(replace(pattern, files=("absent.png", *names[1:])), pictures, names=names)


def test_each_pixel_is_read_as_deep_as_it_resolves():
    """The left half is sharp, the right half blurred beyond the finest stripes."""
    pattern = layout_sequence("sltk", (256, 192))
    shot = shoot(pattern, size=(400, 300), mapping=lambda x, y: (4 + 0.6 * x + 0.01 * y, 3 - 0.01 * x + 0.58 * y))
    spoilt, rng = [], np.random.default_rng(2)
    for picture in shot.pictures:
        blurred = cv2.GaussianBlur(picture.astype(float), (0, 0), 4.0) + rng.normal(0, 1, picture.shape)
        blurred = np.rint(blurred).clip(0, 255).astype(np.uint8)
        spoilt.append(np.where(np.arange(400) < 200, picture, blurred))
    points = decode(pattern, spoilt)
    off = np.abs(errors(shot, points)).max(axis=1)
    right = points.camera_px[:, 0] > 210
    assert right.sum() > 0.6 * 190 * 300
    assert (~right).sum() > 0.85 * 190 * 300
    assert points.card.details["points_by_bits_left_out"][1] > 0.5 * right.sum()
    assert np.median(points.projector_sigma_px[right]) > 1.5 * np.median(points.projector_sigma_px[~right])
    assert off[~right].max() < 0.5
    assert np.quantile(off[right], 0.999) < 1.0


def test_the_number_of_pictures_is_told():
    pattern = layout_sequence("slstudio-2x3", SIZE)
    with pytest.raises(CaptureError, match=r"expected 12 pictures of the layout slstudio-2x3 \(12 of sines\), found 5"):
        decode(pattern, [np.zeros((10, 10), np.uint8)] * 5)


@pytest.mark.parametrize(
    ("layout", "says"), [("slstudio-2x3", "12 pictures, sinusoidal"), ("sltk", "18 pictures, bright or dark")]
)
def test_pictures_of_another_pattern_are_described(layout, says):
    shown = layout_sequence(layout, SIZE) if layout != "sltk" else layout_sequence(layout, (512, 384), ["column"])
    shot = shot_of(shown.frames)
    with pytest.raises(CaptureError, match=rf"found {says}.*{layout}"):
        decode(layout_sequence("slstudio-gray", SIZE), shot.pictures)


@pytest.mark.parametrize(
    ("layout", "axes"),
    [("slstudio-gray", ["column"]), ("slstudio-gray", None), ("sltk", ["column"]), ("structuredlight", None)],
)
def test_bits_of_another_number_are_told_by_their_layout_not_by_an_inverse_that_lacks(layout, axes):
    shown = shot_of(layout_sequence(layout, SIZE, axes).frames)
    with pytest.raises(CaptureError) as caught:
        decode(GrayCode(SIZE), shown.pictures)
    assert f"fit the layout {layout}" in str(caught.value)
    assert "no counterpart" not in str(caught.value)


def test_a_layout_that_only_has_as_many_pictures_is_not_named():
    shown = shot_of(layout_sequence("procam-calibration", SIZE).frames)
    with pytest.raises(CaptureError, match="fit the layout procam-calibration or opencv;"):
        decode(layout_sequence("slstudio-2x3", SIZE), shown.pictures)


MISCOUNTED = {
    "one missing": ([k for k in range(38) if k != 11], "found 37 pictures: number 12 is missing, after img_11.png"),
    "two missing": (
        [k for k in range(38) if k not in (11, 12)],
        "found 36 pictures: numbers 12 and 13 are missing, the first after img_11.png",
    ),
    "one too many": ([*range(38), 37], "found 39 pictures: img_39.png shows the same as img_38.png before it"),
    "all of one axis but one": (list(range(19)), "found 19 pictures"),
}


@pytest.mark.parametrize("case", MISCOUNTED)
@pytest.mark.parametrize("noise", [1.0, 6.0])
def test_pictures_that_are_missing_or_too_many_are_named_and_no_other_code_suspected(case, noise):
    pattern = layout_sequence("3dunderworld", SIZE)
    taken, said = MISCOUNTED[case]
    shown = shot_of(pattern.frames, albedo=0.4, noise=noise)
    names = [f"img_{index + 1:02d}.png" for index in (taken if "missing" in case else range(len(taken)))]
    with pytest.raises(CaptureError) as caught:
        decode(pattern, [shown.pictures[index] for index in taken], names=names)
    assert str(caught.value).endswith(said)


def test_bits_in_place_of_sines_are_another_code_though_bits_tell_their_turns() -> None:
    pattern = FrameSequence(SIZE, tuple(both(CODES["gray"])))
    shown = shot_of(both(lambda axis, side: gray_frames(axis, range(1, 9)[::-1], inverses=True)))
    assert len(shown.pictures) == pattern.picture_count
    assert shows_another_code(pattern, shown.pictures)
    assert not shows_another_code(pattern, shot_of(pattern.frames).pictures)
    with pytest.raises(CaptureError):
        decode(pattern, shown.pictures)


@pytest.mark.parametrize("layout", ["slstudio-2x3", "slstudio-nstep", "3dunderworld"])
def test_overexposed_pictures_are_called_so_and_not_another_code(layout):
    pattern = layout_sequence(layout, SIZE)
    bright = [np.minimum(2.2 * image.astype(float), 255).astype(np.uint8) for image in shot_of(pattern.frames).pictures]
    assert not shows_another_code(pattern, bright)
    exchanged = [*bright[5:], *bright[:5]]
    with pytest.raises(CaptureError, match="of the lit pixels are overexposed: shorten the exposure; read as they are"):
        decode(pattern, exchanged)


def test_sines_that_noise_hides_are_called_noisy_and_not_out_of_order():
    pattern = FrameSequence(SIZE, tuple(both(CODES["cue"])))
    with pytest.raises(CaptureError, match=r"too noisy for these sines: \d+\.\d grey levels"):
        decode(pattern, shot_of(pattern.frames, albedo=0.4, noise=12.0).pictures)


def test_where_print_is_bright_enough_order_is_told_though_noise_hides_it_elsewhere():
    pattern = FrameSequence(SIZE, tuple(both(CODES["cue"])))
    x = np.arange(CAMERA[0]) // 12 % 4 == 0
    shot = shot_of(pattern.frames, albedo=np.where(x, 0.95, 0.33), noise=3.5)
    points = decode(pattern, shot.pictures)
    assert points.card.advice == ()
    assert np.mean(np.abs(errors(shot, points)).max(axis=1) > 16) < 1e-3


def test_one_sine_of_three_shifts_is_said_to_hide_gamma():
    one, more = (shot_of(sine_frames("column", float(SIZE[0]), shifts)) for shifts in (3, 5))
    said = ["gamma" in " ".join(decode(shot.pattern, shot.pictures).card.advice) for shot in (one, more)]
    assert said == [True, False]


def test_hardly_any_light_beyond_noise_is_told():
    pattern = layout_sequence("slstudio-gray", SIZE)
    with pytest.raises(CaptureError, match="pixels are lit beyond their noise: expose longer"):
        decode(pattern, shot_of(pattern.frames, albedo=0.15, noise=6.0).pictures)


def test_little_that_decodes_and_nothing_else_explains_is_handed_on_as_it_is():
    """Print hides nearly all; what is left fits the expected order best."""
    y, x = np.mgrid[: CAMERA[1], : CAMERA[0]]
    shot = shot_of(
        gray_frames("column", range(9)[::-1], inverses=True) + gray_frames("row", range(9)[::-1], inverses=True),
        albedo=np.where((x < 45) & (y < 45), 0.8, 0.8 * ((x + y) % 2)),
    )
    points = decode(FrameSequence(SIZE, shot.pattern.frames), shot.pictures)
    assert 0 < len(points) < HARDLY_ANY * CAMERA[0] * CAMERA[1] / 2  # the half that is white
    assert points.card.details.get("read_all_the_same") is None
    assert np.abs(errors(shot, points)).max() < 1


def test_noise_of_bits_without_inverses_white_and_black_is_measured():
    """Dark pixels' bits are chance, and were read as another order: the brightest picture stood for white."""
    frames = gray_frames("column", range(9)[::-1], inverses=False)
    shot = shot_of(frames, albedo=0.5, noise=5.0, mapping=lambda x, y: (1.13 * x - 40.0, 1.09 * y + 6.7))
    points = decode(shot.pattern, shot.pictures)
    off = points.projector_px[:, 0] - shot.truth(points.camera_px)[:, 0]
    assert len(points) > 0.3 * CAMERA[0] * CAMERA[1]
    assert np.mean(np.abs(off) > 2) < 0.02


def test_noise_that_is_the_same_in_the_dark_hides_no_bits_without_inverses():
    """A camera's own noise, of which black has as much as white: over its brightness it is a large gain."""
    frames = [
        Frame("white"),
        Frame("black"),
        *both(lambda axis, _: gray_frames(axis, range(3, 9)[::-1], inverses=False)),
    ]
    shot = shot_of(frames, albedo=0.5, noise=6.0)
    points = decode(shot.pattern, shot.pictures)
    assert len(points) > 0.9 * CAMERA[0] * CAMERA[1]
    assert np.mean(np.abs(errors(shot, points)) > 2) < 0.001


@pytest.mark.parametrize("layout", ["3dunderworld", "procam-calibration"])
@pytest.mark.parametrize("pair", [0, 4, 6, 9])
def test_a_pair_that_is_missing_is_not_taken_for_white_and_black(pictures, layout, pair):
    pattern = layout_sequence(layout, GRAY_SIZE)
    *pairs, white, black = pictures
    del pairs[2 * pair : 2 * pair + 2]
    kept = [*pairs, white, black] if pattern.frames[0].code == "gray" else [white, black, *pairs]
    with pytest.raises(CaptureError, match=r"expected \d+ pictures .* as many as without white and black; read so"):
        decode(pattern, kept)


def test_all_patterns_may_come_before_all_inverses(plain_shot, pictures):
    *pairs, white, black = pictures
    points = decode(GrayCode(GRAY_SIZE), [*pairs[::2], *pairs[1::2], white, black])
    assert points.card.advice[0] == "read all the same: all inverses come last"
    assert np.sqrt(np.mean(errors(plain_shot, points) ** 2)) < 0.03


@pytest.mark.parametrize(("blur_px", "within"), [(0.5, 0.04), (0.65, 0.04), (0.8, 0.06)])
def test_prints_within_the_cameras_blur_hardly_move_points(blur_px, within):
    y, x = np.mgrid[: CAMERA[1], : CAMERA[0]]
    paint = np.where((x // 9 + y // 13) % 2, 0.9, 0.4)
    shot = seen_through(blur_px, paint, both(CODES["cue"]))
    points = decode(shot.pattern, shot.pictures)
    z = errors(shot, points) / points.projector_sigma_px[:, None]
    assert [np.mean(np.abs(z) < k) for k in (1, 2, 3)] == pytest.approx([0.683, 0.954, 0.997], abs=within)
    at_print = np.isin(points.cells[:, 1] % 9, (0, 8))
    plain = decode(shot.pattern, seen_through(blur_px, 0.65, both(CODES["cue"])).pictures)
    rms = [np.sqrt(np.mean(errors(shot, own) ** 2)) for own in (points.select(at_print), plain)]
    assert rms[0] < 1.7 * rms[1]  # two to three times where nothing is taken out


def test_where_nothing_is_printed_light_moves_no_point():
    shot = seen_through(0.6, 0.7, both(CODES["cue"]))
    points = decode(shot.pattern, shot.pictures)
    z = errors(shot, points) / points.projector_sigma_px[:, None]
    assert [np.mean(np.abs(z) < k) for k in (1, 2, 3)] == pytest.approx([0.683, 0.954, 0.997], abs=0.02)
