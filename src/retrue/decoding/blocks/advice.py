"""What to change, when a picture of a colour grid does not decode."""

from __future__ import annotations

import numpy as np

from retrue.decoding.blocks.sight import GridSight

GOOD_COUNT = 30  # points that a job can work with
SMALLEST_BLOCK = 5.0  # px
GRAY_CHROMA = 6.0  # grey levels between channels that noise and white balance explain
DARK_SHARE, BRIGHT_SHARE = 0.1, 0.9  # of full scale


def advise(sight: GridSight, decoded: int) -> str:
    """One sentence for the user; empty where there is nothing to say."""
    if decoded >= GOOD_COUNT:
        return ""
    picture = sight.picture[::3, ::3].astype(np.float64)
    full = float(np.iinfo(sight.picture.dtype).max)
    bright = np.percentile(picture.max(axis=-1), 99)
    if bright < DARK_SHARE * full:
        return "too dark: expose longer, or dim the room and brighten the projector"
    if np.median(picture.min(axis=-1)) > BRIGHT_SHARE * full:
        return "overexposed: expose shorter"
    chroma = np.percentile(picture.max(axis=-1) - picture.min(axis=-1), 99) * 255 / full
    if chroma < GRAY_CHROMA:
        return "not a colour picture"
    linked = int(((sight.links.neighbour >= 0).sum(axis=1) >= 3).sum())
    if linked < GOOD_COUNT:
        return "no grid seen: out of focus, or blocks smaller than 5 px: focus, move closer or use a coarser grid"
    if sight.block_px < SMALLEST_BLOCK:
        return "blocks smaller than 5 px: move closer or use a coarser grid"
    return "not this pattern: a grid is there, but its colours are not those of this code (or it is mirrored)"
