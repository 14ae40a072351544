"""What straight lines miss the edges of stripes by, against edges that are blurred by other means."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import erf

from retrue.decoding.decode import decode
from retrue.decoding.gray import plan
from retrue.decoding.gray.edge_shape import NO_BIAS, PER_STRIPE, edge_bias
from retrue.patterns.gray_code import GrayCode

FINE = 400  # samples a pixel


def blurred_stripes(stripe_px: float, blur: float, bit: int) -> tuple[np.ndarray, np.ndarray]:
    """Where an edge truly lies between two pixels, and where the line through them has it; by convolution."""
    x = np.arange(-30 * FINE, 30 * FINE + 1) / FINE
    wave = np.where(np.floor(x / (stripe_px * 2 ** (bit + 1))) % 2 == 0, 1.0, -1.0)
    reach = np.arange(-5 * blur * FINE, 5 * blur * FINE + 1) / FINE
    weights = np.exp(-0.5 * (reach / blur) ** 2)
    pixel = np.ones(FINE + 1)
    seen = np.convolve(np.convolve(wave, weights / weights.sum(), "same"), pixel / pixel.sum(), "same")
    middle = 30 * FINE
    shares = np.arange(20, FINE - 19, 20)
    before, behind = -seen[middle - shares], seen[middle + FINE - shares]
    return shares / FINE, before / (before + behind)


def steepness(blur: float) -> float:
    true, _ = blurred_stripes(4.0, blur, 2)
    x = np.linspace(-8, 8, 16 * FINE + 1)
    step = erf(x / (2**0.5 * blur))

    def seen(distance: float) -> float:
        return float(step[np.abs(x - distance) <= 0.5].mean())

    return float(np.median([seen(f) + seen(1 - f) for f in true]))


@pytest.mark.parametrize(("stripe_px", "blur"), [(0.75, 0.6), (1.0, 0.4), (1.0, 0.7), (1.6, 0.1), (3.0, 0.5)])
def test_lines_are_straightened(stripe_px: float, blur: float) -> None:
    spacing = np.arange(edge_bias(1.0, 1.0).shape[1])
    for bit, table in enumerate(edge_bias(stripe_px, steepness(blur))):
        c, steeper = (np.interp(PER_STRIPE / stripe_px, spacing, column) for column in table.T)
        true, found = blurred_stripes(stripe_px, blur, bit)
        off = found - true
        left = off - (c + steeper * (1 - 2 * found) ** 2) * found * (1 - found) * (1 - 2 * found)
        assert np.sqrt(np.mean(off**2)) > 0.015
        assert np.mean(left**2) < 0.25**2 * np.mean(off**2)


def test_soft_edges_stay_as_they_are() -> None:
    for found in (edge_bias(1.7, 0.6), edge_bias(float("inf"), 0.3), edge_bias(1.0, float("nan"))):
        assert not found.any()


def test_no_beat_where_stripes_are_as_narrow_as_pixels(shooting, monkeypatch: pytest.MonkeyPatch) -> None:
    def wall(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return 4.2 + 0.94 * x + 0.004 * y, 3.3 - 0.003 * x + 0.96 * y

    shot = shooting(GrayCode((256, 192)), mapping=wall)

    def rms() -> float:
        points = decode(shot.pattern, shot.pictures)
        assert len(points) > 0.9 * 240 * 180
        return float(np.sqrt(np.mean((points.projector_px - shot.truth(points.camera_px)) ** 2)))

    straightened = rms()
    monkeypatch.setattr(plan, "edge_bias", lambda stripe_px, steepness: NO_BIAS)
    assert straightened < 0.5 * rms()
