"""A band of rows of a capture to points: which pixels to believe, and the reasons against the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from retrue.decoding.gray_bits import AxisCode, decode_axis, neighbours
from retrue.decoding.gray_sequence import GraySequence
from retrue.decoding.gray_subpixel import FloatImage, find_edges, fit_planes
from retrue.geometry.arrays import BoolArray, Image
from retrue.patterns.gray_code import GrayCode

UNDECIDED = 3.0
"""Standard deviations: a bit whose pattern and inverse differ by less is undecided."""
LARGEST_RESIDUAL = 0.3
"""Stripes, RMS: edges that scatter more about their plane belong to several surfaces, or to none."""
LARGEST_SIGMA = 0.1
"""Stripes: above it, too few edges, or all of them to one side."""
FARTHEST_CODE = 0.75
"""Stripes: a pixel's own code is within half a stripe of the plane, and a little for noise."""

MAX_CELL = 32
HALO_CELLS = 6
"""How many cells away a picture can still change a point: the window, the edges beside it, and their own window."""
SAMPLE_EVERY, SAMPLE_ROWS = 128, 8


@dataclass(frozen=True, slots=True)
class Reading:
    """How to read a capture, as its pictures themselves tell.

    Attributes
    ----------
    noise_gain : variance of a picture's noise per unit of brightness (shot noise).
    along : for each axis of the code, the array axis along which its stripes follow each other more quickly.
    cells : for each axis of the code, the power of two (2 to MAX_CELL) nearest to a stripe's width in camera pixels.
    """

    noise_gain: float
    along: tuple[int, int]
    cells: tuple[int, int]

    def noise(self, white: FloatImage, black: FloatImage) -> FloatImage:
        """Standard deviation of pattern - inverse; no less than rounding to integers leaves."""
        return np.sqrt(np.maximum(np.float32(self.noise_gain) * (white + black), np.float32(0.5)))


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """The points of a band of rows, and how many of its pixels are none, by reason.

    Attributes
    ----------
    rows, columns : (N,) camera pixels.
    stripes : for each axis of the code, (N,) sub-pixel n.
    variance : (N,) mean of both axes, in stripes^2.
    counts : pixels by reason.
    """

    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    stripes: tuple[FloatImage, FloatImage]
    variance: FloatImage
    counts: dict[str, int]


def plan_reading(sequence: GraySequence) -> Reading:
    """Noise, direction and width of the stripes, from a sample of the rows."""
    height = sequence.white.shape[0]
    starts = range(min(SAMPLE_EVERY // 2, height // 2), height, SAMPLE_EVERY)
    samples = [_plan_sample(sequence, slice(start, start + SAMPLE_ROWS)) for start in starts]
    gains = [sample[0] for sample in samples]
    steps, pairs = (np.sum([sample[index] for sample in samples], axis=0) for index in (1, 2))
    share = steps / np.maximum(pairs, 1)
    along = np.argmax(share, axis=1)
    stripe = 1 / np.maximum(share.max(axis=1), 1 / MAX_CELL)
    gain = float(np.nanmedian(np.concatenate([*gains, [np.nan, 0.0][:1]]))) if any(map(len, gains)) else 0.0
    return Reading(
        gain,
        (int(along[0]), int(along[1])),
        (_power_of_two(stripe[0]), _power_of_two(stripe[1])),
    )


def _plan_sample(sequence: GraySequence, rows: slice) -> tuple[NDArray[np.float32], NDArray[np.int64], NDArray[np.int64]]:
    """Noise gains of the lit pixels; steps of one stripe between neighbours, and lit pairs, by (code, array) axis."""
    white, black = sequence.white[rows].astype(np.float32), sequence.black[rows].astype(np.float32)
    contrast = white - black
    lit = contrast > 0.1 * contrast.max()
    steps, pairs = np.zeros((2, 2), np.int64), np.zeros((2, 2), np.int64)
    for axis in range(2):
        patterns, inverses = ([image[rows] for image in kind[axis]] for kind in (sequence.patterns, sequence.inverses))
        for along in range(2):
            here, there = neighbours(along)
            code = decode_axis(patterns, inverses, along).code
            both = lit[here] & lit[there]
            steps[axis, along] = np.count_nonzero((np.abs(code[there] - code[here]) == 1) & both)
            pairs[axis, along] = np.count_nonzero(both)
    return _noise_gains(sequence, rows, white + black)[lit], steps, pairs


def _noise_gains(sequence: GraySequence, rows: slice, brightness: FloatImage) -> FloatImage:
    """Pattern + inverse is the same for every bit, but for the noise of four pictures; 0.455: median of chi-square."""
    axis = int(np.argmax([len(patterns) for patterns in sequence.patterns]))
    first, second = (
        sequence.patterns[axis][bit][rows].astype(np.float32) + sequence.inverses[axis][bit][rows] for bit in (-2, -1)
    )
    return np.square(first - second) / (np.maximum(brightness, 1) * np.float32(2 * 0.455))


def read_band(sequence: GraySequence, pattern: GrayCode, reading: Reading, rows: range) -> Band:
    """The points of those rows; rows around them are looked at too, so that bands fit together seamlessly.

    `rows` starts at a multiple of MAX_CELL.
    """
    halo = HALO_CELLS * max(reading.cells)
    top, bottom = max(rows.start - halo, 0), min(rows.stop + halo, sequence.white.shape[0])
    around, inner = slice(top, bottom), slice(rows.start - top, rows.stop - top)
    white, black = sequence.white[around].astype(np.float32), sequence.black[around].astype(np.float32)
    contrast, noise = white - black, reading.noise(white, black)
    decided = noise * np.float32(UNDECIDED)
    lit = contrast > 2 * decided
    np.maximum(contrast, 1, out=contrast)

    axes = [
        decode_axis(_rows(patterns, around), _rows(inverses, around), along)
        for patterns, inverses, along in zip(sequence.patterns, sequence.inverses, reading.along, strict=True)
    ]
    agreed = lit & (axes[0].second_margin > decided) & (axes[1].second_margin > decided)
    inside = agreed.copy()
    for axis, stripes, offset in zip(axes, pattern.stripes, pattern.offset, strict=True):
        inside &= (axis.code >= offset) & (axis.code < offset + stripes)
    fits = [
        fit_planes(find_edges(axis, contrast, noise, inside, along, cell), along)
        for axis, along, cell in zip(axes, reading.along, reading.cells, strict=True)
    ]
    certain, smooth = inside.copy(), inside.copy()
    for axis, fit in zip(axes, fits, strict=True):
        certain &= fit.pixels((fit.variance < LARGEST_SIGMA**2).view(np.uint8)).view(np.bool_)
        smooth &= fit.pixels((fit.mean_square < LARGEST_RESIDUAL**2).view(np.uint8)).view(np.bool_)
        smooth &= np.abs(axis.code - fit.value) < FARTHEST_CODE

    pixels = np.flatnonzero((certain & smooth)[inner])
    y, x = np.divmod(pixels, lit.shape[1])
    counts = {
        "lit": _count(lit[inner]),
        "undecided": _count((lit & ~agreed)[inner]),
        "outside": _count((agreed & ~inside)[inner]),
        "alone": _count((inside & ~certain)[inner]),
        "rough": _count((certain & ~smooth)[inner]),
    }
    columns, rows_ = (np.take(fit.value[inner], pixels) for fit in fits)
    variance = sum(np.take(fit.pixels(fit.variance)[inner], pixels) for fit in fits)
    return Band(y + rows.start, x, (columns, rows_), variance * np.float32(0.5), counts)


def _power_of_two(width: float) -> int:
    return int(2 ** np.clip(np.round(np.log2(width)), 1, np.log2(MAX_CELL)))


def _rows(images: Sequence[Image], rows: slice) -> list[Image]:
    return [image[rows] for image in images]


def _count(mask: BoolArray) -> int:
    return int(np.count_nonzero(mask))
