"""Gray-code captures to sub-pixel correspondences: pairs -> stripes -> edges -> planes through the edges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np

from retrue.correspondences import Card, Correspondences
from retrue.decoding.gray.faults import CAPTURE, require_inside
from retrue.decoding.gray.plan import MAX_CELL, plan_reading
from retrue.decoding.gray.reading import Band, read_band
from retrue.decoding.gray.sequence import GraySequence, arrange
from retrue.decoding.light import saturated
from retrue.errors import CaptureError
from retrue.geometry.arrays import Image
from retrue.patterns.gray_code import GrayCode

BAND_ROWS = 8 * MAX_CELL
"""Small enough for the processor's cache, large enough that the rows around a band cost little."""
SYSTEMATIC_SIGMA = 0.02
"""Stripes: what the lens, JPEG and the surface leave, however many edges there are."""
REASONS = {
    "undecided": "pattern and inverse too alike in more than one bit",
    "outside": "code beyond the projector",
    "alone": "too few stripe edges around, or all to one side",
    "rough": "stripe edges around do not lie on one surface",
}


def decode_gray_code(pattern: GrayCode, images: Sequence[Image], names: Sequence[str] | None = None) -> Correspondences:
    """One correspondence per camera pixel whose code can be trusted, projector coordinates to sub-pixel.

    Neighbouring points share most of the stripe edges that they rest on: their errors are correlated over
    some two stripes.

    Parameters
    ----------
    pattern : what the projector showed.
    images : in the pattern's order, white and black last, first or left out; (height, width) or
        (height, width, 3), red green blue, uint8 or uint16.
    names : of the pictures, for messages.

    Raises
    ------
    CaptureError
        a picture is missing, doubled, late, swapped or of another size, nothing is lit, or the codes exceed
        the projector; names the picture.

    Source: Inokuchi, Sato, Matsuda, "Range imaging system for 3-D object recognition", ICPR 1984 (Gray code);
    Trobina, "Error model of a coded-light range sensor", 1995 (edges where pattern and inverse cross).
    """
    names = names or [f"picture {index + 1}" for index in range(len(images))]
    return decode_sequence(pattern, arrange(pattern, images, names))


def decode_sequence(pattern: GrayCode, sequence: GraySequence) -> Correspondences:
    """The same, of pictures that are arranged already."""
    plan = plan_reading(sequence)
    height = sequence.white.shape[0]
    bands = [range(start, min(start + BAND_ROWS, height)) for start in range(0, height, BAND_ROWS)]
    with ThreadPoolExecutor(2) as threads:
        read = list(threads.map(partial(read_band, sequence, pattern, plan), bands))
        agreed = sum(band.counts["agreed"] for band in read)
        require_inside(
            agreed,
            [sum(band.outside[axis] for band in read) for axis in range(2)],
            [max(band.largest[axis] for band in read) for axis in range(2)],
            pattern,
        )
        return _assemble(pattern, sequence, read, threads)


def _assemble(
    pattern: GrayCode, sequence: GraySequence, bands: Sequence[Band], threads: ThreadPoolExecutor
) -> Correspondences:
    ends = np.cumsum([len(band.rows) for band in bands])
    total = int(ends[-1])
    camera_px, projector_px, sigma_px = np.empty((total, 2)), np.empty((total, 2)), np.empty(total)
    cells, colors = np.empty((total, 2), np.int64), np.empty((total, 3), np.uint8)
    light = np.empty(total)

    def fill(band: Band, end: int) -> None:
        part = slice(end - len(band.rows), end)
        cells[part, 0], cells[part, 1] = band.rows, band.columns
        camera_px[part, 0], camera_px[part, 1] = band.columns, band.rows
        for axis, stripes in enumerate(band.stripes):
            centre = 0.5 - pattern.offset[axis]
            np.multiply(stripes + np.float64(centre), pattern.step, out=projector_px[part, axis])
        projector_px[part] -= 0.5
        np.sqrt(band.variance + np.float64(SYSTEMATIC_SIGMA**2), out=sigma_px[part])
        sigma_px[part] *= pattern.step
        white, black = sequence.white[band.rows, band.columns], sequence.black[band.rows, band.columns]
        np.subtract(white, black, out=light[part], dtype=np.float64)
        seen = sequence.color[band.rows, band.columns]
        light[part][saturated(seen)] = np.nan
        seen = seen >> 8 if seen.dtype == np.uint16 else seen
        colors[part] = seen[:, None] if seen.ndim == 1 else seen

    list(threads.map(fill, bands, ends.tolist()))
    for array in (camera_px, projector_px, sigma_px, light):
        array.setflags(write=False)
    card = _card(sequence, total, [band.counts for band in bands])
    height, width = sequence.white.shape
    return Correspondences(
        camera_px,
        projector_px,
        projector_sigma_px=sigma_px,
        colors=colors,
        cells=cells,
        card=card,
        light=light,
        camera_size=(width, height),
        projector_size=pattern.projector_size,
    )


def _card(sequence: GraySequence, points: int, counts: Sequence[Mapping[str, int]]) -> Card:
    """Raises `CaptureError` where nothing was decoded."""
    total = {key: sum(count[key] for count in counts) for key in counts[0]}
    lit, pixels = total["lit"], sequence.white.size
    rejected = {
        "undecided": lit - total["agreed"],
        "outside": total["outside"],
        "alone": total["alone"],
        "rough": total["rough"],
    }
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
        details={"pixels": pixels},
    )


def _advice(sequence: GraySequence, lit: int, rejected: Mapping[str, int]) -> list[str]:
    advice: list[str] = []
    pixels = sequence.white.size
    if lit < 0.2 * pixels:
        advice.append(f"the projector lights {100 * lit / pixels:.0f} % of the picture: turn it towards the scene")
    if rejected["undecided"] > 0.5 * lit:
        advice.append("most pixels do not resolve the finest stripes: focus, expose longer, or use a larger step")
    if rejected["alone"] > 0.5 * lit:
        advice.append("stripe edges are sparse: noise or texture hides them; expose longer")
    white = sequence.white[::4, ::4]
    saturated = float(np.mean(white >= np.iinfo(white.dtype).max))
    if saturated > 0.05:
        advice.append(f"{100 * saturated:.0f} % of the white picture is overexposed: shorten the exposure")
    return advice
