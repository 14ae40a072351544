"""A band of rows of a capture to points: which pixels to believe, and the reasons against the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import cv2
import numpy as np
from numpy.typing import NDArray

from retrue.decoding.gray.bits import decode_axis
from retrue.decoding.gray.plan import MAX_CELL, UNDECIDED, Plan
from retrue.decoding.gray.sequence import GraySequence
from retrue.decoding.gray.stripe_edges import LARGEST_RESIDUAL, LARGEST_SIGMA, PlaneFit, find_edges, fit_planes
from retrue.geometry.arrays import BoolArray, FloatArray, Image
from retrue.kernels import stripes as kernel

FARTHEST_CODE = 0.75
"""Stripes: a pixel's own code is within half a stripe of the plane, and a little for noise."""
SYSTEMATIC_SIGMA = 0.005
"""Stripes: what lens and camera leave, however many edges there are and however flat the surface."""

HALO_CELLS = 13
"""How many cells away a picture can still change a point: windows, the edges beside them, and the bend around it."""
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
    """The rows of a band at one depth: masks of its pixels, and for each axis the planes of the cells around it.

    `fits` know the rows from `above` rows over the band, and the columns from `left` on; none where nothing is inside.
    """

    lit: BoolArray
    agreed: BoolArray
    inside: BoolArray
    certain: BoolArray
    smooth: BoolArray
    fits: list[PlaneFit]
    above: int
    left: int
    outside: tuple[int, ...]
    largest: tuple[int, ...]


def read_band(depths: Sequence[Depth], rows: range) -> Band:
    """The points of those rows; rows around them are looked at too, so that bands fit together seamlessly.

    A pixel is read at the first of the depths that it resolves. `rows` starts at a multiple of MAX_CELL.
    """
    first = _read(depths[0], rows, None)
    good = first.certain & first.smooth
    pixels = [np.flatnonzero(good)]
    found = [_coordinates(depths[0], first, pixels[0])]
    unread = first.lit & ~good & (first.inside | ~first.agreed) & (first.smooth | ~first.certain)
    taken = good
    for depth in depths[1:]:
        if _count(unread) < FEWEST_OPEN:
            break
        reading = _read(depth, rows, unread)
        good = reading.certain & reading.smooth & unread
        pixels.append(np.flatnonzero(good))
        found.append(_coordinates(depth, reading, pixels[-1]))
        unread, taken = unread & ~good, taken | good
    everything = np.concatenate(pixels)
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


def _read(depth: Depth, rows: range, wanted: BoolArray | None) -> _Reading:
    """All of a band, or what `wanted` of its pixels need."""
    sequence, plan = depth.sequence, depth.plan
    halo = HALO_CELLS * max(plan.cells)
    top, bottom = max(rows.start - halo, 0), min(rows.stop + halo, sequence.white.shape[0])
    around, inner = slice(top, bottom), slice(rows.start - top, rows.stop - top)
    contrast, noise = (np.empty((bottom - top, sequence.white.shape[1]), np.float32) for _ in range(2))
    lit: BoolArray = np.empty(contrast.shape, np.bool_)
    white, black = _rows((sequence.white, sequence.black), around)
    kernel.light(white, black, plan.noise_gain, UNDECIDED, contrast, noise, lit.view(np.uint8))
    where = lit if wanted is None else lit & _around(wanted, inner.start, lit.shape[0], halo)

    axes = [
        decode_axis(_rows(patterns, around), _rows(inverses, around), along, where)
        for patterns, inverses, along in zip(sequence.patterns, sequence.inverses, plan.along, strict=True)
    ]
    decided = noise * np.float32(UNDECIDED)
    agreed = reduce(np.logical_and, [axis.second_margin > decided for axis in axes], where)
    within = [
        (axis.code >= stripes.first) & (axis.code <= stripes.last)
        for axis, stripes in zip(axes, sequence.stripes, strict=True)
    ]
    inside = reduce(np.logical_and, within, agreed)
    outside = tuple(_count((agreed & ~codes)[inner]) for codes in within)
    beyond = tuple(
        int(axis.code[agreed].max(initial=0)) if count else 0 for axis, count in zip(axes, outside, strict=True)
    )
    certain, smooth = inside.copy(), inside.copy()
    fits: list[PlaneFit] = []
    columns = _filled_columns(inside)
    for axis, along, cell in zip(axes, plan.along, plan.cells, strict=True) if inside.any() else ():
        fit = fit_planes(find_edges(axis, contrast, noise, inside, columns, along, cell), along)
        fits.append(fit)
        kernel.accept(
            axis.code,
            fit.planes,
            (fit.variance < LARGEST_SIGMA**2).view(np.uint8),
            (fit.mean_square < LARGEST_RESIDUAL**2).view(np.uint8),
            (columns.start, columns.stop),
            cell,
            along,
            FARTHEST_CODE,
            certain.view(np.uint8),
            smooth.view(np.uint8),
        )
    return _Reading(
        lit[inner],
        agreed[inner],
        inside[inner],
        certain[inner],
        smooth[inner],
        fits,
        inner.start,
        columns.start,
        outside,
        beyond,
    )


def _around(wanted: BoolArray, above: int, height: int, halo: int) -> BoolArray:
    """Every pixel of `height` rows, of which `wanted` begins `above` rows down, that may change a wanted one."""
    width = wanted.shape[1]
    blocks = -(-height // MAX_CELL), -(-width // MAX_CELL)
    padded = np.zeros((blocks[0] * MAX_CELL, blocks[1] * MAX_CELL), np.bool_)
    padded[above : above + len(wanted), :width] = wanted
    words = padded.view(np.uint64).reshape(blocks[0], MAX_CELL, blocks[1], -1)
    spread = (np.bitwise_or.reduce(words, axis=(1, 3)) > 0).view(np.uint8)
    reach = -(-halo // MAX_CELL)
    spread = cv2.dilate(spread, np.ones((2 * reach + 1, 2 * reach + 1), np.uint8))
    whole = np.repeat(np.repeat(spread, MAX_CELL, axis=0), MAX_CELL, axis=1)
    return whole[:height, :width].view(np.bool_)


def _filled_columns(inside: BoolArray) -> slice:
    """From the first to the last column of a mask in whole cells of any size; all of them where that saves little."""
    filled, width = np.flatnonzero(inside.any(axis=0)), inside.shape[1]
    if not len(filled):
        return slice(0, width)
    start, stop = int(filled[0]) // MAX_CELL * MAX_CELL, min((int(filled[-1]) // MAX_CELL + 1) * MAX_CELL, width)
    return slice(start, stop) if stop - start < WORTH_CUTTING * width else slice(0, width)


def _coordinates(depth: Depth, reading: _Reading, pixels: NDArray[np.intp]) -> tuple[list[FloatArray], FloatArray]:
    """Projector coordinates (N,) along each axis, and their standard deviation."""
    axes = depth.sequence.stripes
    width = axes[0].width_px
    found = [np.empty(len(pixels)) for _ in axes]
    variances = [np.empty(len(pixels), np.float32) for _ in axes]
    for stripes, fit, px, variance in zip(axes, reading.fits, found, variances, strict=len(pixels) > 0):
        centre = 0.5 + stripes.offset_px / stripes.width_px
        kernel.coordinates(
            pixels,
            fit.planes,
            fit.error,
            (reading.lit.shape[1], reading.above, reading.left),
            fit.cell,
            fit.along,
            centre,
            stripes.width_px,
            px,
            variance,
        )
        variance *= np.float32((stripes.width_px / width) ** 2)
    return found, np.sqrt(np.stack(variances).mean(axis=0) + np.float64(SYSTEMATIC_SIGMA**2)) * width


def _rows(images: Sequence[Image], rows: slice) -> list[Image]:
    """Of each picture, which may be cut from a larger one."""
    return [np.ascontiguousarray(image[rows]) for image in images]


def _count(mask: BoolArray) -> int:
    return int(np.count_nonzero(mask))
