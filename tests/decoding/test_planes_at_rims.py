"""How sure planes through stripe edges are where a rim cuts their window off, against how far they truly are off."""

from __future__ import annotations

import numpy as np
import pytest

from retrue.decoding.gray import stripe_edges
from retrue.decoding.gray.stripe_edges import LARGEST_RESIDUAL, Edges, PlaneFitter

SIDE, CELL, NOISE = 320, 2, 0.03
SLOPES = 0.77, 0.05  # stripes a pixel


def errors_in_sigmas(angle: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Of each pixel that is lit: how far from the rim, and how many of its own sigmas the plane is off."""
    y, x = np.mgrid[:SIDE, :SIDE]
    from_rim = (x - SIDE / 2) * np.cos(angle) + (y - SIDE / 2) * np.sin(angle)
    n = 10.3 + SLOPES[0] * x + SLOPES[1] * y
    code, lit = np.floor(n + 0.5), from_rim > 0
    row, column = np.nonzero(lit[:, :-1] & lit[:, 1:] & (np.diff(code, axis=1) == 1))
    value = code[row, column] + 0.5
    place = (value - n[row, column]) / SLOPES[0]
    place += NOISE * np.random.default_rng(seed).normal(size=len(place))
    seen = np.stack([np.ones_like(place), place, value]).astype(np.float32)
    edges, rows = Edges((row * SIDE + column).astype(np.int32), seen), range(SIDE)
    fitter = PlaneFitter((SIDE, SIDE), CELL, 1, LARGEST_RESIDUAL)
    fitter.add(rows, edges)
    fitter.fit(rows, edges)
    fitter.judge(rows)
    fit = fitter.fitted()
    cell, off = (y // CELL, x // CELL), (CELL - 1) / 2
    found = fit.planes[0][cell] + fit.planes[1][cell] * (x % CELL - off) + fit.planes[2][cell] * (y % CELL - off)
    inner = lit & (np.minimum(x, y) > 16) & (np.maximum(x, y) < SIDE - 16)
    return from_rim[inner], (found - n)[inner] / np.sqrt(fit.error[cell][inner])


@pytest.mark.parametrize("angle", [0.3, 0.8, 1.4])
def test_a_window_that_is_cut_off_is_as_sure_as_it_says(angle: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stripe_edges, "EDGE_SIGMA", 1e-4)  # edges err by their noise alone, each for itself
    monkeypatch.setattr(stripe_edges, "scatter_level", lambda value, variance, whole: np.ones_like(value))
    seen = [errors_in_sigmas(angle, seed) for seed in range(3)]
    from_rim, z = (np.concatenate(part) for part in zip(*seen, strict=True))
    for ring in ((0.5, 2), (2, 4), (4, 7), (20, 60)):
        here = (from_rim >= ring[0]) & (from_rim < ring[1])
        assert np.sqrt(np.mean(z[here] ** 2)) == pytest.approx(1, abs=0.1), ring


def test_the_scatter_is_told_where_edges_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stripe_edges, "EDGE_SIGMA", 1e-4)
    from_rim, z = errors_in_sigmas(0.8, 1)
    beside = z[(from_rim > 0.5) & (from_rim < 7)]
    assert np.sqrt(np.mean(beside**2)) > 0.9  # planes beyond the rim, which few edges tell, would have it .8
