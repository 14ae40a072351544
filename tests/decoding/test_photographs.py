"""Two photographs of a textured scene: what is matched is where the truth has it, and what is not one scene is not."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from retrue import Camera, CaptureError, InputError, Rig, RigidTransform, decode, recalibrate, verify
from retrue.decoding.photographs.features import mutual
from retrue.decoding.photographs.match_photographs import grey_levels
from retrue.geometry.transform import rotation_angle
from retrue.patterns.photographs import PHOTOGRAPHS, Matches, Photographs
from retrue.simulation.camera_model import CameraModel
from retrue.simulation.photographs import Photographed, photograph, textured_scene

LEFT = Camera((320, 240), [[300, 0, 159.5], [0, 300, 119.5], [0, 0, 1]], [-0.1, 0.02, 0, 0, 0])
RIGHT = Camera((300, 260), [[330, 0, 150], [0, 330, 131], [0, 0, 1]], [-0.08, 0.02, 0, 0, 0])
RIG = Rig(LEFT, RIGHT, RigidTransform.from_rotation_vector([0.02, -0.06, 0.03], [-150.0, 4, 6]))


@pytest.fixture(scope="module")
def pair() -> Photographed:
    """Boxes and balls before a wall; the second camera is darker, softer and another lens."""
    first = CameraModel(exposure=0.9, blur_px=0.6, electrons=8000, read_noise=8)
    second = replace(first, exposure=0.6, blur_px=0.8)
    return photograph(RIG, textured_scene(RIG, 1200.0, seed=3), first, right_model=second, supersample=1)


def errors(pair: Photographed, points) -> np.ndarray:
    """(N, 2) px from where the second camera sees each place; NaN where it does not."""
    true = cv2.remap(
        pair.right_px.astype(np.float32), points.camera_px.astype(np.float32)[None], None, cv2.INTER_LINEAR
    )[0]
    return points.projector_px - true


def test_matches_are_where_the_truth_has_them_within_their_sigma(pair: Photographed) -> None:
    points = decode(PHOTOGRAPHS, [pair.left, pair.right])
    off = errors(pair, points)
    known = np.isfinite(off).all(axis=1)
    right = known & (np.linalg.norm(off, axis=1) < 1)
    assert len(points) > 300
    assert np.count_nonzero(right) > 0.97 * np.count_nonzero(known)
    assert 1.4826 * np.median(np.abs(off[right])) < 0.1
    sigma = np.hypot(points.camera_sigma_px, points.projector_sigma_px)[right]
    assert 0.5 < 1.4826 * np.median(np.abs(off[right] / sigma[:, None])) < 1.3
    assert (points.camera_size, points.projector_size) == (LEFT.size, RIGHT.size)
    assert points.colors is not None
    assert points.card is not None
    assert points.card.seen == points.card.decoded + sum(points.card.rejected.values())


def test_one_match_a_place_and_spread_over_the_picture(pair: Photographed) -> None:
    points = decode(Photographs(most_points=100), [pair.left, pair.right])
    assert len(points) == 100
    gaps = np.linalg.norm(points.camera_px[:, None] - points.camera_px, axis=-1)
    assert gaps[~np.eye(100, dtype=bool)].min() >= 3
    everything = decode(PHOTOGRAPHS, [pair.left, pair.right])
    thirds = np.digitize(points.camera_px[:, 0], [160, 235])  # of what both see
    assert np.bincount(thirds, minlength=3).min() > 20
    assert points.card.rejected["more than asked for"] == len(everything) - 100


def test_a_pose_is_found_from_two_photographs(pair: Photographed) -> None:
    points = decode(PHOTOGRAPHS, [pair.left, pair.right])
    turned = RigidTransform.from_rotation_vector(np.radians([1.5, -1, 1]), np.zeros(3))
    result = recalibrate(replace(RIG, projector_from_camera=turned @ RIG.projector_from_camera), [points])
    assert result.verdict == "accepted"
    assert np.degrees(rotation_angle(result.rig.projector_from_camera.R @ RIG.projector_from_camera.R.T)) < 0.2
    assert verify(RIG, [points]).verdict == "good"


def test_places_in_a_large_picture_are_as_exact_though_its_half_is_searched() -> None:
    random, picture = np.random.default_rng(0), np.zeros((901, 1203), np.float32)
    for size in (2, 4, 8, 16, 32):
        coarse = random.normal(0, size, (901 // size + 2, 1203 // size + 2)).astype(np.float32)
        picture += cv2.resize(coarse, (1203, 901), interpolation=cv2.INTER_CUBIC)
    levels = cv2.normalize(picture, None, 20, 235, cv2.NORM_MINMAX)
    shift = np.array([7, -3])
    left, right = (
        (level + random.normal(0, 1, level.shape)).round().astype(np.uint8)
        for level in (levels, np.roll(levels, shift[::-1], axis=(0, 1)))
    )
    points = decode(PHOTOGRAPHS, [left, right])
    assert len(points) > 1000
    off = np.abs(points.projector_px - points.camera_px - shift)
    sigma = np.hypot(points.camera_sigma_px, points.projector_sigma_px)
    assert np.median(off) < 0.07
    assert np.quantile(off / sigma[:, None], 0.99) < 4


@pytest.mark.parametrize("change", ["grey", "16 bit", "dim 16 bit", "one channel"])
def test_grey_colour_and_sixteen_bits_see_the_same(pair: Photographed, change: str) -> None:
    def seen(picture: np.ndarray) -> np.ndarray:
        if change == "grey":
            return cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
        if change == "one channel":
            return cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)[..., None]
        return picture.astype(np.uint16) * (257 if change == "16 bit" else 16)

    usual = decode(PHOTOGRAPHS, [pair.left, pair.right])
    points = decode(PHOTOGRAPHS, [seen(pair.left), seen(pair.right)])
    assert len(points) > 0.95 * len(usual)
    off = errors(pair, points)
    assert np.nanmedian(np.abs(off)) < 0.07


def test_a_turned_and_zoomed_camera_still_matches(pair: Photographed) -> None:
    turned = cv2.warpAffine(pair.left, cv2.getRotationMatrix2D((159.5, 119.5), 50, 0.8), (320, 240))
    points = decode(PHOTOGRAPHS, [pair.left, turned])
    map_to = cv2.getRotationMatrix2D((159.5, 119.5), 50, 0.8)
    off = points.projector_px - (points.camera_px @ map_to[:, :2].T + map_to[:, 2])
    assert len(points) > 60
    assert np.mean(np.linalg.norm(off, axis=1) < 0.5) > 0.95


@pytest.mark.parametrize(
    ("spoil", "advice"),
    [
        (lambda picture: np.full_like(picture, 128), "next to no texture"),
        (lambda picture: (picture // 12).astype(np.uint8), "too dark"),
        (lambda picture: np.full_like(picture, 255), "overexposed"),
        (lambda picture: np.random.default_rng(0).integers(60, 200, picture.shape, dtype=np.uint8), "share few places"),
    ],
)
def test_what_cannot_be_matched_says_why(pair: Photographed, spoil, advice: str) -> None:
    spoiled = cv2.GaussianBlur(spoil(pair.right), (0, 0), 1.0 if advice == "share few places" else 6.0)
    points = decode(PHOTOGRAPHS, [pair.left, spoiled])
    assert len(points) < 60
    assert any(advice in line for line in points.card.advice)
    assert recalibrate(RIG, [points]).verdict == "refused"


def test_rubbish_is_refused_and_the_picture_named(pair: Photographed) -> None:
    with pytest.raises(InputError, match="photographs: expected two, one of each camera, found 1"):
        decode(PHOTOGRAPHS, [pair.left])
    with pytest.raises(InputError, match=r"right: expected a photograph .* found float64"):
        decode(PHOTOGRAPHS, [pair.left, pair.right / 255.0])
    with pytest.raises(InputError, match=r"left: expected a photograph .* found uint8 \(0, 5, 3\)"):
        decode(PHOTOGRAPHS, [np.zeros((0, 5, 3), np.uint8), pair.right])
    with pytest.raises(InputError, match="ratio: expected more than 0, at most 1"):
        Photographs(ratio=1.5)
    for tiny in ((1, 1), (3, 200), (20, 20)):
        assert len(decode(PHOTOGRAPHS, [np.zeros(tiny, np.uint8), pair.right])) == 0


def test_exchanged_photographs_of_other_sizes_are_told(pair: Photographed) -> None:
    points = decode(PHOTOGRAPHS, [pair.right, pair.left])
    with pytest.raises(CaptureError, match=r"300 x 260, those of the rig's camera 320 x 240"):
        recalibrate(RIG, [points])


class Fixed:
    """A matcher that knows the truth, roughly."""

    def __init__(self, pair: Photographed, sigma_px: float | None) -> None:
        self.pair, self.sigma_px = pair, sigma_px

    def match(self, left: np.ndarray, right: np.ndarray) -> Matches:
        assert left.dtype == right.dtype == np.uint8
        assert left.ndim == right.ndim == 2
        y, x = np.mgrid[20:220:9, 20:300:9]
        here = np.stack([x.ravel(), y.ravel()], axis=-1)
        there = self.pair.right_px[here[:, 1], here[:, 0]]
        known = np.isfinite(there).all(axis=1)
        rough = np.random.default_rng(1).normal(0, 0.3, (known.sum(), 2))
        return Matches(here[known], there[known] + rough, np.ones(known.sum()), sigma_px=self.sigma_px)


@pytest.mark.parametrize("sigma_px", [None, 0.5])
def test_another_matcher_is_aligned_too(pair: Photographed, sigma_px: float | None) -> None:
    points = decode(Photographs(matcher=Fixed(pair, sigma_px)), [pair.left, pair.right])
    off = np.abs(errors(pair, points))
    aligned = np.hypot(points.camera_sigma_px, points.projector_sigma_px) < 0.49
    assert np.nanmedian(off[aligned]) < 0.07
    assert aligned.all() == (sigma_px is None)


def test_mutual_neighbours_are_nobody_elses() -> None:
    first = np.eye(4, 6, dtype=np.float32)
    second = np.concatenate([first[[2, 0]], np.full((1, 6), 6**-0.5, np.float32)])
    rows, columns, distances = mutual(first, second, 0.99)
    assert rows.tolist() == [0, 2]
    assert columns.tolist() == [1, 0]
    assert np.allclose(distances[:, 0], 0, atol=1e-3)


def test_levels_span_the_picture_whatever_its_depth() -> None:
    ramp = np.tile(np.linspace(100, 140, 400).astype(np.uint8), (300, 1))
    for picture in (ramp, ramp.astype(np.uint16) * 257, np.repeat(ramp[..., None], 3, axis=2)):
        levels = grey_levels(picture)
        assert levels.dtype == np.float32
        assert levels.min() == pytest.approx(0, abs=8)
        assert levels.max() == pytest.approx(255, abs=8)
