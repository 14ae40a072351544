"""Gray-code pictures to sub-pixel coordinates: pairs -> stripes -> edges -> planes through the edges."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial, reduce

import numpy as np

from retrue.decoding.gray.faults import require_inside
from retrue.decoding.gray.plan import MAX_CELL, cut_strips, plan_strips
from retrue.decoding.gray.reading import Depth, Found, Reading, lit_columns, locate, read_depth
from retrue.decoding.gray.sequence import GraySequence
from retrue.geometry.arrays import BoolArray

BAND_ROWS = 4 * MAX_CELL
"""Small enough for the processor's cache, large enough that the rows around a band cost little."""
MOST_DEPTHS = 4
"""Stripes eight times as wide as the finest, and so on, say little about a surface."""
FEWEST_OPEN = 64
"""Pixels: fewer that one depth leaves open are not worth the next."""
WORTH_CUTTING = 0.9
"""Of the width: columns without light are left out where no more remain."""
LEAST_RESOLVED = 0.5
"""Of the lit pixels: a Gray code whose finest stripes so many resolve is read at its finest stripes only."""
REASONS = {
    "undecided": "pattern and inverse too alike in more than one bit",
    "outside": "code beyond the projector",
    "alone": "too few stripe edges around, or all to one side",
    "rough": "stripe edges around do not lie on one surface",
}


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """The points of a band of rows, and how many of its pixels are none, by reason.

    Attributes
    ----------
    found : points, `depths` : how many were read at each depth.
    seen : how many pixels are lit; rejected : those that are no points, by reason.
    """

    found: Found
    depths: tuple[int, ...]
    seen: int
    rejected: dict[str, int]


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
    dropped, depths = _depths(sequence, thorough)
    whole = band_rows(sequence.white.shape[0])
    (first_band, last_band), columns, lit = _lit_box(depths[0], whole, threads)
    top, bottom = whole[first_band].start, whole[last_band].stop
    bands = band_rows(bottom - top)
    depths = [replace(depth, sequence=depth.sequence.part(slice(top, bottom), columns)) for depth in depths]
    first = read_depth(depths[0], bands, threads, None)
    require_inside(int(np.count_nonzero(first.agreed)), first.outside, first.largest, depths[0].sequence.stripes)
    good = first.certain & first.smooth
    read = [(depths[0], first, good)]
    unread = first.lit & ~good & (first.inside | ~first.agreed) & (first.smooth | ~first.certain)
    for depth in depths[1:]:
        if np.count_nonzero(unread) < FEWEST_OPEN:
            break
        coarser = read_depth(depth, bands, threads, unread)
        good = coarser.certain & coarser.smooth & unread
        read.append((depth, coarser, good))
        unread &= ~good
    found = list(threads.map(partial(_band, read, len(depths), columns.start, sequence.white.shape[1]), bands))
    none, no_depths = found[0].found.none(), (0,) * len(depths)
    dark = [Band(none, no_depths, 0, dict.fromkeys(REASONS, 0)) for _ in whole]
    return [
        replace(
            band,
            depths=(0,) * dropped + band.depths,
            seen=count,
            rejected=band.rejected | {"alone": band.rejected["alone"] + count - band.seen},
        )
        for band, count in zip([*dark[:first_band], *found, *dark[last_band + 1 :]], lit, strict=True)
    ]


def _lit_box(
    depth: Depth, bands: Sequence[range], threads: ThreadPoolExecutor
) -> tuple[tuple[int, int], slice, tuple[int, ...]]:
    """The first and the last band, and the columns, that hold all pixels that are lit and not alone, all columns where
    that saves little; and how many each band has lit."""
    seen = list(threads.map(partial(lit_columns, depth), bands))
    counts, lit = tuple(count for count, _ in seen), np.stack([filled for _, filled in seen])
    width = lit.shape[1]
    here, columns = np.flatnonzero(lit.any(axis=1)), np.flatnonzero(lit.any(axis=0))
    if not len(columns):
        return (0, 0), slice(0, width), counts
    start, stop = int(columns[0]) // MAX_CELL * MAX_CELL, min((int(columns[-1]) // MAX_CELL + 1) * MAX_CELL, width)
    cut = slice(start, stop) if stop - start < WORTH_CUTTING * width else slice(0, width)
    return (int(here[0]), int(here[-1])), cut, counts


def band_rows(height: int) -> list[range]:
    """The rows of each band of a picture."""
    return [range(start, min(start + BAND_ROWS, height)) for start in range(0, height, BAND_ROWS)]


def _band(read: Sequence[tuple[Depth, Reading, BoolArray]], depths: int, left: int, width: int, rows: range) -> Band:
    """A band of what was read, which begins at column `left` of pictures of that width."""
    found = [locate(depth.sequence.stripes, reading, rows, good) for depth, reading, good in read]
    here, first = slice(rows.start, rows.stop), read[0][1]
    taken = reduce(np.logical_or, [good[here] for _, _, good in read])
    lit, agreed, inside, certain, smooth = (
        own[here] for own in (first.lit, first.agreed, first.inside, first.certain, first.smooth)
    )
    rejected = {
        "undecided": lit & ~agreed,
        "outside": agreed & ~inside,
        "alone": inside & ~certain,
        "rough": certain & ~smooth,
    }
    return Band(
        _together(found).placed(first.lit.shape[1], left, width),
        tuple(len(own.pixels) for own in found) + (0,) * (depths - len(found)),
        int(np.count_nonzero(lit)),
        {reason: int(np.count_nonzero(mask & ~taken)) for reason, mask in rejected.items()},
    )


def _together(found: Sequence[Found]) -> Found:
    """Points of several depths in the order of their pixels."""
    if len(found) == 1:
        return found[0]
    pixels = np.concatenate([own.pixels for own in found])
    order = np.argsort(pixels, kind="stable")
    px = {axis: np.concatenate([own.projector_px[axis] for own in found])[order] for axis in found[0].projector_px}
    sigma = np.concatenate([own.sigma_px for own in found])[order]
    ratios = [own.sigma_ratio for own in found if own.sigma_ratio is not None]
    return Found(pixels[order], px, sigma, np.concatenate(ratios)[order] if ratios else None)


def _depths(sequence: GraySequence, thorough: bool) -> tuple[int, Sequence[Depth]]:
    """How many of the finest bits are dropped, as their stripes are narrower than a pixel and leave hardly any edges
    between neighbours; and what is read."""
    strips: Sequence[GraySequence] = cut_strips(sequence)
    plan, dropped = plan_strips(strips), 0
    while plan.narrow and (wider := sequence.coarser()) is not None:
        sequence, strips, dropped = wider, _coarser(strips), dropped + 1
        plan = plan_strips(strips)
    depths = [Depth(sequence, plan)]
    if not thorough and plan.resolved >= LEAST_RESOLVED:
        return dropped, depths
    while len(depths) < MOST_DEPTHS and (coarser := depths[-1].sequence.coarser()) is not None:
        strips = _coarser(strips)
        depths.append(Depth(coarser, plan_strips(strips, finest=False), 2 * depths[-1].width))
    return dropped, depths


def _coarser(strips: Sequence[GraySequence]) -> list[GraySequence]:
    return [own for strip in strips if (own := strip.coarser()) is not None]
