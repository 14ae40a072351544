"""A band of rows of a capture to points: which pixels to believe, and the reasons against the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from retrue.decoding.gray.bits import decode_axis
from retrue.decoding.gray.plan import MAX_CELL, UNDECIDED, Plan, noise_of_difference
from retrue.decoding.gray.sequence import GraySequence
from retrue.decoding.gray.stripe_edges import LARGEST_RESIDUAL, FloatImage, find_edges, fit_planes
from retrue.geometry.arrays import BoolArray, FloatArray, Image

LARGEST_SIGMA = 0.05
"""Stripes: above it, too few edges, or all of them to one side."""
FARTHEST_CODE = 0.75
"""Stripes: a pixel's own code is within half a stripe of the plane, and a little for noise."""
SYSTEMATIC_SIGMA = 0.02
"""Stripes: what the lens, JPEG and the surface leave, however many edges there are."""

HALO_CELLS = 8
"""How many cells away a picture can still change a point: the window, the edges beside it, and their own window."""
WORTH_CUTTING = 0.9
"""Of the width: columns are left out where no more remain."""
FEWEST_OPEN = 64
"""Pixels of a band: fewer that one depth leaves open are not worth the next."""


@dataclass(frozen=True, slots=True)
class Depth:
    """A code down to some bit, and how to read it."""

    sequence: GraySequence
    plan: Plan


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """The points of a band of rows, and how many of its pixels are none, by reason.

    Attributes
    ----------
    pixels : (N,) flat index into the band of each point, ascending.
    projector_px : by axis of the code, (N,) sub-pixel coordinates.
    sigma_px : (N,) standard deviation of either coordinate, their mean square.
    seen : how many pixels are lit; rejected : those that are no points, by reason.
    agreed : how many decide their code; outside, largest : for each axis of the code, how many of these lie beyond the
        projector, and the largest code.
    depths : how many points were read at each depth.
    """

    pixels: NDArray[np.intp]
    projector_px: dict[int, FloatArray]
    sigma_px: FloatArray
    seen: int
    rejected: dict[str, int]
    agreed: int
    outside: tuple[int, ...]
    largest: tuple[int, ...]
    depths: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Reading:
    """The rows of a band at one depth: masks of its pixels, and for each axis sub-pixel n and its variance."""

    lit: BoolArray
    agreed: BoolArray
    inside: BoolArray
    certain: BoolArray
    smooth: BoolArray
    values: list[FloatImage]
    variances: list[FloatImage]
    outside: tuple[int, ...]
    largest: tuple[int, ...]


def read_band(depths: Sequence[Depth], rows: range) -> Band:
    """The points of those rows; rows around them are looked at too, so that bands fit together seamlessly.

    A pixel is read at the first of the depths that it resolves. `rows` starts at a multiple of MAX_CELL. Columns in
    which nothing is lit are left out.
    """
    width = depths[0].sequence.white.shape[1]
    columns = _lit_columns(depths[0], rows)
    if columns.stop - columns.start < width:
        depths = [replace(depth, sequence=depth.sequence.part(slice(None), columns)) for depth in depths]
    first = _read(depths[0], rows)
    good = first.certain & first.smooth
    pixels = [np.flatnonzero(good)]
    found = [_coordinates(depths[0], first, pixels[0])]
    unread = first.lit & ~good & (first.inside | ~first.agreed) & (first.smooth | ~first.certain)
    taken = good
    for depth in depths[1:]:
        if _count(unread) < FEWEST_OPEN:
            break
        reading = _read(depth, rows)
        good = reading.certain & reading.smooth & unread
        pixels.append(np.flatnonzero(good))
        found.append(_coordinates(depth, reading, pixels[-1]))
        unread, taken = unread & ~good, taken | good
    y, x = np.divmod(np.concatenate(pixels), columns.stop - columns.start)
    everything = y * width + x + columns.start
    order = np.argsort(everything, kind="stable") if len(pixels) > 1 else slice(None)
    rejected = {
        "undecided": first.lit & ~first.agreed,
        "outside": first.agreed & ~first.inside,
        "alone": first.inside & ~first.certain,
        "rough": first.certain & ~first.smooth,
    }
    return Band(
        everything[order],
        {
            stripes.axis: np.concatenate([px[axis] for px, _ in found])[order]
            for axis, stripes in enumerate(depths[0].sequence.stripes)
        },
        np.concatenate([sigma for _, sigma in found])[order],
        _count(first.lit),
        {reason: _count(mask & ~taken) for reason, mask in rejected.items()},
        _count(first.agreed),
        first.outside,
        first.largest,
        tuple(len(own) for own in pixels) + (0,) * (len(depths) - len(pixels)),
    )


def _lit_columns(depth: Depth, rows: range) -> slice:
    """From the first to the last column in which a pixel may be lit, whole cells of any size and one more either side.

    All of them where that saves little.
    """
    halo = HALO_CELLS * MAX_CELL
    around = slice(max(rows.start - halo, 0), rows.stop + halo)
    lit = np.flatnonzero(_lit(depth, around)[0].any(axis=0))
    width = depth.sequence.white.shape[1]
    if not len(lit):
        return slice(0, min(MAX_CELL, width))
    start, stop = max(int(lit[0]) // MAX_CELL - 1, 0) * MAX_CELL, (int(lit[-1]) // MAX_CELL + 2) * MAX_CELL
    return slice(start, min(stop, width)) if min(stop, width) - start < WORTH_CUTTING * width else slice(0, width)


def _lit(depth: Depth, rows: slice) -> tuple[BoolArray, FloatImage, FloatImage]:
    """Which pixels are, white less black, and the noise of such a difference."""
    white, black = (image[rows].astype(np.float32) for image in (depth.sequence.white, depth.sequence.black))
    contrast, noise = white - black, noise_of_difference(depth.plan.noise_gain, white + black)
    return contrast > 2 * (noise * np.float32(UNDECIDED)), contrast, noise


def _read(depth: Depth, rows: range) -> _Reading:
    sequence, plan = depth.sequence, depth.plan
    halo = HALO_CELLS * max(plan.cells)
    top, bottom = max(rows.start - halo, 0), min(rows.stop + halo, sequence.white.shape[0])
    around, inner = slice(top, bottom), slice(rows.start - top, rows.stop - top)
    lit, contrast, noise = _lit(depth, around)
    decided = noise * np.float32(UNDECIDED)
    np.maximum(contrast, 1, out=contrast)

    axes = [
        decode_axis(_rows(patterns, around), _rows(inverses, around), along)
        for patterns, inverses, along in zip(sequence.patterns, sequence.inverses, plan.along, strict=True)
    ]
    agreed = reduce(np.logical_and, [axis.second_margin > decided for axis in axes], lit)
    within = [
        (axis.code >= stripes.first) & (axis.code <= stripes.last)
        for axis, stripes in zip(axes, sequence.stripes, strict=True)
    ]
    inside = reduce(np.logical_and, within, agreed)
    fits = [
        fit_planes(find_edges(axis, contrast, noise, inside, along, cell), along)
        for axis, along, cell in zip(axes, plan.along, plan.cells, strict=True)
    ]
    certain, smooth = inside.copy(), inside.copy()
    for axis, fit in zip(axes, fits, strict=True):
        certain &= fit.pixels((fit.variance < LARGEST_SIGMA**2).view(np.uint8)).view(np.bool_)
        smooth &= fit.pixels((fit.mean_square < LARGEST_RESIDUAL**2).view(np.uint8)).view(np.bool_)
        smooth &= np.abs(axis.code - fit.value) < FARTHEST_CODE
    outside = tuple(_count((agreed & ~codes)[inner]) for codes in within)
    beyond = tuple(
        int(axis.code[agreed].max(initial=0)) if count else 0 for axis, count in zip(axes, outside, strict=True)
    )
    return _Reading(
        lit=lit[inner],
        agreed=agreed[inner],
        inside=inside[inner],
        certain=certain[inner],
        smooth=smooth[inner],
        values=[fit.value[inner] for fit in fits],
        variances=[fit.pixels(fit.variance)[inner] for fit in fits],
        outside=outside,
        largest=beyond,
    )


def _coordinates(depth: Depth, reading: _Reading, pixels: NDArray[np.intp]) -> tuple[list[FloatArray], FloatArray]:
    """Projector coordinates (N,) along each axis, and their standard deviation."""
    found: list[FloatArray] = []
    variances: list[FloatImage] = []
    width = depth.sequence.stripes[0].width_px
    for stripes, value, variance in zip(depth.sequence.stripes, reading.values, reading.variances, strict=True):
        centre = 0.5 + stripes.offset_px / stripes.width_px
        px = (np.take(value, pixels) + np.float64(centre)) * stripes.width_px
        px -= 0.5
        found.append(px)
        variances.append(np.take(variance, pixels) * np.float32((stripes.width_px / width) ** 2))
    return found, np.sqrt(np.stack(variances).mean(axis=0) + np.float64(SYSTEMATIC_SIGMA**2)) * width


def _rows(images: Sequence[Image], rows: slice) -> list[Image]:
    return [image[rows] for image in images]


def _count(mask: BoolArray) -> int:
    return int(np.count_nonzero(mask))
