"""Each picture of bits at another exposure: told, read, and not called sines."""

from __future__ import annotations

import numpy as np
import pytest

from retrue.decoding.decode import decode
from retrue.decoding.sequence.diagnosis import show_sines
from retrue.decoding.sequence.exposure import fit_unpaired_gains, unpaired_misfit
from retrue.decoding.sequence.hypotheses import take_sample
from retrue.patterns.layouts import gray_frames
from retrue.patterns.sequence import Frame
from tests.decoding.test_sequences import SIZE, errors, shot_of

LIGHTS = [Frame("white"), Frame("black")]


def bits(*, inverses, lowest=2):
    return [
        f
        for axis, side in zip(("column", "row"), SIZE, strict=True)
        for f in gray_frames(axis, range(lowest, (side - 1).bit_length())[::-1], inverses=inverses)
    ]


def exposed(shot, seed):
    """The same pictures, and how bright each is beside the usual."""
    gains = np.random.default_rng(seed).uniform(0.55, 1.1, len(shot.pictures))
    pictures = [np.rint(p * g).astype(np.uint8) for p, g in zip(shot.pictures, gains, strict=True)]
    return pictures, gains


@pytest.mark.parametrize("lights", [LIGHTS, []])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_bits_without_inverses_are_read_at_any_exposure(seed, lights):
    shot = shot_of([*lights, *bits(inverses=False)])
    pictures, gains = exposed(shot, seed)
    points = decode(shot.pattern, pictures)
    told = gains[len(lights) :] if lights else gains
    assert "automatic exposure off" in points.card.advice[0]
    assert points.card.details["gain_spread"] == pytest.approx(told.max() / told.min(), rel=0.25)
    assert len(points) > 0.6 * pictures[0].size
    assert np.mean(np.abs(errors(shot, points)).max(axis=1) > 4) < 1e-3


def test_gains_of_bits_without_inverses():
    shot = shot_of([*LIGHTS, *bits(inverses=False)])
    pictures, gains = exposed(shot, 4)
    sample = take_sample(pictures, np.random.default_rng(0))
    assert sample is not None
    found = fit_unpaired_gains(sample.here, shot.pattern.frames)
    off = np.abs(found[2:] / found[0] - gains[2:] / gains[0])
    assert np.median(off) < 0.02
    misfit = [unpaired_misfit(sample.here / own[:, None], shot.pattern.frames) for own in (np.ones_like(found), found)]
    assert misfit[1] < 0.05 < misfit[0]


@pytest.mark.parametrize("inverses", [True, False])
def test_bits_at_any_exposure_are_no_sines(inverses):
    for seed in range(10):
        pictures, _ = exposed(shot_of(bits(inverses=inverses, lowest=0), seed=seed), seed)
        assert not show_sines(pictures)


def test_the_least_causes_are_told_of_pictures_of_unlike_brightness():
    shot = shot_of([*LIGHTS, *bits(inverses=True)])
    frames = shot.pattern.frames
    order = sorted(range(len(frames)), key=lambda k: (k > 1, frames[k].axis == "row", frames[k].bit or 0, k))
    pictures, _ = exposed(shot, 5)
    points = decode(shot.pattern, [pictures[k] for k in order])
    assert points.card.details["read_all_the_same"][0] == "the least significant bits come first"
    assert len(points.card.details["read_all_the_same"]) == 2
    assert np.mean(np.abs(errors(shot, points)).max(axis=1) > 4) < 1e-3
