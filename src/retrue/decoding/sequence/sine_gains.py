"""What each picture of sines was multiplied by, as automatic exposure does, told by what no scene explains.

A combination v of the pictures that any brightness B and any sines leave at zero is zero in every pixel once each
picture I_k is multiplied by the right r_k, one over its gain: sum_k v_k r_k I_k = 0. Over all pixels p and all such
combinations that is least squares of r^T Q r, with

    Q = (sum_p I_p I_p^T) o (V^T V),    o element by element,

whose smallest eigenvalue belongs to r. Sines of three shifts need another sine of the same scene to be told.
"""

from __future__ import annotations

import numpy as np

from retrue.decoding.sequence.hypotheses import Sample
from retrue.decoding.sequence.noise import unexplained
from retrue.geometry.arrays import BoolArray, FloatArray
from retrue.patterns.sequence import FrameSequence

ROUNDS = 4
"""Each without the pixels that the one before left far off."""
TRUSTED = 3.0
"""Times the median misfit: pixels beyond count no more."""
TOLD = 4.0
"""By which the second smallest eigenvalue must exceed the smallest."""
LARGEST_GAIN = 10.0
FEWEST = 100
"""Pixels."""


def fit_sine_gains(sample: Sample, spec: FrameSequence, ended: BoolArray) -> FloatArray:
    """(pictures,) gain of each, their geometric mean 1; ones where the sines do not tell.

    `ended` (pixels,): where a picture is at the end of its scale, and tells nothing.
    """
    ones = np.ones(len(sample.here))
    shown, combinations = _combinations(spec)
    seen = sample.here[shown][:, ~ended]
    if not len(combinations) or seen.shape[1] < FEWEST:
        return ones
    among = combinations.T @ combinations
    kept = np.ones(seen.shape[1], np.bool_)
    reciprocal = np.ones(len(shown))
    for _ in range(ROUNDS):
        values, vectors = np.linalg.eigh((seen[:, kept] @ seen[:, kept].T) * among)
        reciprocal = vectors[:, 0] * np.sign(vectors[:, 0].sum())
        if not values[1] > TOLD * max(values[0], 0.0) or not (reciprocal > reciprocal.max() / LARGEST_GAIN).all():
            return ones
        off = _misses(seen * reciprocal[:, None], combinations)
        kept = off <= TRUSTED * np.median(off)
        if np.count_nonzero(kept) < FEWEST:
            return ones
    gains = ones.copy()
    gains[shown] = np.exp(np.mean(np.log(reciprocal))) / reciprocal
    return gains


def sine_misfit(here: FloatArray, spec: FrameSequence) -> float:
    """Median over pixels (pictures, N) of what no scene explains, of the contrast; 0 where nothing tells."""
    shown, combinations = _combinations(spec)
    if not len(combinations):
        return 0.0
    seen = here[shown]
    return float(np.median(_misses(seen, combinations) / np.maximum(np.ptp(seen, axis=0), 1e-6)))


def _combinations(spec: FrameSequence) -> tuple[list[int], FloatArray]:
    """The pictures of sines (N,), and their combinations (M, N) that leave nothing."""
    sines = [spec.sines(axis) for axis in spec.axes]
    shown = sorted({index for axis in sines for sine in axis for index in sine.pictures})
    return shown, unexplained(shown, sines)


def _misses(seen: FloatArray, combinations: FloatArray) -> FloatArray:
    return np.linalg.norm(combinations @ seen, axis=0)
