"""Phase, variance and modulation of sines are those of least squares; 8 and 16 bit, any number of shifts."""

import numpy as np
import pytest

from retrue.decoding.sequence.noise import Noise
from retrue.decoding.sequence.sines import demodulate
from retrue.patterns.sequence import Sine

NOISE = Noise(1.5, 0.02)


def seen(shifts: tuple[float, ...], dtype: type, pixels: int) -> tuple[np.ndarray, np.ndarray]:
    """Pictures of every phase, and the phases."""
    rng = np.random.default_rng(0)
    phase, top = np.linspace(0, 1, pixels, endpoint=False), np.iinfo(dtype).max / 255
    light = 120 + rng.uniform(20, 90, pixels) * np.cos(2 * np.pi * (phase - np.array(shifts)[:, None]))
    return np.clip(np.rint(top * (light + rng.normal(0, 1, light.shape))), 0, 255 * top).astype(dtype), phase


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("count", [3, 4, 9])
@pytest.mark.parametrize("pixels", [1, 511, 512, 1300])
def test_they_are_those_of_least_squares(dtype: type, count: int, pixels: int) -> None:
    shifts = tuple(k / count for k in range(count))
    pictures, truth = seen(shifts, dtype, pixels)
    found = demodulate(list(pictures), Sine(20.0, 3.0, tuple(range(count)), shifts), NOISE)
    angles = 2 * np.pi * np.array(shifts)
    inverse = np.linalg.pinv(np.stack([np.ones(count), np.cos(angles), np.sin(angles)], axis=1))
    _, c, s = inverse @ pictures
    expected = (np.arctan2(s, c) / (2 * np.pi) + 3.0 / 20.0) % 1
    off = found.phase - expected
    assert np.abs(off - np.rint(off)).max() < 3e-7
    assert ((found.phase >= 0) & (found.phase <= 1)).all()
    np.testing.assert_allclose(found.modulation, np.hypot(c, s), rtol=1e-5)
    gradient = (c[:, None] * inverse[2] - s[:, None] * inverse[1]) / (c**2 + s**2)[:, None] / (2 * np.pi)
    variance = np.sum(gradient**2 * (NOISE.floor + NOISE.gain * pictures.T), axis=1)
    np.testing.assert_allclose(found.variance, variance, rtol=1e-4)
    assert np.abs(expected - truth - 0.15 - np.rint(expected - truth - 0.15)).max() < 0.1


def test_what_shows_no_sine_has_no_phase_and_the_end_of_the_scale_is_told() -> None:
    pictures = [np.array([[0, 90, 255]], np.uint8)] * 3
    found = demodulate(pictures, Sine(20.0, 0.0, (0, 1, 2), (0.0, 1 / 3, 2 / 3)), NOISE)
    assert found.saturated.tolist() == [[False, False, True]]
    assert np.isinf(found.variance[0, 0])
    assert (found.variance > 1).all()
