"""Gray-code captures to sub-pixel correspondences: pairs -> stripes -> edges -> planes through the edges."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from retrue.correspondences import Correspondences
from retrue.decoding.gray_bits import decode_axis, neighbours
from retrue.decoding.gray_sequence import GraySequence, arrange
from retrue.decoding.gray_subpixel import FloatImage, Window, find_edges, fit_planes
from retrue.geometry.arrays import BoolArray, Image
from retrue.patterns.gray_code import GrayCode

BAND_ROWS = 128
UNDECIDED = 3.0
"""A bit is decided when pattern and inverse differ by this many standard deviations."""
LARGEST_RESIDUAL = 0.3
"""Stripes: edges that scatter more about their plane belong to several surfaces, or to none."""
LARGEST_SIGMA = 0.1
"""Stripes: above it, too few edges or all to one side."""


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """The points of a band of rows, and why its other lit pixels are none."""

    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    stripes: tuple[FloatImage, FloatImage]
    sigma: FloatImage
    counts: dict[str, int]


@dataclass(frozen=True, slots=True)
class Reading:
    """How to read a capture: the window, along which axis to look for edges, and the noise."""

    noise_gain: float
    along: tuple[int, int]
    windows: tuple[Window, Window]


def decode_gray_code(pattern: GrayCode, images: Sequence[Image], names: Sequence[str] | None = None) -> Correspondences:
    names = list(names) if names is not None else [f"picture {i + 1}" for i in range(len(images))]
    sequence = arrange(pattern, images, names)
    reading = _plan(sequence)
    height, width = sequence.white.shape
    starts = range(0, height, BAND_ROWS)
    with ThreadPoolExecutor(2) as threads:
        bands = list(threads.map(lambda start: _read_band(sequence, pattern, reading, start), starts))
    return _assembled(pattern, sequence, bands)


def _plan(sequence: GraySequence) -> Reading:
    """From a sample of the rows: noise, direction of the stripes and their width in camera pixels."""
    height = sequence.white.shape[0]
    sample = np.concatenate([np.arange(s, min(s + 8, height)) for s in range(0, height, 64)])
    white, black = (im[sample].astype(np.float32) for im in (sequence.white, sequence.black))
    sums = [
        p[sample].astype(np.float32) + i[sample]
        for p, i in zip(sequence.patterns[1][:2], sequence.inverses[1][:2], strict=True)
    ]
    mean = np.maximum(0.5 * (white + black), 1)
    lit = white - black > 0.1 * float(np.max(white - black))
    gain = float(np.median(np.square(sums[0] - sums[1])[lit] / mean[lit])) / 4 / 0.455
    along: list[int] = []
    windows: list[Window] = []
    for axis in range(2):
        p, i = ([im[sample] for im in group[axis]] for group in (sequence.patterns, sequence.inverses))
        shares: list[float] = []
        for direction in range(2):
            here, there = neighbours(direction)
            code = decode_axis(p, i, direction)
            change = np.abs(code.code[here] - code.code[there]) == 1
            both = lit[here] & lit[there]
            shares.append(float(np.mean(change[both])))
        along.append(int(np.argmax(shares)))
        stripe = 1 / max(max(shares), 0.02)
        windows.append(Window(float(np.clip(1.25 * stripe, 2, 24))))
    return Reading(gain, (along[0], along[1]), (windows[0], windows[1]))


def _read_band(sequence: GraySequence, pattern: GrayCode, reading: Reading, start: int) -> Band:
    halo = 2 * max(window.radius for window in reading.windows) + 2
    height = sequence.white.shape[0]
    stop = min(start + BAND_ROWS, height)
    top, bottom = max(start - halo, 0), min(stop + halo, height)
    band = slice(top, bottom)
    white, black = sequence.white[band].astype(np.float32), sequence.black[band].astype(np.float32)
    contrast = white - black
    noise = np.sqrt(np.maximum(reading.noise_gain * (white + black), 0.5))
    decided = UNDECIDED * noise
    lit = contrast > 2 * decided
    contrast = np.maximum(contrast, 1)
    inner = slice(start - top, stop - top)
    lit_count = int(np.count_nonzero(lit[inner]))
    codes = [
        decode_axis([im[band] for im in p], [im[band] for im in i], along)
        for p, i, along in zip(sequence.patterns, sequence.inverses, reading.along, strict=True)
    ]
    agreed = lit
    for axis in codes:
        agreed = agreed & (axis.second_margin > decided)
    inside = agreed
    for axis, stripes, offset in zip(codes, pattern.stripes, pattern.offset, strict=True):
        inside = inside & (axis.code >= offset) & (axis.code < offset + stripes)
    fits = [
        fit_planes(find_edges(axis, contrast, noise, inside, along), window, along)
        for axis, along, window in zip(codes, reading.along, reading.windows, strict=True)
    ]
    smooth = inside
    certain = inside
    for axis, fit in zip(codes, fits, strict=True):
        smooth = smooth & (fit.residual < LARGEST_RESIDUAL) & (np.abs(axis.code - fit.value) < 0.75)
        certain = certain & (fit.sigma < LARGEST_SIGMA)
    valid = (smooth & certain)[inner]
    rows, columns = np.nonzero(valid)
    sigma = np.sqrt(0.5 * (fits[0].sigma[inner][valid] ** 2 + fits[1].sigma[inner][valid] ** 2))
    counts = {
        "lit": lit_count,
        "bits disagree": lit_count - int(np.count_nonzero(agreed[inner])),
        "outside the projector": int(np.count_nonzero((agreed & ~inside)[inner])),
        "no edges near": int(np.count_nonzero((inside & ~certain)[inner])),
        "not one surface": int(np.count_nonzero((certain & ~smooth)[inner])),
    }
    return Band(rows + start, columns, (fits[0].value[inner][valid], fits[1].value[inner][valid]), sigma, counts)


def _assembled(pattern: GrayCode, sequence: GraySequence, bands: Sequence[Band]) -> Correspondences:
    rows = np.concatenate([band.rows for band in bands])
    columns = np.concatenate([band.columns for band in bands])
    camera_px = np.empty((len(rows), 2))
    camera_px[:, 0], camera_px[:, 1] = columns, rows
    projector_px = np.empty((len(rows), 2))
    for axis in range(2):
        stripes = np.concatenate([band.stripes[axis] for band in bands]).astype(np.float64)
        projector_px[:, axis] = (stripes - pattern.offset[axis] + 0.5) * pattern.step - 0.5
    sigma = np.concatenate([band.sigma for band in bands]).astype(np.float64) * pattern.step
    return Correspondences(
        camera_px,
        projector_px,
        projector_sigma_px=sigma,
        colors=_colors(sequence.color[rows, columns]),
        cells=np.stack([rows, columns], axis=1),
        card=_card(sequence, len(rows), [band.counts for band in bands]),
    )


def _colors(pixels: Image) -> NDArray[np.uint8]:
    if pixels.dtype == np.uint16:
        pixels = (pixels >> 8).astype(np.uint8)
    return np.repeat(pixels[:, None], 3, axis=1) if pixels.ndim == 1 else pixels


def _card(sequence: GraySequence, points: int, counts: Sequence[dict[str, int]]) -> dict[str, Any]:
    total = {key: sum(count[key] for count in counts) for key in counts[0]}
    pixels = sequence.white.size
    lit = total.pop("lit")
    return {"pixels": pixels, "lit": lit, "points": points, "coverage": points / pixels, "rejected": total}
