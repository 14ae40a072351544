"""What became of single pictures of sines: gains, a share of the one before, another picture; told without the scene.

Gains are what automatic exposure multiplies each by. A combination v of the pictures that any brightness B and any
sines leave at zero is zero in every pixel once each picture I_k is multiplied by the right r_k, one over its gain:
sum_k v_k r_k I_k = 0. Over all pixels p and all such combinations that is least squares of r^T Q r, with

    Q = (sum_p I_p I_p^T) o (V^T V),    o element by element,

whose smallest eigenvalue belongs to r. Sines of three shifts need another sine of the same scene to be told.

A single picture that shows something else leaves all combinations off zero but those without it.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from retrue.decoding.sequence.hypotheses import Sample
from retrue.decoding.sequence.noise import unexplained
from retrue.geometry.arrays import BoolArray, FloatArray
from retrue.patterns.sequence import FrameSequence, Sine

ROUNDS = 4
"""Each without the pixels that the one before left far off."""
TRUSTED = 3.0
"""Times the median misfit: pixels beyond count no more."""
TOLD = 4.0
"""By which the second smallest eigenvalue must exceed the smallest."""
LARGEST_GAIN = 10.0
FEWEST = 100
"""Pixels."""
ALONE = 0.6
"""Of the squared misfit, for each combination, what is left without the one picture that explains it: by chance, and
whatever gamma does, .95."""
LEAST_SHARE, LARGEST_SHARE = 0.05, 0.45
FEWEST_PERIODS = 4
"""Over the projector, of a sine whose phases a scene shows about alike."""


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


def fit_sine_share(sample: Sample, spec: FrameSequence) -> float:
    """The share s of the picture before in each, which leaves a sine's mean s (before - last) / N too large.

    Least squares over the pixels, of the differences of two sines' means.
    """
    level: list[FloatArray] = []
    change: list[FloatArray] = []
    for sine in (sine for axis in spec.axes for sine in spec.sines(axis)):
        start, end = min(sine.pictures), max(sine.pictures)
        if end - start + 1 != len(sine.pictures):
            continue  # between other pictures
        level.append(np.mean(sample.here[list(sine.pictures)], axis=0))
        before = sample.here[start - 1] if start else sample.here[end]
        change.append((before - sample.here[end]) / len(sine.pictures))
    if len(level) < 2:
        return 0.0
    y = np.concatenate([a - b for a, b in pairwise(level)])
    x = np.concatenate([a - b for a, b in pairwise(change)])
    power = float(x @ x)
    slope = float(x @ y) / power if power > 0 else 0.0
    explained = float(np.median(np.abs(y - slope * x))) < 0.7 * float(np.median(np.abs(y)))
    share = slope / (1 + slope) if slope > -1 else 0.0
    return share if explained and LEAST_SHARE < share < LARGEST_SHARE else 0.0


def sine_misfit(here: FloatArray, spec: FrameSequence) -> float:
    """Median over pixels (pictures, N) of what no scene explains, of the contrast; 0 where nothing tells."""
    shown, combinations = _combinations(spec)
    if not len(combinations):
        return 0.0
    seen = here[shown]
    return float(np.median(_misses(seen, combinations) / np.maximum(np.ptp(seen, axis=0), 1e-6)))


def odd_pictures(here: FloatArray, spec: FrameSequence, corrected: FloatArray) -> list[int]:
    """The pictures of one sine without any of which the others, of pixels (pictures, N), show one scene.

    None where all together, `corrected` for faults of light, show one almost as well. Of a sine of three shifts each
    explains what any does, of four its opposite: then they are several.
    """
    shown, whole = _combinations(spec)
    sines = [spec.sines(axis) for axis in spec.axes]
    if len(whole) < 3:
        return []
    limit = ALONE * min(_square(own[shown], whole) for own in (here, corrected))
    odd: list[int] = []
    for index in shown:
        rest = [other for other in shown if other != index]
        without = [[_less(sine, index) for sine in axis] for axis in sines]
        if _square(here[rest], unexplained(rest, without)) < limit:
            odd.append(index)
    return odd if any(set(odd) <= set(sine.pictures) for axis in sines for sine in axis) else []


def _less(sine: Sine, index: int) -> Sine:
    """Without that picture."""
    kept = [(own, shift) for own, shift in zip(sine.pictures, sine.shifts, strict=True) if own != index]
    return replace(sine, pictures=tuple(own for own, _ in kept), shifts=tuple(shift for _, shift in kept))


def _square(seen: FloatArray, combinations: FloatArray) -> float:
    """Median over pixels of the squared misfit, for each combination."""
    return float(np.median(_misses(seen, combinations) ** 2)) / len(combinations) if len(combinations) else np.inf


def brightness(here: FloatArray, spec: FrameSequence) -> float:
    """Largest over smallest mean of the pictures of a fine sine, whose phases are all seen alike."""
    spreads = [1.0]
    for axis in spec.axes:
        sine = spec.sines(axis)[0] if spec.sines(axis) else None
        if sine is not None and spec.projector_size[axis] >= FEWEST_PERIODS * sine.period_px:
            level = here[list(sine.pictures)].mean(axis=1)
            spreads.append(float(level.max() / max(level.min(), 1e-6)))
    return max(spreads)


def _combinations(spec: FrameSequence) -> tuple[list[int], FloatArray]:
    """The pictures of sines (N,), and their combinations (M, N) that leave nothing."""
    sines = [spec.sines(axis) for axis in spec.axes]
    shown = sorted({index for axis in sines for sine in axis for index in sine.pictures})
    return shown, unexplained(shown, sines)


def _misses(seen: FloatArray, combinations: FloatArray) -> FloatArray:
    return np.linalg.norm(combinations @ seen, axis=0)
