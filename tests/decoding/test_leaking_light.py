"""Brightness that changes within a camera's blur moves the edges of stripes: by s^2 C' / C, which is taken out."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from retrue.decoding.decode import decode
from retrue.decoding.gray import stripe_edges
from retrue.patterns.gray_code import GrayCode

FINE = 16  # samples a pixel
SIZE = (240, 96)  # of camera
STRIPE_PX = 3.0
BLUR_PX = 0.56  # with the pixel, of variance 0.4


def pictures(slope: float) -> list[np.ndarray]:
    """Of a code seen at STRIPE_PX pixels a stripe, in light that grows and falls by `slope` of itself a pixel."""
    x = (np.arange(SIZE[0] * FINE) + 0.5) / FINE - 0.5
    light = 30000 * np.exp(-slope * np.abs((x + 10) % 40 - 20))
    column = np.floor(20 + x / STRIPE_PX + 0.5).astype(int)
    row = np.floor(20 + np.arange(SIZE[1]) / STRIPE_PX + 0.5).astype(int)
    taken: list[np.ndarray] = []
    for shown in GrayCode((128, 64)).render():
        seen = gaussian_filter1d(light * shown[row][:, column], BLUR_PX * FINE, axis=1, mode="nearest")
        taken.append((300 + seen.reshape(SIZE[1], SIZE[0], FINE).mean(axis=2) / 255).astype(np.uint16))
    return taken


def errors(slope: float) -> np.ndarray:
    """Of the columns of the projector, in camera pixels, where the light grows, away from its turns."""
    points = decode(GrayCode((128, 64)), pictures(slope))
    x = points.camera_px[:, 0]
    phase = (x + 10) % 40
    growing = (x > 30) & (x < SIZE[0] - 30) & (phase > 6) & (phase < 14)
    assert growing.sum() > 1000
    return STRIPE_PX * points.projector_px[growing, 0] - (STRIPE_PX * 20 + x[growing])


def test_edges_are_where_they_lie_in_light_that_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    found = errors(0.04)
    monkeypatch.setattr(stripe_edges, "BLUR", 0.0)
    moved = errors(0.04)
    assert np.median(moved) == pytest.approx(0.04 * (BLUR_PX**2 + 1 / 12), rel=0.25)
    assert abs(np.median(found)) < 0.2 * abs(np.median(moved))


def test_in_even_light_nothing_is_moved(monkeypatch: pytest.MonkeyPatch) -> None:
    found = errors(0.0)
    monkeypatch.setattr(stripe_edges, "BLUR", 0.0)
    assert np.abs(found - errors(0.0)).max() < 1e-6
