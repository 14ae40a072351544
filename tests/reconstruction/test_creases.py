"""Creases are told from noise, and the surface beside them is that of the side that a point is on."""

import numpy as np
import pytest

from retrue.reconstruction.creases import find_creases

SHAPE = (200, 260)
RADIUS = 8


def roof(angle: float, slope: float) -> tuple[np.ndarray, np.ndarray]:
    """A surface with a crease through its middle, and each cell's distance from that."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    away = (x - 130.3) * np.cos(angle) + (y - 99.6) * np.sin(angle)
    return 5 + 0.02 * x - 0.01 * y - slope * np.abs(away), np.abs(away)


@pytest.mark.parametrize("angle", [0.0, 0.3, 1.1, 2.4])
def test_beside_a_crease_values_err_by_what_is_said(angle):
    surface, away = roof(angle, 0.2)
    values = surface + np.random.default_rng(1).normal(0, 0.1, SHAPE)
    found = find_creases(values, np.full(SHAPE, 0.01), np.zeros(SHAPE, bool), away > 12, RADIUS)
    inner = np.zeros(SHAPE, bool)
    inner[12:-12, 12:-12] = True
    beside = (away < 1.5) & inner
    assert found.told[beside].mean() > 0.97
    assert found.told[(away > 9) & inner].mean() < 0.002
    off = (found.values - surface)[beside & found.told] / (0.1 * np.sqrt(found.left[beside & found.told]))
    assert [np.mean(np.abs(off) < k) for k in (1, 2, 3)] == pytest.approx([0.683, 0.954, 0.997], abs=0.06)


def test_noise_makes_no_creases_whether_neighbours_err_alike_or_not():
    values = np.random.default_rng(2).normal(0, 0.1, SHAPE)
    alike = np.kron(values[::4, ::4], np.ones((4, 4)))
    for noise in (values, alike):
        found = find_creases(noise, np.full(SHAPE, 0.01), np.zeros(SHAPE, bool), np.ones(SHAPE, bool), RADIUS)
        assert found.told.mean() < 0.01


def test_nothing_is_said_where_the_surface_ends():
    surface, away = roof(0.3, 0.5)
    ends = np.zeros(SHAPE, bool)
    ends[:, 150] = True
    found = find_creases(surface, np.full(SHAPE, 0.01), ends, away > 12, RADIUS)
    assert not found.told[:, 142:159].any()
    assert not found.told[:RADIUS].any()
