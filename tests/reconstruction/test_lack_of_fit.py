"""What a quadric cannot follow is told from noise, and of noise nothing is made."""

import numpy as np
import pytest

from retrue.reconstruction.lack_of_fit import LackOfFit, centre_filter, filtered, lack_of_fit

HALF = 8
SHAPE = (240, 320)


def asked(surface: np.ndarray, noise: float, seed: int = 1) -> tuple[LackOfFit, np.ndarray, np.ndarray]:
    """With where windows are whole, and what each truly misses in its middle."""
    values = surface + np.random.default_rng(seed).normal(0, noise, SHAPE)
    whole = np.zeros(SHAPE, np.bool_)
    whole[HALF:-HALF, HALF:-HALF] = True
    line, mean = centre_filter(HALF, 2), np.full(2 * HALF + 1, 1 / (2 * HALF + 1))
    missed = filtered(surface, mean, line) + filtered(surface, line - mean, mean) - surface
    # The variance that is stated may be off by a factor: noise is measured.
    return lack_of_fit(values, np.full(SHAPE, 4 * noise**2), whole, HALF), whole, missed


def noise_left(noise: float) -> float:
    """Variance of a quadric's value in the middle."""
    line, side = centre_filter(HALF, 2), 2 * HALF + 1
    return noise**2 * float(np.sum((np.add.outer(line, line) / side - 1 / side**2) ** 2))


def test_noise_on_a_quadric_is_no_lack() -> None:
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] / 100.0
    found, whole, _ = asked(3 + x - 2 * y + x * y - 2 * x * x + 0.5 * y * y, 0.1)
    assert found.fits[whole].mean() > 0.99
    assert found.variance[whole].mean() < 0.05 * noise_left(0.1)
    assert np.isinf(found.variance[~whole]).all()


@pytest.mark.parametrize("slope", [0.05, 0.1, 0.3])
def test_a_crease_is_found_where_it_is(slope: float) -> None:
    surface = slope * np.abs(np.arange(SHAPE[1]) - 160.3) + np.zeros(SHAPE)
    found, whole, missed = asked(surface, 0.1)
    at_crease, beyond = np.zeros(SHAPE, np.bool_), whole.copy()
    at_crease[:, 156:165] = True
    beyond[:, 140:181] = False
    ratio = found.variance[whole & at_crease].mean() / (missed[whole & at_crease] ** 2).mean()
    assert 0.4 < ratio < 2.5
    assert found.variance[beyond].mean() < 0.1 * noise_left(0.1)


def test_waves_over_half_of_the_picture_are_not_taken_for_noise() -> None:
    column = np.arange(SHAPE[1])
    waves = column < SHAPE[1] // 2
    surface = np.where(waves, 0.3 * np.sin((column - SHAPE[1] // 2) / 4.0), 0.0) + np.zeros(SHAPE)
    found, whole, missed = asked(surface, 0.05)
    there = whole & (column < SHAPE[1] // 2 - HALF)
    assert found.variance[there].mean() > 0.5 * (missed[there] ** 2).mean()
    beyond = whole & (column > SHAPE[1] // 2 + 2 * HALF)
    assert found.variance[beyond].mean() < 0.2 * noise_left(0.05)


def test_filters_keep_their_polynomials() -> None:
    for half, degree in ((1, 2), (2, 2), (2, 4), (8, 2), (8, 4)):
        x = np.arange(-half, half + 1.0)
        assert centre_filter(half, degree) @ (3 - 2 * x + 0.5 * x**degree) == pytest.approx(3)


@pytest.mark.parametrize("count", [0, 1, 30])
def test_few_windows_are_answered(count: int) -> None:
    whole = np.zeros((40, 40), np.bool_)
    whole.flat[:count] = True
    found = lack_of_fit(np.zeros((40, 40)), np.ones((40, 40)), whole, 2)
    assert np.isfinite(found.variance).sum() == count
