"""Sequences of pictures to correspondences: each axis is read by its sines, else by its Gray code."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from retrue.correspondences import Card, Correspondences
from retrue.decoding.gray.decode_gray_code import REASONS as GRAY_REASONS
from retrue.decoding.gray.decode_gray_code import band_rows, read_gray
from retrue.decoding.gray.faults import CAPTURE
from retrue.decoding.gray.sequence import gray_sequence
from retrue.decoding.light import saturated
from retrue.decoding.sequence.arrange import ArrangedSequence, arrange
from retrue.decoding.sequence.read_sines import REASONS as SINE_REASONS
from retrue.decoding.sequence.read_sines import plan_sines, read_sines
from retrue.errors import CaptureError
from retrue.geometry.arrays import FloatArray, Image
from retrue.patterns.gray_code import GrayCode
from retrue.patterns.sequence import FrameSequence

REASONS = {**GRAY_REASONS, **SINE_REASONS}


def decode_sequence(
    pattern: GrayCode | FrameSequence, images: Sequence[Image], names: Sequence[str] | None = None
) -> Correspondences:
    """One correspondence per camera pixel whose code can be trusted, projector coordinates to sub-pixel.

    Parameters
    ----------
    pattern : what the projector showed.
    images : of the frames, in order; of a Gray code white and black last, first or left out. (height, width) or
        (height, width, 3), red green blue, uint8 or uint16.
    names : of the pictures, for messages.

    Returns
    -------
    Correspondences
        of one projector coordinate only where the sequence shows one axis.

    Raises
    ------
    CaptureError
        a picture is missing, doubled, late, swapped or of another size, nothing is lit, or the codes exceed
        the projector; names the picture.
    """
    names = names or [f"picture {index + 1}" for index in range(len(images))]
    return decode_arranged(arrange(pattern, images, names))


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """What one way of reading found in a band of rows.

    Attributes
    ----------
    pixels : (N,) flat index into the band, ascending.
    projector_px : by axis, (N,).
    sigma_px : (N,) of either coordinate.
    light : (N,) what the projector adds, or None.
    seen : lit pixels; rejected : those that are no points, by reason.
    """

    pixels: NDArray[np.intp]
    projector_px: Mapping[int, FloatArray]
    sigma_px: FloatArray
    light: FloatArray | None
    seen: int
    rejected: Mapping[str, int]


def decode_arranged(sequence: ArrangedSequence) -> Correspondences:
    """The same, of pictures that are arranged already."""
    sine_axes = [axis for axis in sequence.spec.axes if sequence.spec.sines(axis)]
    gray_axes = [axis for axis in sequence.spec.axes if axis not in sine_axes]
    rows = band_rows(sequence.white.shape[0])
    details: dict[str, object] = {}
    read: list[list[Points]] = []
    with ThreadPoolExecutor(2) as threads:
        if gray_axes:
            found = read_gray(gray_sequence(sequence, gray_axes), threads, thorough=sequence.thorough)
            read.append([Points(b.pixels, b.projector_px, b.sigma_px, None, b.seen, b.rejected) for b in found])
            depths = np.sum([band.depths for band in found], axis=0).tolist()
            if len(depths) > 1:
                details["points_by_bits_left_out"] = depths
        if sine_axes:
            noise, plans = plan_sines(sequence, sine_axes)
            details |= {"noise_floor": noise.floor, "noise_gain": noise.gain}
            sines = read_sines(sequence, noise, plans, rows, threads)
            read.append([Points(b.pixels, b.projector_px, b.sigma_px, b.light, b.seen, b.rejected) for b in sines])
        bands = read[0] if len(read) == 1 else [_both(*pair) for pair in zip(*read, strict=True)]
        return _assemble(sequence, bands, rows, details, threads)


def _both(gray: Points, sines: Points) -> Points:
    """The pixels that both ways of reading took, one axis each."""
    pixels, a, b = np.intersect1d(gray.pixels, sines.pixels, assume_unique=True, return_indices=True)
    px = {axis: own[a] for axis, own in gray.projector_px.items()}
    px |= {axis: own[b] for axis, own in sines.projector_px.items()}
    sigma = np.sqrt((gray.sigma_px[a] ** 2 + sines.sigma_px[b] ** 2) / 2)
    lost = {"undecided": max(gray.seen, sines.seen) - len(pixels)}
    return Points(pixels, px, sigma, None if sines.light is None else sines.light[b], max(gray.seen, sines.seen), lost)


def _assemble(
    sequence: ArrangedSequence,
    bands: Sequence[Points],
    rows: Sequence[range],
    details: Mapping[str, object],
    threads: ThreadPoolExecutor,
) -> Correspondences:
    ends = np.cumsum([len(band.pixels) for band in bands])
    total = int(ends[-1])
    height, width = sequence.white.shape
    camera_px, projector_px, sigma_px = np.empty((total, 2)), np.empty((total, 2)), np.empty(total)
    cells, colors = np.empty((total, 2), np.int64), np.empty((total, 3), np.uint8)
    light = np.empty(total)

    def fill(band: Points, rows: range, end: int) -> None:
        part = slice(end - len(band.pixels), end)
        y, x = np.divmod(band.pixels, width)
        y += rows.start
        cells[part, 0], cells[part, 1] = y, x
        camera_px[part, 0], camera_px[part, 1] = x, y
        for axis in range(2):
            projector_px[part, axis] = band.projector_px.get(axis, np.nan)
        sigma_px[part] = band.sigma_px
        seen = sequence.color[y, x]
        if band.light is None:
            np.subtract(sequence.white[y, x], sequence.black[y, x], out=light[part], dtype=np.float64)
            light[part][saturated(seen)] = np.nan
        else:
            light[part] = band.light
        seen = seen >> 8 if seen.dtype == np.uint16 else seen
        colors[part] = seen[:, None] if seen.ndim == 1 else seen

    list(threads.map(fill, bands, rows, ends.tolist()))
    for array in (camera_px, projector_px, sigma_px, light):
        array.setflags(write=False)
    return Correspondences(
        camera_px,
        projector_px,
        projector_sigma_px=sigma_px,
        colors=colors,
        cells=cells,
        card=_card(sequence, total, bands, details),
        light=light,
        camera_size=(width, height),
        projector_size=sequence.spec.projector_size,
    )


def _card(sequence: ArrangedSequence, points: int, bands: Sequence[Points], details: Mapping[str, object]) -> Card:
    """Raises `CaptureError` where nothing was decoded."""
    lit, pixels = sum(band.seen for band in bands), sequence.white.size
    rejected = {reason: sum(band.rejected[reason] for band in bands) for reason in bands[0].rejected}
    if points == 0:
        reason = max(rejected, key=lambda name: rejected[name])
        what = f"{rejected[reason]} of {lit} lit pixels: {REASONS[reason]}" if lit else "no pixel is lit"
        raise CaptureError(CAPTURE, f"nothing decodes: {what}; do the pictures show this pattern?")
    return Card(
        "pixels",
        seen=lit,
        decoded=points,
        rejected=rejected,
        coverage=points / pixels,
        advice=tuple(_advice(sequence, lit, rejected)),
        details={"pixels": pixels, **details},
    )


def _advice(sequence: ArrangedSequence, lit: int, rejected: Mapping[str, int]) -> list[str]:
    advice: list[str] = []
    pixels = sequence.white.size
    if lit < 0.2 * pixels:
        advice.append(f"the projector lights {100 * lit / pixels:.0f} % of the picture: turn it towards the scene")
    if rejected.get("undecided", 0) > 0.5 * lit:
        advice.append("most pixels do not resolve the finest stripes: focus, expose longer, or use a larger step")
    if rejected.get("alone", 0) > 0.5 * lit:
        advice.append("stripe edges are sparse: noise or texture hides them; expose longer")
    white = sequence.white[::4, ::4]
    full = float(np.mean(white >= np.iinfo(white.dtype).max))
    if full > 0.05:
        advice.append(f"{100 * full:.0f} % of the white picture is overexposed: shorten the exposure")
    return advice
