"""One frame, and what can be said of it at once: what the decoder sees, some meters, and one sentence."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from retrue.correspondences import Correspondences
from retrue.decoding.decode import decode
from retrue.errors import CaptureError
from retrue.geometry.arrays import Image
from retrue.patterns.color_grid import ColorGrid
from retrue.studio.focus import focus

CLIPPED = 250
MOST_CLIPPED = 0.02  # of the picture
DARKEST = 45.0  # grey levels that the brightest twentieth should have at least
LEAST_FOCUS = 0.1  # of 1: below, blocks are not read any more
MOST_MOVED = 6.0  # grey levels, in the mean, between two frames that stand still
ENOUGH = 0.35  # of the pattern's blocks
FEWEST_MIRRORED = 50


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """What a frame shows.

    Attributes
    ----------
    picture : the frame, (h, w, 3).
    points : what was decoded; none where nothing was.
    sentence : what to do, or that it is good.
    good : whether there is nothing to do.
    meters : light, clipping, focus, stillness and blocks, each from 0, bad, to 1, good; focus only where it is known.
    """

    picture: Image
    points: Correspondences
    sentence: str
    good: bool
    meters: dict[str, float] = field(default_factory=dict[str, float])


def look_at(pattern: ColorGrid, picture: Image, before: Image | None = None) -> Look:
    """Decode a frame and say what is wrong with it; the frame `before` it tells whether it stands still."""
    color = picture if picture.ndim == 3 else np.repeat(picture[..., None], 3, axis=2)
    levels = _sampled(color)
    bright = float(np.percentile(np.asarray(levels.max(axis=2)), 95))
    clipped = float(np.count_nonzero(levels.min(axis=2) >= CLIPPED)) / levels[..., 0].size
    moved = 0.0
    if before is not None and before.shape == picture.shape:
        moved = float(np.abs(_sampled(picture) - _sampled(before)).mean())
    points = _decoded(pattern, color)
    share = len(points) / (len(pattern.code) * len(pattern.code[0]))
    found = {
        "light": min(bright / (4 * DARKEST), 1.0),
        "clipping": 1 - min(clipped / (2 * MOST_CLIPPED), 1.0),
        "focus": focus(color, points),
        "stillness": 1 - min(moved / (2 * MOST_MOVED), 1.0),
        "blocks": min(share / ENOUGH, 1.0),
    }
    meters = {name: value for name, value in found.items() if value is not None}
    problem = _problem(pattern, color, points, bright, clipped, moved, share, meters.get("focus", 1.0))
    return Look(picture, points, problem or f"good: {len(points)} blocks are seen", not problem, meters)


def _problem(
    pattern: ColorGrid,
    color: Image,
    points: Correspondences,
    bright: float,
    clipped: float,
    moved: float,
    share: float,
    sharp: float,
) -> str:
    """The first thing to put right; empty where there is none."""
    if clipped > MOST_CLIPPED:
        return "clipped: expose shorter, or close the aperture"
    if bright < DARKEST:
        return "too dark: expose longer, or brighten the projector"
    if moved > MOST_MOVED:
        return "hold still"
    if sharp < LEAST_FOCUS:
        return "out of focus: turn the lens of the camera or the projector until the blocks have sharp edges"
    if share >= ENOUGH:
        return ""
    if len(points) == 0 and len(_decoded(pattern, np.ascontiguousarray(color[:, ::-1]))) >= FEWEST_MIRRORED:
        return "mirrored: switch off the projector's or the camera's mirroring"
    if points.card is not None and points.card.advice:
        return points.card.advice[0]
    return "few blocks are seen: aim both devices at the same surface, or move closer"


def _sampled(picture: Image) -> NDArray[np.int16]:
    """Every fourth pixel, in grey levels of 255."""
    part = picture[::4, ::4]
    return np.asarray(part if part.dtype == np.uint8 else part // 257, dtype=np.int16)


def _decoded(pattern: ColorGrid, color: Image) -> Correspondences:
    try:
        return decode(pattern, color)
    except CaptureError:
        return Correspondences(np.empty((0, 2)), np.empty((0, 2)))
