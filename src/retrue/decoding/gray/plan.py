"""How to read a Gray-code capture, from a sample of its pixels: noise, direction and width of the stripes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from retrue.decoding.gray.bits import CodeImage, decode_axis, neighbours
from retrue.decoding.gray.edge_shape import NO_BIAS, EdgeBias, edge_bias
from retrue.decoding.gray.faults import require_one_way, require_order
from retrue.decoding.gray.sequence import GraySequence
from retrue.decoding.gray.stripe_edges import MOST_STRIPES, FloatImage
from retrue.geometry.arrays import BoolArray

MAX_CELL = 32
"""Pixels: bands start at multiples of it, so that the cells of all bands lie on one grid."""
UNDECIDED = 3.0
"""Standard deviations: a bit whose pattern and inverse differ by less is undecided."""
LIT = 0.1
"""Of the strongest contrast: pixels to learn the noise from."""
STRIPS, STRIP_WIDTH = 8, 4
FEWEST_EDGES = 30
"""Of coarse bits, that tell how steep edges are."""
SEEN_EDGES = 0.1
"""Of neighbours across stripes narrower than a pixel: of those nearly two stripes apart some are one, and enough."""
CHI_SQUARE_MEDIAN = 0.455
LEAST_SEEN = 0.5
"""Of the pixels of good contrast, that are lit beyond the noise of bits which tell it."""
FEWEST_PATTERNS = 3
"""Without inverses, to see noise in how they scatter."""


@dataclass(frozen=True, slots=True)
class Plan:
    """What the pictures themselves tell about how to read them.

    Attributes
    ----------
    noise_gain : variance of a picture's noise per unit of brightness (shot noise).
    resolved : share of the lit pixels that decide their code.
    along : for each axis of the code, the array axis along which its stripes follow each other more quickly.
    cells : for each axis of the code, the power of two (2 to MAX_CELL) nearest to a stripe's width in camera pixels.
    edge_biases : for each axis of the code, what straight lines between pixels miss its edges by.
    narrow : whether an axis has stripes so narrow that hardly any neighbours are one apart.
    """

    noise_gain: float
    resolved: float
    narrow: bool
    along: tuple[int, ...]
    cells: tuple[int, ...]
    edge_biases: tuple[EdgeBias, ...]


@dataclass(frozen=True, slots=True)
class _AxisPlan:
    """How to read one axis; `resolved` : the share of lit pixels that decide it; `narrow` : as `Plan` has it."""

    along: int
    cell: int
    resolved: float
    narrow: bool
    edge_bias: EdgeBias


@dataclass(frozen=True, slots=True, eq=False)
class _Neighbours:
    """Trusted pixels of strips and the next along the strips, N pairs.

    Attributes
    ----------
    code, beyond : (N,) codes of the first and of the second.
    steepness : (N,) the sum of both margins, in shares of the contrast.
    resolved : share of the lit pixels that decide their code.
    """

    code: CodeImage
    beyond: CodeImage
    steepness: FloatImage
    resolved: float


def plan_reading(sequence: GraySequence, *, finest: bool = True) -> Plan:
    """From strips of rows and of columns. Raises `CaptureError` where bits are not in the pattern's order."""
    return plan_strips(cut_strips(sequence), finest=finest)


def plan_strips(strips: Sequence[GraySequence], *, finest: bool = True) -> Plan:
    """The same of strips that are cut already; whether a code folds is asked of the `finest` stripes: of a few wide
    ones no more edges may be seen than jumps from surface to surface."""
    noise_gain = _noise_gain(strips[1])
    axes = [_plan_axis(strips, axis, noise_gain, finest) for axis in range(len(strips[0].stripes))]
    return Plan(
        noise_gain,
        min(own.resolved for own in axes),
        any(own.narrow for own in axes),
        tuple(own.along for own in axes),
        tuple(own.cell for own in axes),
        tuple(own.edge_bias for own in axes),
    )


def cut_strips(sequence: GraySequence) -> tuple[GraySequence, GraySequence]:
    """Narrow strips, side by side, that run the whole length of the pictures along either array axis."""
    every = slice(None)
    down, aside = (_lines(sequence.white.shape[1 - along]) for along in range(2))
    return sequence.part(every, down), sequence.part(aside, every)


def noise_of_difference(noise_gain: float, brightness: FloatImage) -> FloatImage:
    """Standard deviation of pattern - inverse where white + black is `brightness`; rounding leaves some, too."""
    return np.sqrt(np.maximum(np.float32(noise_gain) * brightness, np.float32(0.5)))


def _plan_axis(strips: Sequence[GraySequence], axis: int, noise_gain: float, finest: bool) -> _AxisPlan:
    seen = [_neighbours(sequence, axis, along, noise_gain) for along, sequence in enumerate(strips)]
    apart = [np.abs(pairs.beyond - pairs.code) for pairs in seen]
    steps = [float(np.count_nonzero(own == 1)) / max(len(own), 1) for own in apart]
    along = 0 if steps[0] > steps[1] else 1
    pairs = seen[along]
    name = ("column", "row")[strips[0].stripes[axis].axis]
    narrow = any(_narrow(own) for own in apart)
    if not narrow:
        require_order(pairs.code, pairs.beyond, strips[0].names[axis], name)
    if finest and not narrow:
        require_one_way([(own.code, own.beyond) for own in seen], name)
    stripe = 1 / max(steps[along], 1 / MAX_CELL)
    cell = min(max(2 ** round(math.log2(stripe)), 2), MAX_CELL)
    return _AxisPlan(along, cell, pairs.resolved, narrow, _edge_bias(pairs, apart[along]))


def _narrow(apart: CodeImage) -> bool:
    """Whether neighbours are some stripes apart, and hardly any one: what order bits have, wider stripes tell."""
    if len(apart) < FEWEST_EDGES:
        return False
    seen = int(np.count_nonzero(apart == 1))
    return 1 < float(np.median(apart)) <= MOST_STRIPES and seen < SEEN_EDGES * len(apart)


def _neighbours(sequence: GraySequence, axis: int, along: int, noise_gain: float) -> _Neighbours:
    """Along an array axis."""
    read = decode_axis(sequence.patterns[axis], sequence.inverses[axis], along)
    white, black = sequence.white.astype(np.float32), sequence.black.astype(np.float32)
    decided = np.float32(UNDECIDED) * noise_of_difference(noise_gain, white + black)
    contrast = white - black
    lit = contrast > 2 * decided
    good = lit & (read.second_margin > decided)
    here, there = neighbours(along)
    both = good[here] & good[there]
    steepness = read.near[here][both] / contrast[here][both] + read.far[here][both] / contrast[there][both]
    share = float(np.count_nonzero(good)) / max(int(np.count_nonzero(lit)), 1)
    return _Neighbours(read.code[here][both], read.code[there][both], steepness.astype(np.float32), share)


def _edge_bias(pairs: _Neighbours, apart: CodeImage) -> EdgeBias:
    """Of pairs `apart` so many stripes."""
    near = apart <= MOST_STRIPES
    behind = np.maximum(pairs.code, pairs.beyond)
    coarse = (apart == 1) & (behind % 4 == 0)  # where neither bit 0 nor bit 1 changes
    if np.count_nonzero(coarse) < FEWEST_EDGES:
        return NO_BIAS
    return edge_bias(1 / float(apart[near].mean()), float(np.median(pairs.steepness[coarse])))


def _noise_gain(strips: GraySequence) -> float:
    """Pattern + inverse is the same for every bit, but for the noise of four pictures; of the finest two bits.

    Where that leaves hardly any pixel lit it is no noise: the camera's curve makes two halves of blurred stripes more
    than their sum, and coarser bits are asked.

    Without inverses: what the coarsest patterns differ from white, and what from black, as strayed light has its part
    in it; but no less than the scatter of all, since white and black may be made of them. What stands for the
    difference of pattern and inverse, 2 pattern - white - black, has three times the variance of a true one.
    """
    axis = int(np.argmax([len(patterns) for patterns in strips.patterns]))
    white, black = strips.white.astype(np.float32), strips.black.astype(np.float32)
    lit = white - black > LIT * float((white - black).max())
    if not strips.paired:
        pattern = strips.patterns[axis][0].astype(np.float32)
        bright = np.abs(white - pattern) < np.abs(pattern - black)
        gains = np.square(pattern - np.where(bright, white, black)) / np.maximum(white + black, 1)
        halves = [own for mask in (lit & bright, lit & ~bright) if len(own := gains[mask])]
        apart = float(sum(np.median(own) for own in halves)) / (2 * CHI_SQUARE_MEDIAN)
        coarse = [pattern for patterns in strips.patterns for pattern in patterns[: max(len(patterns) - 2, 1)]]
        return 3 * max(apart, _scatter(np.stack(coarse).astype(np.float32), (white + black) / np.float32(2), lit))
    pairs = list(zip(strips.patterns[axis], strips.inverses[axis], strict=True))
    total, gain = white + black, 0.0
    for finest in range(len(pairs), 1, -2):
        first, second = (pattern.astype(np.float32) + inverse for pattern, inverse in pairs[finest - 2 : finest])
        gains = np.square(first - second)[lit] / np.maximum(total, 1)[lit]
        gain = float(np.median(gains)) / (2 * CHI_SQUARE_MEDIAN) if len(gains) else 0.0
        seen = (white - black)[lit] > 2 * UNDECIDED * noise_of_difference(gain, total[lit])
        if not len(seen) or seen.mean() > LEAST_SEEN:
            break
    return gain


def _scatter(patterns: FloatImage, middle: FloatImage, lit: BoolArray) -> float:
    """Variance of a picture's noise over brightness, from (K, height, width) patterns, bright or dark about the middle.

    Of each pixel: how it is off the means of both, over the K - 2 that are left to differ; less what the next pixel is,
    since light that strays through the scene differs from pattern to pattern, but hardly from pixel to pixel.
    """
    both = lit[:, :-1] & lit[:, 1:]
    if len(patterns) < FEWEST_PATTERNS or not both.any():
        return 0.0
    bright, off = patterns > middle, patterns.copy()
    for own in (bright, ~bright):
        off -= own * (np.sum(patterns, axis=0, where=own) / np.maximum(own.sum(axis=0), 1))
    squares = np.sum(np.square(np.diff(off, axis=2)), axis=0)[both] / 2
    return float(np.median(squares / np.maximum(middle[:, :-1][both], 1))) / (len(patterns) - 2)


def _lines(side: int) -> NDArray[np.intp]:
    """Numbers of the rows, or columns, of strips."""
    starts = ((np.arange(STRIPS) + 0.5) / STRIPS * (side - STRIP_WIDTH)).astype(np.intp)
    return np.unique(np.clip(starts[:, None] + np.arange(STRIP_WIDTH), 0, side - 1))
