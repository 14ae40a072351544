"""A capture to points: which pixels to believe, and the reasons against the others.

Band of rows by band, each small enough for the processor's cache; planes are fitted to the edges of all bands.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import reduce

import cv2
import numpy as np
from numpy.typing import NDArray

from retrue.decoding.gray.bits import CodeImage, decode_axis
from retrue.decoding.gray.plan import MAX_CELL, UNDECIDED, Plan
from retrue.decoding.gray.sequence import GraySequence, Stripes
from retrue.decoding.gray.stripe_edges import (
    ABOUT,
    BESIDE,
    LARGEST_MISS,
    LARGEST_RESIDUAL,
    Edges,
    FloatImage,
    PlaneFit,
    PlaneFitter,
    find_edges,
)
from retrue.geometry.arrays import BoolArray, FloatArray, Image
from retrue.kernels import stripes as kernel

FARTHEST_CODE = 0.75
"""Stripes: a pixel's own code is within half a stripe of the plane, and a little for noise."""

REACH_CELLS = 13
"""How many cells away a picture can still change where a point is: windows, the edges beside them, and the bend."""


@dataclass(frozen=True, slots=True)
class Depth:
    """A code down to some bit, how to read it, and how many of the finest stripes one of its stripes is wide."""

    sequence: GraySequence
    plan: Plan
    width: int = 1


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """The points of a band of rows: (N,) flat index into the band of each, ascending, its sub-pixel coordinates by
    axis of the projector, the standard deviation of either, their root mean square, and that of x over that of y;
    None of one axis."""

    pixels: NDArray[np.intp]
    projector_px: dict[int, FloatArray]
    sigma_px: FloatArray
    sigma_ratio: FloatArray | None

    def none(self) -> Found:
        """Without points."""
        px = {axis: own[:0] for axis, own in self.projector_px.items()}
        return Found(self.pixels[:0], px, self.sigma_px[:0], None if self.sigma_ratio is None else self.sigma_ratio[:0])

    def placed(self, width: int, left: int, whole: int) -> Found:
        """Of pictures of that width that begin at column `left` of wider ones: in these."""
        if width == whole:
            return self
        return replace(self, pixels=self.pixels + self.pixels // width * (whole - width) + left)


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """A picture at one depth.

    Attributes
    ----------
    lit, agreed, inside, certain, smooth : (height, width), of each pixel what the next rests on: it is lit, decides its
        code, which is in the projector, near enough edges tell its plane, and these lie on one surface.
    fits : of each axis of the code, the planes.
    outside, largest : for each axis, how many of the codes lie beyond the projector, and the largest of these.
    """

    lit: BoolArray
    agreed: BoolArray
    inside: BoolArray
    certain: BoolArray
    smooth: BoolArray
    fits: list[PlaneFit]
    outside: tuple[int, ...]
    largest: tuple[int, ...]


def read_depth(depth: Depth, bands: Sequence[range], threads: ThreadPoolExecutor, wanted: BoolArray | None) -> Reading:
    """All of a picture at one depth, or what `wanted` of its pixels need; bands start at multiples of MAX_CELL."""
    shape, axes = depth.sequence.white.shape, range(len(depth.sequence.stripes))
    lit, agreed, inside, certain, smooth = (np.zeros(shape, np.bool_) for _ in range(5))
    codes = [np.empty(shape, np.int16) for _ in axes]
    fitters = [
        PlaneFitter(shape, cell, along, min(LARGEST_RESIDUAL / depth.width, LARGEST_MISS / cell))
        for cell, along in zip(depth.plan.cells, depth.plan.along, strict=True)
    ]
    needed = None if wanted is None else _around(wanted, REACH_CELLS * max(depth.plan.cells))

    def look(rows: range) -> tuple[list[Edges], list[tuple[int, int]]]:
        here = slice(rows.start, rows.stop)
        seen = _look(depth, rows, needed)
        lit[here], agreed[here], inside[here] = seen.lit, seen.agreed, seen.inside
        for axis in axes:
            codes[axis][here] = seen.codes[axis]
            fitters[axis].add(rows, seen.edges[axis])
        return seen.edges, seen.beyond

    def fit(rows: range, edges: Sequence[Edges]) -> None:
        for fitter, own in zip(fitters, edges, strict=True):
            fitter.fit(rows, own)

    def judge(rows: range) -> None:
        for fitter in fitters:
            fitter.judge(rows)

    seen = list(threads.map(look, bands))
    list(threads.map(fit, bands, [edges for edges, _ in seen]))
    list(threads.map(judge, bands))
    fits = list(threads.map(PlaneFitter.fitted, fitters))

    def accept(rows: range) -> None:
        here = slice(rows.start, rows.stop)
        certain[here], smooth[here] = inside[here], inside[here]
        for code, fit in zip(codes, fits, strict=True):
            kernel.accept(
                code[here],
                fit.planes,
                fit.sure,
                fit.even,
                rows.start // fit.cell,
                fit.cell,
                fit.along,
                FARTHEST_CODE,
                certain[here].view(np.uint8),
                smooth[here].view(np.uint8),
            )

    list(threads.map(accept, bands))
    outside = tuple(sum(beyond[axis][0] for _, beyond in seen) for axis in axes)
    largest = tuple(max(beyond[axis][1] for _, beyond in seen) for axis in axes)
    return Reading(lit, agreed, inside, certain, smooth, fits, outside, largest)


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """The rows of a band alone; `beyond`: for each axis as `Reading` has outside and largest."""

    lit: BoolArray
    agreed: BoolArray
    inside: BoolArray
    codes: list[CodeImage]
    edges: list[Edges]
    beyond: list[tuple[int, int]]


def lit_columns(depth: Depth, rows: range) -> tuple[int, BoolArray]:
    """How many pixels of a band are lit, and (width,) which columns hold one that is so with all around it."""
    lit = _light(depth, slice(rows.start, rows.stop))[2]
    inner = cv2.erode(lit.view(np.uint8), np.ones((3, 3), np.uint8))
    return int(np.count_nonzero(lit)), cv2.dilate(inner.max(axis=0)[None], np.ones((1, 3), np.uint8))[0].astype(
        np.bool_
    )


def _light(depth: Depth, rows: slice) -> tuple[FloatImage, FloatImage, BoolArray]:
    """White less black, the noise of a picture less its inverse, and which pixels are lit."""
    white, black = _rows((depth.sequence.white, depth.sequence.black), rows)
    contrast, noise = (np.empty(white.shape, np.float32) for _ in range(2))
    lit: BoolArray = np.empty(white.shape, np.bool_)
    kernel.light(white, black, depth.plan.noise_gain, UNDECIDED, contrast, noise, lit.view(np.uint8))
    return contrast, noise, lit


def _look(depth: Depth, rows: range, needed: BoolArray | None) -> _Seen:
    sequence, plan = depth.sequence, depth.plan
    above, below = ABOUT if any(bias.any() for bias in plan.edge_biases) else BESIDE
    top, bottom = max(rows.start - above, 0), min(rows.stop + below, sequence.white.shape[0])
    around, inner = slice(top, bottom), slice(rows.start - top, rows.stop - top)
    contrast, noise, lit = _light(depth, around)
    where = lit if needed is None else lit & needed[around]
    axes = [
        decode_axis(_rows(patterns, around), _rows(inverses, around), along, where)
        for patterns, inverses, along in zip(sequence.patterns, sequence.inverses, plan.along, strict=True)
    ]
    agreed, within = where.copy(), [np.empty_like(where) for _ in axes]
    for axis, stripes, own in zip(axes, sequence.stripes, within, strict=True):
        codes = max(stripes.first, -1), min(stripes.last, np.iinfo(np.int16).max)
        kernel.believe(
            axis.second_margin, axis.code, noise, UNDECIDED, codes, agreed.view(np.uint8), own.view(np.uint8)
        )
    inside = reduce(np.logical_and, within, agreed)
    beyond: list[tuple[int, int]] = []
    for axis, own in zip(axes, within, strict=True):
        count = int(np.count_nonzero((agreed & ~own)[inner]))
        beyond.append((count, int(axis.code[inner][agreed[inner]].max(initial=0)) if count else 0))
    edges = [
        find_edges(axis, contrast, noise, inside, inner, along, bias)
        for axis, along, bias in zip(axes, plan.along, plan.edge_biases, strict=True)
    ]
    return _Seen(lit[inner], agreed[inner], inside[inner], [axis.code[inner] for axis in axes], edges, beyond)


def _around(wanted: BoolArray, reach: int) -> BoolArray:
    """Every pixel that may change a wanted one, and some more: in whole blocks."""
    height, width = wanted.shape
    blocks = -(-height // MAX_CELL), -(-width // MAX_CELL)
    padded = np.zeros((blocks[0] * MAX_CELL, blocks[1] * MAX_CELL), np.bool_)
    padded[:height, :width] = wanted
    words = padded.view(np.uint64).reshape(blocks[0], MAX_CELL, blocks[1], -1)
    spread = (np.bitwise_or.reduce(words, axis=(1, 3)) > 0).view(np.uint8)
    side = 2 * -(-reach // MAX_CELL) + 1
    spread = cv2.dilate(spread, np.ones((side, side), np.uint8))
    whole = np.repeat(np.repeat(spread, MAX_CELL, axis=0), MAX_CELL, axis=1)
    return whole[:height, :width].view(np.bool_)


def locate(stripes: Sequence[Stripes], reading: Reading, rows: range, good: BoolArray) -> Found:
    """The points of a band (height, width) of `good` pixels, along each axis."""
    pixels = np.flatnonzero(good[rows.start : rows.stop])
    width = stripes[0].width_px
    found = [np.empty(len(pixels)) for _ in stripes]
    variances = [np.empty(len(pixels), np.float32) for _ in stripes]
    for axis, fit, px, variance in zip(stripes, reading.fits, found, variances, strict=True):
        kernel.coordinates(
            pixels,
            fit.planes,
            fit.error,
            (good.shape[1], rows.start),
            fit.cell,
            fit.along,
            0.5 + axis.offset_px / axis.width_px,
            axis.width_px,
            px,
            variance,
        )
        variance *= np.float32((axis.width_px / width) ** 2)
    sigma = np.sqrt(np.stack(variances).mean(axis=0)) * np.float64(width)
    by_axis = {axis.axis: own for axis, own in zip(stripes, variances, strict=True)}
    ratio = np.sqrt(by_axis[0] / by_axis[1]) if len(by_axis) == 2 else None
    return Found(pixels, {axis.axis: px for axis, px in zip(stripes, found, strict=True)}, sigma, ratio)


def _rows(images: Sequence[Image], rows: slice) -> list[Image]:
    """Of each picture, which may be cut from a larger one."""
    return [np.ascontiguousarray(image[rows]) for image in images]
