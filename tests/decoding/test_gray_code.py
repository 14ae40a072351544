"""Accuracy and validity of the Gray-code decoder, against exact truth and on real captures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from retrue.decoding.decode import decode
from retrue.errors import CaptureError
from retrue.patterns.gray_code import GrayCode
from tests.decoding.conftest import oblique

DATA = Path(__file__).parents[3] / "shared" / "data" / "procam-board"
PATTERN = GrayCode((128, 96))


def errors(shot, points):
    return points.projector_px - shot.truth(points.camera_px)


def test_decodes_far_below_a_pixel_and_nearly_everywhere(plain_shot):
    points = decode(PATTERN, plain_shot.pictures)
    off = errors(plain_shot, points)
    assert len(points) > 0.9 * 240 * 180
    assert np.sqrt(np.mean(off**2)) < 0.03
    assert np.abs(off).max() < 0.3
    assert np.abs(off.mean(axis=0)).max() < 0.005


def test_sigma_grows_where_light_is_weak(shooting):
    left = np.broadcast_to(np.arange(240) < 120, (180, 240))
    shot = shooting(PATTERN, albedo=np.where(left, 0.9, 0.1), noise=3.0)
    points = decode(PATTERN, shot.pictures)
    size = np.sqrt(np.mean(errors(shot, points) ** 2, axis=1))
    bright, dark = points.camera_px[:, 0] < 110, points.camera_px[:, 0] > 130
    for side in (bright, dark):
        assert np.sqrt(np.mean(size[side] ** 2)) < 1.5 * np.median(points.projector_sigma_px[side])
    assert np.median(points.projector_sigma_px[dark]) > 1.1 * np.median(points.projector_sigma_px[bright])
    assert np.median(size[dark]) > np.median(size[bright])


def test_cells_are_camera_pixels_and_coordinates_pixel_centres(plain_shot):
    points = decode(PATTERN, plain_shot.pictures)
    assert np.array_equal(points.camera_px, points.cells[:, ::-1])
    assert points.camera_px.dtype == points.projector_px.dtype == np.float64


def test_light_is_white_less_black_where_white_is_not_saturated(shooting):
    albedo = np.broadcast_to(np.linspace(0.2, 1.3, 240), (180, 240))
    shot = shooting(PATTERN, albedo=albedo)
    points = decode(PATTERN, shot.pictures)
    x, y = points.camera_px.astype(int).T
    white, black = shot.pictures[-2][y, x], shot.pictures[-1][y, x]
    full = white >= 253
    assert 0.05 < full.mean() < 0.5
    assert np.array_equal(np.isnan(points.light), full)
    assert np.array_equal(points.light[~full], (white.astype(float) - black)[~full])
    assert points.light_class is None
    assert (points.camera_size, points.projector_size) == ((240, 180), (128, 96))


@pytest.mark.parametrize("order", ["last", "first", "absent"])
def test_white_and_black_may_be_last_first_or_absent(plain_shot, pictures, order):
    bits, lit = pictures[:-2], pictures[-2:]
    arranged = {"last": bits + lit, "first": lit + bits, "absent": bits}[order]
    off = errors(plain_shot, decode(PATTERN, arranged))
    assert len(off) > 0.9 * 240 * 180
    assert np.sqrt(np.mean(off**2)) < 0.03


@pytest.mark.parametrize("step", [3, 4, 10])
def test_wide_stripes_mean_their_centres(shooting, step):
    """Read as its first pixel, a stripe would be (step - 1) / 2 off; perspective bends the map within a window."""
    pattern = GrayCode((128, 96), step=step)
    shot = shooting(pattern)
    off = errors(shot, decode(pattern, shot.pictures))
    assert len(off) > 0.5 * 240 * 180
    assert np.abs(off.mean(axis=0)).max() < 0.02 * step
    assert np.sqrt(np.mean(off**2)) < 0.03 * step


def test_offset_of_centred_codes(shooting):
    pattern = GrayCode((128, 96), offset=(0, 16))
    shot = shooting(pattern)
    assert np.abs(errors(shot, decode(pattern, shot.pictures)).mean(axis=0)).max() < 0.005


def test_camera_on_its_side(shooting):
    shot = shooting(PATTERN, mapping=lambda x, y: (5 + 0.45 * y + 0.02 * x, 92 - 0.44 * x - 0.03 * y), size=(200, 200))
    off = errors(shot, decode(PATTERN, shot.pictures))
    assert len(off) > 0.9 * 200 * 200
    assert np.sqrt(np.mean(off**2)) < 0.03


def test_camera_coarser_than_the_projector_never_lies(shooting):
    shot = shooting(GrayCode((256, 192)), mapping=lambda x, y: (4 + 0.9 * x + 0.05 * y, 3 - 0.04 * x + 0.88 * y))
    off = errors(shot, decode(shot.pattern, shot.pictures))
    assert len(off) > 0.5 * 240 * 180
    assert np.abs(off).max() < 0.6


@pytest.mark.parametrize("gamma", [0.45, 2.2])
def test_gamma_does_not_shift_the_edges(shooting, gamma):
    shot = shooting(PATTERN, gamma=gamma)
    off = errors(shot, decode(PATTERN, shot.pictures))
    assert np.sqrt(np.mean(off**2)) < 0.03


def test_printed_squares_do_not_shift_the_edges(shooting):
    y, x = np.mgrid[:180, :240]
    shot = shooting(PATTERN, albedo=np.where((x // 31 + y // 29) % 2, 0.9, 0.12))
    points = decode(PATTERN, shot.pictures)
    assert np.sqrt(np.mean(errors(shot, points) ** 2)) < 0.04


def test_depth_jump_gives_no_point_in_between(shooting):
    def mapping(x, y):
        u, v = 6 + 0.45 * x + 0.01 * y, 4 + 0.44 * y
        return np.where(x > 120.5, u - 9.3, u), v

    shot = shooting(PATTERN, mapping=mapping)
    points = decode(PATTERN, shot.pictures)
    assert np.abs(errors(shot, points)).max() < 0.3
    assert len(points) > 0.8 * 240 * 180


def test_sixteen_bit_and_colour(plain_shot, pictures):
    deep = [picture.astype(np.uint16) * 257 for picture in pictures]
    tint = np.array([1.0, 0.8, 0.5])
    tinted = [np.rint(picture[..., None] * tint).astype(np.uint8) for picture in pictures]
    plain = decode(PATTERN, pictures)
    assert np.sqrt(np.mean(errors(plain_shot, decode(PATTERN, deep)) ** 2)) < 0.03
    points = decode(PATTERN, tinted)
    assert np.sqrt(np.mean(errors(plain_shot, points) ** 2)) < 0.03
    assert np.array_equal(plain.colors[:, 0], plain.colors[:, 2])
    row, column = points.cells[100]
    assert np.array_equal(points.colors[100], tinted[-2][row, column])


def test_card_counts_every_lit_pixel_once(plain_shot):
    points = decode(PATTERN, plain_shot.pictures)
    card = points.card
    assert card.decoded == len(points)
    assert card.seen == card.decoded + sum(card.rejected.values())


def test_unlit_half_is_left_out(shooting):
    x = np.broadcast_to(np.arange(240), (180, 240))
    points = decode(PATTERN, shooting(PATTERN, albedo=np.where(x < 120, 0.8, 0.0)).pictures)
    assert points.camera_px[:, 0].max() < 121
    assert len(points) > 0.8 * 120 * 180


@pytest.mark.parametrize("rows", [32, 64])
@pytest.mark.parametrize("finer", [1, 3])
def test_bands_leave_no_seams(shooting, monkeypatch, rows, finer):
    """Nor where stripes are narrower than a pixel, and how wide is told about each edge."""
    pattern = GrayCode((finer * 128, finer * 96))
    shot = shooting(pattern, mapping=lambda x, y: tuple(finer * n for n in oblique(x, y)))
    whole = decode(pattern, shot.pictures)  # a hundred and twenty-eight rows, and the rest
    monkeypatch.setattr("retrue.decoding.gray.decode_gray_code.BAND_ROWS", rows)
    parts = decode(pattern, shot.pictures)
    for name in ("camera_px", "projector_px", "projector_sigma_px", "light"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))
    assert parts.card == whole.card


def test_where_nothing_is_lit_nothing_is_looked_at(shooting):
    """Nor does it change what lies beside it: cut off or dark, the rest decodes alike."""
    dark = np.ones((180, 240))
    dark[:, :100] = dark[:140] = 0
    shot = shooting(PATTERN, albedo=0.7 * dark)
    points = decode(PATTERN, shot.pictures)
    assert len(points) > 0.8 * 40 * 140
    assert points.camera_px.min(axis=0).tolist() >= [100, 140]
    assert np.sqrt(np.mean(errors(shot, points) ** 2)) < 0.05
    assert points.card.seen == points.card.decoded + sum(points.card.rejected.values())


def test_noise_does_not_decode():
    rng = np.random.default_rng(0)
    pictures = [rng.integers(0, 256, (120, 160), dtype=np.uint8) for _ in range(PATTERN.picture_count)]
    with pytest.raises(CaptureError):
        decode(PATTERN, pictures)


@pytest.mark.skipif(not DATA.is_dir(), reason="shared/data/procam-board is absent")
@pytest.mark.parametrize("capture", ["capture_0", "capture_1", "capture_2"])
def test_real_board_squares_lie_on_a_homography(capture):
    """Inside a white square of the board the lens does next to nothing: a homography must fit to a few hundredths."""
    cv2 = pytest.importorskip("cv2")
    from retrue.files.images import read_folder

    images, _ = read_folder(DATA / capture)
    points = decode(GrayCode((1024, 768)), images)
    row_of = np.full(images[0].shape, -1)
    row_of[tuple(points.cells.T)] = np.arange(len(points))
    rough = cv2.morphologyEx(images[-2], cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) > 40
    found = 0
    for top in range(200, 800, 40):
        for left in range(200, 1000, 40):
            box = slice(top, top + 40), slice(left, left + 40)
            inside = row_of[box][row_of[box] >= 0]
            if len(inside) < 1500 or rough[box].any():
                continue
            camera, projector = points.camera_px[inside], points.projector_px[inside]
            homography, _ = cv2.findHomography(camera, projector, 0)
            off = cv2.perspectiveTransform(camera[:, None], homography)[:, 0] - projector
            assert np.sqrt(np.mean(off**2)) < 0.06
            found += 1
    assert found >= 5
