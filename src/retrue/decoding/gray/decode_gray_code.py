"""Gray-code pictures to sub-pixel coordinates: pairs -> stripes -> edges -> planes through the edges."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial

from retrue.decoding.gray.faults import require_inside
from retrue.decoding.gray.plan import MAX_CELL, plan_reading
from retrue.decoding.gray.reading import Band, Depth, read_band
from retrue.decoding.gray.sequence import GraySequence

BAND_ROWS = 8 * MAX_CELL
"""Small enough for the processor's cache, large enough that the rows around a band cost little."""
MOST_DEPTHS = 4
"""Stripes eight times as wide as the finest, and so on, say little about a surface."""
LEAST_RESOLVED = 0.5
"""Of the lit pixels: a Gray code whose finest stripes so many resolve is read at its finest stripes only."""
REASONS = {
    "undecided": "pattern and inverse too alike in more than one bit",
    "outside": "code beyond the projector",
    "alone": "too few stripe edges around, or all to one side",
    "rough": "stripe edges around do not lie on one surface",
}


def read_gray(sequence: GraySequence, threads: ThreadPoolExecutor, *, thorough: bool) -> list[Band]:
    """One point per camera pixel whose code can be trusted, projector coordinates to sub-pixel.

    Each pixel is read to the finest bit that it resolves; unless `thorough`, only where most do not resolve the
    finest. Neighbouring points share most of the stripe edges that they rest on: their errors are correlated over
    some two stripes.

    Raises
    ------
    CaptureError
        bits are not in order, or the codes exceed the projector.

    Source: Inokuchi, Sato, Matsuda, "Range imaging system for 3-D object recognition", ICPR 1984 (Gray code);
    Trobina, "Error model of a coded-light range sensor", 1995 (edges where pattern and inverse cross).
    """
    depths = _depths(sequence, thorough)
    bands = band_rows(sequence.white.shape[0])
    read = list(threads.map(partial(read_band, depths), bands))
    axes = range(len(sequence.stripes))
    require_inside(
        sum(band.agreed for band in read),
        [sum(band.outside[axis] for band in read) for axis in axes],
        [max(band.largest[axis] for band in read) for axis in axes],
        sequence.stripes,
    )
    return read


def band_rows(height: int) -> list[range]:
    """The rows of each band of a picture."""
    return [range(start, min(start + BAND_ROWS, height)) for start in range(0, height, BAND_ROWS)]


def _depths(sequence: GraySequence, thorough: bool) -> Sequence[Depth]:
    depths = [Depth(sequence, plan_reading(sequence))]
    if not thorough and depths[0].plan.resolved >= LEAST_RESOLVED:
        return depths
    while len(depths) < MOST_DEPTHS and (coarser := depths[-1].sequence.coarser()) is not None:
        depths.append(Depth(coarser, plan_reading(coarser)))
    return depths
