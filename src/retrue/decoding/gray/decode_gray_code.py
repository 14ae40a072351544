"""Gray-code captures to sub-pixel correspondences: pairs -> stripes -> edges -> planes through the edges."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np

from retrue.correspondences import Correspondences
from retrue.decoding.gray.card import decode_card
from retrue.decoding.gray.faults import require_inside
from retrue.decoding.gray.plan import MAX_CELL, plan_reading
from retrue.decoding.gray.reading import Band, read_band
from retrue.decoding.gray.sequence import GraySequence, arrange
from retrue.geometry.arrays import Image
from retrue.patterns.gray_code import GrayCode

BAND_ROWS = 8 * MAX_CELL
"""Small enough for the processor's cache, large enough that the rows around a band cost little."""
SYSTEMATIC_SIGMA = 0.02
"""Stripes: what the lens, JPEG and the surface leave, however many edges there are."""


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
    sequence = arrange(pattern, images, names or [f"picture {index + 1}" for index in range(len(images))])
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
        seen = sequence.color[band.rows, band.columns]
        seen = seen >> 8 if seen.dtype == np.uint16 else seen
        colors[part] = seen[:, None] if seen.ndim == 1 else seen

    list(threads.map(fill, bands, ends.tolist()))
    for array in (camera_px, projector_px, sigma_px):
        array.setflags(write=False)
    card = decode_card(sequence, total, [band.counts for band in bands])
    return Correspondences(camera_px, projector_px, projector_sigma_px=sigma_px, colors=colors, cells=cells, card=card)
