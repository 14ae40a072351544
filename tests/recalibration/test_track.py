"""The track of a whole record, against an observer who knows how it was drawn."""

from __future__ import annotations

import numpy as np
import pytest

from retrue.errors import InputError
from retrue.recalibration.track import rauch, smoothed

FRAMES = 1500
BUMPS = [400, 1100]


def drawn(step: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """True offsets of a random walk with two bumps, what frames say, and how well each knows its own."""
    rng = np.random.default_rng(seed)
    mixed = rng.normal(0, 1, (5, 5))
    covariances = (mixed @ mixed.T + np.eye(5)) * np.exp(rng.normal(0, 0.3, FRAMES))[:, None, None] * 1e-7
    true = np.cumsum(rng.normal(0, step, (FRAMES, 5)), axis=0)
    for bump in BUMPS:
        true[bump:] += [0.02, 0, 0.01, 0, -0.02]
    noise = (np.linalg.cholesky(covariances) @ rng.normal(0, 1, (FRAMES, 5, 1)))[..., 0]
    return true, true + noise, covariances


@pytest.mark.parametrize("step", [2e-5, 2e-4])
def test_the_track_is_as_near_as_the_whole_record_allows(step):
    true, offsets, covariances = drawn(step, 3)
    found = smoothed(offsets, covariances)
    steps, everything = np.append(0.0, np.ones(FRAMES - 1)), np.ones(FRAMES, dtype=bool)
    noises = np.eye(5) * step**2, np.zeros((5, 5))
    best, _ = rauch(offsets, covariances, *noises, steps, np.array(BUMPS), everything)
    assert found.bumps.tolist() == BUMPS
    assert np.mean((found.offset - true) ** 2) < 1.1**2 * np.mean((best - true) ** 2)
    errors = (found.offset - true)[:, :, None]
    normalised = np.mean(np.swapaxes(errors, 1, 2) @ np.linalg.solve(found.covariance, errors)) / 5
    assert 0.6 < normalised < 1.6


def test_strays_are_left_out_and_frames_that_overstate_their_noise_are_believed_more():
    _, offsets, covariances = drawn(2e-5, 5)
    offsets[[50, 700]] += 0.1
    found = smoothed(offsets, covariances * 4)
    assert np.flatnonzero(~found.used).tolist() == [50, 700]
    assert found.scatter == pytest.approx(0.25, rel=0.1)


def test_frames_may_come_at_any_times():
    true, offsets, covariances = drawn(2e-5, 7)
    kept = np.sort(np.random.default_rng(1).choice(FRAMES, FRAMES // 2, replace=False))
    found = smoothed(offsets[kept], covariances[kept], kept.astype(float))
    assert np.sqrt(np.mean((found.offset - true[kept]) ** 2)) < 0.5 * np.sqrt(np.mean((offsets - true) ** 2))
    with pytest.raises(InputError, match="expected increasing ones"):
        smoothed(offsets, covariances, np.zeros(FRAMES))
    with pytest.raises(InputError, match="3 frames or more, found 2"):
        smoothed(offsets[:2], covariances[:2])
