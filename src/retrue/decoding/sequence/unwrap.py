"""Whole turns: from a coarse coordinate, step by step, to the finest sine's; wrong ones are found and left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from retrue.decoding.sequence.noise import FloatImage
from retrue.decoding.sequence.sines import Wrapped, beat, harmonics
from retrue.geometry.arrays import FloatArray
from retrue.kernels import sines as kernel

MOST_SIGMAS = 4.0
"""By which a coarse coordinate and a finer one may disagree."""
LEAST_SIGMAS = 5.0
"""By which a wrong turn must differ from what is seen: one in two millions."""
SAFE_SIGMAS = 12.0
"""By which turns differ that no error of sigma confuses."""
CUE_HARMONICS = tuple(range(1, 9))
"""Multiples of the coarse phase in which gamma may bend it."""
BEND_STEPS = 4096
"""A turn in so many, for the table of it."""
SAME = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Coarse:
    """A coordinate to start from, in pixels of the projector.

    Attributes
    ----------
    px : of each pixel.
    variance : of it, px^2.
    reach : half the width of what the coordinate stands for, px, as of a stripe, in each pixel; 0 of a sine.
    period_px : after so much it repeats.
    phase : in turns, where it is a sine.
    """

    px: FloatImage
    variance: FloatImage
    reach: FloatImage | float
    period_px: float
    phase: FloatImage | None = None

    def at(self, pixels: NDArray[np.intp]) -> Coarse:
        """Of these pixels, by their flat index."""
        reach = self.reach if isinstance(self.reach, float) else np.take(self.reach, pixels)
        phase = None if self.phase is None else np.take(self.phase, pixels)
        return Coarse(np.take(self.px, pixels), np.take(self.variance, pixels), reach, self.period_px, phase)


@dataclass(frozen=True, slots=True, eq=False)
class Bend:
    """What the coarse sine misses the fine ones by, measured over the picture.

    Attributes
    ----------
    coefficients : of 1 and the cosines and sines of CUE_HARMONICS of the coarse phase, px.
    variance : of what is left beyond noise, px^2.
    """

    coefficients: FloatArray = field(default_factory=lambda: np.zeros(1 + 2 * len(CUE_HARMONICS)))
    variance: float = 0.0

    def at(self, phase: FloatImage) -> FloatImage:
        """In each pixel."""
        if not self.coefficients.any():
            return np.zeros_like(phase)
        bent = (self.coefficients[1:] @ _bend_terms() + self.coefficients[0]).astype(np.float32)
        return bent[np.minimum((phase * np.float32(BEND_STEPS)).astype(np.int32), BEND_STEPS - 1)]


@cache
def _bend_terms() -> NDArray[np.floating]:
    return harmonics((np.arange(BEND_STEPS) + 0.5) / BEND_STEPS, CUE_HARMONICS)


@dataclass(frozen=True, slots=True, eq=False)
class Unwrapped:
    """Coordinates of the finest sine.

    Attributes
    ----------
    known : (2, P) projector coordinate, px, and its variance.
    flags : (2, P) whether no other turn explains the pixel, and the coarser sines agree with the finer ones; and where
        the next turn is less than SAFE_SIGMAS away, so that sigma itself must be right.
    missed : by how much the coarse coordinate misses the first sine below it, px; allowed : its variance.
    """

    known: FloatImage
    flags: NDArray[np.uint8]
    missed: FloatImage
    allowed: FloatImage


def ladder(sines: Sequence[Wrapped], side: float, coarse: Coarse | None) -> tuple[Coarse, list[Wrapped]]:
    """A coordinate without ambiguity, and the sines to refine it by, the longest period first.

    The coordinate is `coarse`, of a Gray code, or the shortest sine that is longer than the projector's `side`, or a
    beat of two, or the only turn of the shortest on which all others agree.
    """
    longest_first = sorted(sines, key=lambda sine: -sine.period_px)
    if coarse is not None:
        return coarse, longest_first
    shorter = [sine for sine in longest_first if sine.period_px < side - SAME]
    for kind in ("sines", "beats"):
        beats = [beat(short, long) for long, short in pairwise(longest_first)] if kind == "beats" else []
        made, steps = (beats, [*beats, *shorter]) if beats else (longest_first, shorter)
        whole = [sine for sine in made if sine.period_px >= side - SAME]
        if whole:
            start = min(whole, key=lambda sine: sine.period_px)
            steps = sorted((step for step in steps if step.period_px < side - SAME), key=lambda step: -step.period_px)
            period = np.float32(start.period_px)
            phase = start.phase if made is longest_first else None
            begun = Coarse(start.phase * period, start.variance * period**2, 0.0, start.period_px, phase)
            return begun, steps or [start]
    return _agreed(longest_first[-1], longest_first[:-1], side), longest_first


def _agreed(shortest: Wrapped, others: Sequence[Wrapped], side: float) -> Coarse:
    """The turn of the shortest sine at which the others show the phases that are seen; NaN where no single one does.

    In squares of what the noise explains, the best turn must be missed by no more than MOST_SIGMAS and the second best
    by more than LEAST_SIGMAS.
    """
    best = np.full(shortest.phase.shape, np.inf, np.float32)
    second, px = best.copy(), np.full_like(best, np.nan)
    period = np.float32(shortest.period_px)
    ratios = [np.float32(shortest.period_px / other.period_px) for other in others]
    weights = [1 / (other.variance + shortest.variance * ratio**2) for other, ratio in zip(others, ratios, strict=True)]
    for turn in range(-1, int(np.ceil(side / shortest.period_px)) + 1):
        seen = shortest.phase + np.float32(turn)
        missed = np.zeros_like(best)
        for other, ratio, weight in zip(others, ratios, weights, strict=True):
            off = seen * ratio - other.phase
            off -= np.rint(off)
            missed += off * off * weight
        better = missed < best
        second = np.where(better, best, np.minimum(second, missed))
        best = np.where(better, missed, best)
        px = np.where(better, seen * period, px)
    certain = (best <= MOST_SIGMAS**2 + len(others) - 1) & (second > LEAST_SIGMAS**2)
    return Coarse(np.where(certain, px, np.nan), shortest.variance * period**2, 0.0, np.inf)


def unwrap(coarse: Coarse, steps: Sequence[Wrapped], bend: Bend, side: float) -> Unwrapped:
    """Turn by turn: x = (m + phase) period, m the whole number that comes nearest to the coarser coordinate.

    A step is trusted where the coarser coordinate misses the finer by no more than MOST_SIGMAS, and the next turn
    would be missed by more than LEAST_SIGMAS. Of pixels in one row.
    """
    count = len(coarse.px)
    known, missed, first = (np.empty((2, count), np.float32) for _ in range(3))
    np.subtract(coarse.px, np.float32(0) if coarse.phase is None else bend.at(coarse.phase), out=known[0])
    np.add(coarse.variance, np.float32(bend.variance), out=known[1])
    flags = np.zeros((2, count), np.uint8)
    flags[0] = 1
    reach, none = coarse.reach if isinstance(coarse.reach, np.ndarray) else np.zeros(1, np.float32), np.zeros(1)
    for index, sine in enumerate(steps):
        judged = coarse.period_px > sine.period_px + SAME or coarse.phase is None
        kernel.refine(
            sine.phase,
            sine.variance,
            reach,
            sine.period_px,
            (MOST_SIGMAS, LEAST_SIGMAS, SAFE_SIGMAS),
            known,
            first if index == 0 else missed,
            flags,
            judged,
        )
        reach = none.astype(np.float32)
    if not np.isinf(coarse.period_px):
        kernel.keep_within(coarse.period_px, side, LEAST_SIGMAS, known, flags[0])
    return Unwrapped(known, flags, *first)
