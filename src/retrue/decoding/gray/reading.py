"""A band of rows of a capture to points: which pixels to believe, and the reasons against the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from retrue.decoding.gray.bits import decode_axis
from retrue.decoding.gray.plan import UNDECIDED, Plan, noise_of_difference
from retrue.decoding.gray.sequence import GraySequence
from retrue.decoding.gray.stripe_edges import FloatImage, find_edges, fit_planes
from retrue.geometry.arrays import BoolArray, Image
from retrue.patterns.gray_code import GrayCode

LARGEST_RESIDUAL = 0.25
"""Stripes, RMS: edges that scatter more about their plane belong to several surfaces, or to none."""
LARGEST_SIGMA = 0.05
"""Stripes: above it, too few edges, or all of them to one side."""
FARTHEST_CODE = 0.75
"""Stripes: a pixel's own code is within half a stripe of the plane, and a little for noise."""

HALO_CELLS = 8
"""How many cells away a picture can still change a point: the window, the edges beside it, and their own window."""


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """The points of a band of rows, and how many of its pixels are none, by reason.

    Attributes
    ----------
    rows, columns : (N,) camera pixels.
    stripes : for each axis of the code, (N,) sub-pixel n.
    variance : (N,) mean of both axes, in stripes^2.
    counts : pixels by reason.
    outside, largest : for each axis of the code, how many trusted codes lie beyond the projector, and the largest.
    """

    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    stripes: tuple[FloatImage, FloatImage]
    variance: FloatImage
    counts: dict[str, int]
    outside: tuple[int, int]
    largest: tuple[int, int]


def read_band(sequence: GraySequence, pattern: GrayCode, plan: Plan, rows: range) -> Band:
    """The points of those rows; rows around them are looked at too, so that bands fit together seamlessly.

    `rows` starts at a multiple of MAX_CELL.
    """
    halo = HALO_CELLS * max(plan.cells)
    top, bottom = max(rows.start - halo, 0), min(rows.stop + halo, sequence.white.shape[0])
    around, inner = slice(top, bottom), slice(rows.start - top, rows.stop - top)
    white, black = sequence.white[around].astype(np.float32), sequence.black[around].astype(np.float32)
    contrast, noise = white - black, noise_of_difference(plan.noise_gain, white + black)
    decided = noise * np.float32(UNDECIDED)
    lit = contrast > 2 * decided
    np.maximum(contrast, 1, out=contrast)

    axes = [
        decode_axis(_rows(patterns, around), _rows(inverses, around), along)
        for patterns, inverses, along in zip(sequence.patterns, sequence.inverses, plan.along, strict=True)
    ]
    agreed = lit & (axes[0].second_margin > decided) & (axes[1].second_margin > decided)
    within = [
        (axis.code >= offset) & (axis.code < offset + stripes)
        for axis, stripes, offset in zip(axes, pattern.stripes, pattern.offset, strict=True)
    ]
    inside = agreed & within[0] & within[1]
    fits = [
        fit_planes(find_edges(axis, contrast, noise, inside, along, cell), along)
        for axis, along, cell in zip(axes, plan.along, plan.cells, strict=True)
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
        "agreed": _count(agreed[inner]),
        "outside": _count((agreed & ~inside)[inner]),
        "alone": _count((inside & ~certain)[inner]),
        "rough": _count((certain & ~smooth)[inner]),
    }
    stripe_x, stripe_y = (np.take(fit.value[inner], pixels) for fit in fits)
    variance = np.stack([np.take(fit.pixels(fit.variance)[inner], pixels) for fit in fits]).mean(axis=0)
    outside = [_count((agreed & ~codes)[inner]) for codes in within]
    largest = [
        int(axis.code[agreed].max(initial=0)) if beyond else 0 for axis, beyond in zip(axes, outside, strict=True)
    ]
    return Band(
        y + rows.start,
        x,
        (stripe_x, stripe_y),
        variance,
        counts,
        (outside[0], outside[1]),
        (largest[0], largest[1]),
    )


def _rows(images: Sequence[Image], rows: slice) -> list[Image]:
    return [image[rows] for image in images]


def _count(mask: BoolArray) -> int:
    return int(np.count_nonzero(mask))
