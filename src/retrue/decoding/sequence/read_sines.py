"""The axes of a sequence that are told by sines, band by band: phases, whole turns, and which pixels to believe."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial, reduce

import cv2
import numpy as np
from numpy.typing import NDArray

from retrue.decoding.gray.cue import as_cue, read_cue
from retrue.decoding.gray.plan import plan_reading
from retrue.decoding.gray.sequence import GraySequence, gray_sequence
from retrue.decoding.light import BLUR, BLUR_DOUBT
from retrue.decoding.sequence.arrange import ArrangedSequence
from retrue.decoding.sequence.noise import FloatImage, Noise, measure_noise
from retrue.decoding.sequence.ripple import measure_ripple, straightened
from retrue.decoding.sequence.sines import Wrapped, demodulate, harmonics
from retrue.decoding.sequence.unwrap import CUE_HARMONICS, Bend, ladder, unwrap
from retrue.geometry.arrays import BoolArray, Cut, FloatArray
from retrue.geometry.robust import MAD_TO_SIGMA
from retrue.kernels import sines as kernel
from retrue.patterns.sequence import Sine

LEAST_SIGNAL = 5.0
"""Sigmas of the modulation: a pixel is lit that shows so much of the finest sine."""
LIT_VARIANCE = float(1 / (2 * np.pi * LEAST_SIGNAL) ** 2)
"""Turns^2: that signal's variance of the phase."""
JUMP_STEPS, JUMP_SIGMAS = 6.0, 6.0
"""A pixel whose neighbours differ by so many of the usual steps, and so many sigmas, sees two surfaces."""
END_PX, END_REACH = 4.0, 3
"""How far blur carries light: from the projector's ends in its pixels, and in the camera's."""
WHOLE = 0.9
"""Of the modulation beside it: a pixel with less sees the end of the picture."""
NOWHERE_PX = -1e6
SAMPLE_BANDS, SAMPLE_ROWS = 20, 4
FEWEST_TURNS = 4
"""Of a sine over the projector: of fewer, the scene may show some phases more than others."""
RIDGE = 1e-9
MOST_PIXELS_TO_FIT = 12_000
REASONS = {
    "saturated": "a picture of a sine is at the end of its scale",
    "turn": "whole turns are not certain: coarse and fine pictures disagree by more than their noise",
    "beyond": "coordinate beyond the projector, or at the end of its picture",
    "edge": "on the edge of a surface: neighbours differ by far more than elsewhere",
}


@dataclass(frozen=True, slots=True, eq=False)
class AxisPlan:
    """How to read one axis.

    Attributes
    ----------
    axis : 0 of columns, 1 of rows.
    sines : the shortest period first.
    side : of the projector, along the axis.
    cue : a Gray code that tells the turns, and its noise; None where sines do.
    bend : what the coarsest sine misses the finer ones by.
    ripples : of each sine, what gamma does to it, `measure_ripple`.
    step_px : usual difference of a pixel's two neighbours.
    """

    axis: int
    sines: list[Sine]
    side: float
    cue: tuple[GraySequence, float] | None
    bend: Bend
    ripples: tuple[complex, ...]
    step_px: float

    def part(self, rows: Cut, columns: Cut) -> AxisPlan:
        """The same for those rows and columns of the pictures."""
        if self.cue is None:
            return self
        return replace(self, cue=(self.cue[0].part(rows, columns), self.cue[1]))


@dataclass(frozen=True, slots=True, eq=False)
class SineBand:
    """The points of a band of rows; as `gray.reading.Band`, with the finest sine's modulation, twice, as `light`."""

    pixels: NDArray[np.intp]
    projector_px: dict[int, FloatArray]
    sigma_px: FloatArray
    light: FloatArray
    seen: int
    rejected: dict[str, int]


@dataclass(frozen=True, slots=True, eq=False)
class _AxisReading:
    """What some rows say of one axis. Unwrapping knows only the pixels that may be lit, one after the other.

    Attributes
    ----------
    trusted, risky, lit, saturated : of each pixel.
    px, variance, modulation : of each pixel; 0 where nothing may be lit.
    told : of the pixels that may be lit, which are, and none of their pictures saturated.
    missed, allowed, coarse_phase : of these, as `Unwrapped` and `Coarse` have them.
    """

    trusted: BoolArray
    risky: BoolArray
    lit: BoolArray
    saturated: BoolArray
    px: FloatImage
    variance: FloatImage
    modulation: FloatImage
    told: BoolArray
    missed: FloatImage
    allowed: FloatImage
    coarse_phase: FloatImage | None


def plan_sines(
    sequence: ArrangedSequence, axes: Sequence[int], threads: ThreadPoolExecutor
) -> tuple[Noise, list[AxisPlan]]:
    """What a sample of rows tells: noise, what gamma does to coarse and fine sines, and how smooth the scene is."""
    sines = [sequence.spec.sines(axis) for axis in axes]
    noise = measure_noise(sequence.pictures, sines)
    return noise, list(threads.map(partial(_plan_axis, sequence, noise=noise), axes, sines))


def read_sines(
    sequence: ArrangedSequence,
    noise: Noise,
    plans: Sequence[AxisPlan],
    bands: Sequence[range],
    threads: ThreadPoolExecutor,
) -> list[SineBand]:
    """One point per camera pixel whose phases can be trusted on every axis of `plans`."""
    return list(threads.map(partial(_read_band, sequence, noise, plans), bands))


def _read_band(sequence: ArrangedSequence, noise: Noise, plans: Sequence[AxisPlan], rows: range) -> SineBand:
    height, width = sequence.white.shape
    top, bottom = max(rows.start - END_REACH, 0), min(rows.stop + END_REACH, height)
    around, inner = slice(top, bottom), slice(rows.start - top, rows.stop - top)
    columns = _lit_columns(sequence, plans[0].sines[0], noise, around)
    here = sequence.part(around, columns)
    axes = [_read_axis(here, plan.part(around, columns), noise) for plan in plans]
    lit = reduce(np.logical_and, [axis.lit for axis in axes])
    full = reduce(np.logical_or, [axis.saturated for axis in axes])
    turned = reduce(np.logical_and, [_certain(axis, lit, p) for axis, p in zip(axes, plans, strict=True)])
    within = reduce(np.logical_and, [_inside(axis, plan.side) for axis, plan in zip(axes, plans, strict=True)])
    good = lit & ~full & turned & within
    flat: BoolArray = np.ones_like(good)
    for axis, plan in zip(axes, plans, strict=True):
        step, sigmas = JUMP_STEPS * plan.step_px, JUMP_SIGMAS * np.sqrt(2)
        kernel.find_steps(axis.px, axis.variance, good.view(np.uint8), step, sigmas, flat.view(np.uint8))
    pixels = np.flatnonzero((good & flat)[inner])
    masks = {
        "saturated": lit & full,
        "turn": lit & ~full & ~turned,
        "beyond": lit & ~full & turned & ~within,
        "edge": good & ~flat,
    }
    px, variance = _against_blur(axes, plans, good & flat, inner.start, pixels)
    cut = columns.stop - columns.start
    return SineBand(
        pixels + pixels // cut * (width - cut) + columns.start,
        {plan.axis: own for plan, own in zip(plans, px, strict=True)},
        np.sqrt(variance.astype(np.float64)),
        2 * np.take(axes[0].modulation[inner], pixels).astype(np.float64),
        int(np.count_nonzero(lit[inner])),
        {reason: int(np.count_nonzero(mask[inner])) for reason, mask in masks.items()},
    )


def _against_blur(
    axes: Sequence[_AxisReading], plans: Sequence[AxisPlan], whole: BoolArray, first: int, pixels: NDArray[np.intp]
) -> tuple[list[FloatArray], NDArray[np.float32]]:
    """Coordinates of each axis, and the mean variance of all, of `pixels` from row `first` on.

    Where light L changes within the camera's blur, of variance s^2, a pixel sees more of its brighter side, and there
    another phase: to first order its coordinate n is off by s^2 grad n . grad L / L, on prints and on round things by
    more than its noise. That is taken out with the usual blur of a sharp camera, and what may be left widens sigma.

    Source: Yue, Dantanarayana, Wu, Huntley, "Reduction of systematic errors in structured light metrology at
    discontinuities in surface reflectivity", Optics and Lasers in Engineering 112, 2019, who ask for the blur itself.
    """
    variance = np.zeros(len(pixels), np.float32)
    px: list[FloatArray] = [np.empty(len(pixels)) for _ in axes]
    for axis, plan, own in zip(axes, plans, px, strict=True):
        seen = axis.px, axis.variance, axis.modulation, whole.view(np.uint8)
        kernel.against_blur(*seen, first, pixels, plan.sines[0].period_px, BLUR, BLUR_DOUBT, own, variance)
    return px, variance / np.float32(len(axes))


def _differing(sequence: ArrangedSequence, sine: Sine, noise: Noise, rows: slice) -> BoolArray:
    """Where some pixel may be lit: its pictures differ by more."""
    pictures = [sequence.pictures[index][rows] for index in sine.pictures]
    differ = cv2.subtract(reduce(cv2.max, pictures), reduce(cv2.min, pictures))
    return differ > LEAST_SIGNAL * np.sqrt(noise.floor * 2 / len(pictures))


def _lit_columns(sequence: ArrangedSequence, sine: Sine, noise: Noise, rows: slice) -> slice:
    """From the first to the last column of a band in which some pixel may be lit."""
    differ = _differing(sequence, sine, noise, rows)
    lit, width = np.flatnonzero(differ.any(axis=0)), differ.shape[1]
    return slice(max(int(lit[0]) - 1, 0), min(int(lit[-1]) + 2, width)) if len(lit) else slice(0, min(2, width))


def _read_axis(sequence: ArrangedSequence, plan: AxisPlan, noise: Noise) -> _AxisReading:
    every = slice(None)
    may = _differing(sequence, plan.sines[0], noise, every)
    pixels = np.flatnonzero(may)
    wrapped: list[Wrapped] = []
    for sine, ripple in zip(plan.sines, plan.ripples, strict=True):
        seen = demodulate([sequence.pictures[index] for index in sine.pictures], sine, noise, pixels)
        wrapped.append(straightened(seen, ripple, len(sine.pictures)))
    finest = wrapped[0]
    cue, trusted = (None, None) if plan.cue is None else read_cue(*plan.cue, every)
    coarse, steps = ladder(wrapped, plan.side, None if cue is None else cue.at(pixels))
    found = unwrap(coarse, steps, plan.bend, plan.side)
    if trusted is not None:
        found.flags[0] &= np.take(trusted, pixels).view(np.uint8)
    full = reduce(np.logical_or, [sine.saturated for sine in wrapped])  # a coarse one too: else it tells a wrong turn
    flags = np.concatenate([found.flags, [finest.variance < LIT_VARIANCE, full]], dtype=np.uint8)
    images, masks = np.zeros((3, *may.shape), np.float32), np.zeros((4, *may.shape), np.uint8)
    kernel.spread(pixels, found.known, finest.modulation, flags, images.reshape(3, -1), masks.reshape(4, -1))
    told = (flags[2] & ~flags[3]).view(np.bool_)
    of = masks.view(np.bool_)
    return _AxisReading(
        of[0], of[1], of[2], of[3], images[0], images[1], images[2], told, found.missed, found.allowed, coarse.phase
    )


def _certain(found: _AxisReading, lit: BoolArray, plan: AxisPlan) -> BoolArray:
    """Where turns are trusted, and, where that hangs on sigma, so seen by most of the pixels around."""
    good = found.trusted & lit
    risky = np.flatnonzero(good & found.risky)
    if not len(risky):
        return good
    seen = np.full_like(found.px, NOWHERE_PX)
    np.copyto(seen, found.px, where=good)
    around = np.take(cv2.medianBlur(seen, 3), risky)
    np.put(good, risky[np.abs(np.take(found.px, risky) - around) > plan.sines[0].period_px / 2], False)
    return good


def _inside(found: _AxisReading, side: float) -> BoolArray:
    """Where the coordinate is in the projector, and the pixel sees no end of its picture: a sine that is cut off there
    has another phase, and adds less than beside it."""
    inside = (found.px >= -0.5) & (found.px <= side - 0.5)
    near = inside & ((found.px < END_PX - 0.5) | (found.px > side - END_PX - 0.5)) & found.lit
    if not near.any():
        return inside
    beside = cv2.dilate(found.modulation, np.ones((2 * END_REACH + 1, 2 * END_REACH + 1), np.uint8))
    return inside & ~(near & (found.modulation < WHOLE * beside))


def _plan_axis(sequence: ArrangedSequence, axis: int, sines: list[Sine], noise: Noise) -> AxisPlan:
    side = float(sequence.spec.projector_size[axis])
    height, width = sequence.white.shape
    sample = sequence.part(_strips(height), slice(None))
    cue = None
    if sequence.spec.gray(axis) is not None:
        code = as_cue(gray_sequence(sequence, [axis]), sines[0].period_px)
        cue = code, plan_reading(code, finest=False).noise_gain
    beside = sequence.part(slice(None), _strips(width))
    plan = AxisPlan(axis, sines, side, cue, Bend(), _ripples([sample, beside], sines, side, noise), np.inf)
    here = plan.part(_strips(height), slice(None))
    read = _read_axis(sample, here, noise)
    if cue is None:
        plan = replace(plan, bend=_bend(read, sines))
        read = _read_axis(sample, replace(here, bend=plan.bend), noise)
    steps = _steps(read, min(SAMPLE_ROWS, height))
    return replace(plan, step_px=float(np.median(steps)) if len(steps) else np.inf)


def _ripples(
    samples: Sequence[ArrangedSequence], sines: Sequence[Sine], side: float, noise: Noise
) -> tuple[complex, ...]:
    """Of sines of several turns, from strips of rows and of columns.

    What gamma does to a single turn is no ripple over the scene, but `Bend`.
    """
    ripples: list[complex] = []
    for sine in sines:
        seen: list[tuple[Wrapped, BoolArray]] = []
        for axis, sample in enumerate(samples if sine.period_px * FEWEST_TURNS <= side else []):
            own = demodulate([sample.pictures[index] for index in sine.pictures], sine, noise)
            lit = (own.variance < LIT_VARIANCE) & ~own.saturated
            parts = lit.shape[axis] // min(SAMPLE_ROWS, lit.shape[axis])
            images = [np.array_split(image, parts, axis) for image in (own.phase, own.variance, own.modulation)]
            for mask, *cut in zip(np.array_split(lit, parts, axis), *images, strict=True):
                seen.append((Wrapped(own.period_px, *cut, saturated=mask), mask))
        ripples.append(measure_ripple(seen, len(sine.pictures)) if seen else 0j)
    return tuple(ripples)


def _strips(side: int) -> NDArray[np.intp]:
    """Numbers of rows, or columns: strips of SAMPLE_ROWS that are spread over the picture."""
    rows = min(SAMPLE_ROWS, side)
    tops = np.unique(np.linspace(0, side - rows, SAMPLE_BANDS).astype(np.intp))
    return np.add.outer(tops, np.arange(rows)).ravel()


def _bend(read: _AxisReading, sines: Sequence[Sine]) -> Bend:
    """Harmonics of the coarse phase in what it misses the next sine by; what is left beyond the noise."""
    if read.coarse_phase is None or len(sines) < 2 or not read.told.any():
        return Bend()
    missed, allowed, phase = (
        image[read.told].astype(np.float64) for image in (read.missed, read.allowed, read.coarse_phase)
    )
    every = max(len(missed) // MOST_PIXELS_TO_FIT, 1)
    missed, allowed, phase = missed[::every], allowed[::every], phase[::every]
    terms = np.concatenate([np.ones((1, len(phase))), harmonics(phase, CUE_HARMONICS)])
    coefficients: FloatArray = np.zeros(len(terms))
    weight = 1 / np.sqrt(allowed + np.median(allowed))
    for _ in range(3):
        left = missed - coefficients @ terms
        scatter = MAD_TO_SIGMA * float(np.median(np.abs(left)))
        inlier = (np.abs(left) <= 3 * scatter) * weight
        weighted: FloatArray = terms * inlier
        normal: FloatArray = weighted @ weighted.T
        steady: FloatArray = RIDGE * float(np.sum(np.diagonal(normal))) * np.eye(len(terms))
        coefficients = np.asarray(np.linalg.solve(normal + steady, weighted @ (missed * inlier)), np.float64)
    left = missed - coefficients @ terms
    excess = (MAD_TO_SIGMA * float(np.median(np.abs(left)))) ** 2 - float(np.median(allowed))
    return Bend(coefficients, max(excess, 0.0))


def _steps(own: _AxisReading, rows: int) -> NDArray[np.float32]:
    """Differences of the two neighbours along rows and along columns of strips of `rows`, whichever are larger."""
    px = np.where(own.lit & ~own.saturated & own.trusted, own.px, np.nan).reshape(-1, rows, own.px.shape[1])
    along, across = np.abs(px[..., 2:] - px[..., :-2]).ravel(), np.abs(px[:, 2:] - px[:, :-2]).ravel()
    along, across = along[np.isfinite(along)], across[np.isfinite(across)]
    if not (len(along) and len(across)):
        return along if len(along) else across
    return along if np.median(along) > np.median(across) else across
