"""Which kind of grid a picture shows, whatever its colours mean: for those who gave the pattern of another."""

from __future__ import annotations

import numpy as np

from retrue.decoding.blocks.blobs import find_blocks
from retrue.decoding.blocks.links import link_blocks
from retrue.decoding.lines.look import halved, seen_lines
from retrue.decoding.pictures import rgb
from retrue.geometry.arrays import FloatArray, Image
from retrue.patterns.color_grid import ColorGrid
from retrue.patterns.line_grid import LineGrid

LARGEST_SIDE = 800  # px
FEWEST = 100  # crossings, or blocks, with four neighbours
LEAST_CHANGE = 0.2  # of the direction of the light, from line to line
STEADIER = (
    5.0  # times that light changes less along a line than from line to line; ten of lines, three of blurred blocks
)


def what_it_shows(image: Image) -> type[ColorGrid] | type[LineGrid] | None:
    """The kind of grid that is seen in `image`; None: neither.

    The colour of a line stays the same from crossing to crossing and changes from line to line, of both families. The
    colours of blocks change both ways.
    """
    picture = rgb(image, "image")
    halvings = 0
    while max(picture.shape[:2]) / 2**halvings > LARGEST_SIDE:
        halvings += 1
    small = halved(picture, halvings)
    crossings, lights = seen_lines(small)
    whole = (crossings.neighbour >= 0).all(axis=1)
    if whole.sum() >= FEWEST:
        right, down = crossings.neighbour[whole, 0], crossings.neighbour[whole, 1]
        changes = [[_change(light[whole], light[other]) for other in (right, down)] for light in lights]
        (across, along), (along_level, across_level) = changes
        if across > max(STEADIER * along, LEAST_CHANGE) and across_level > max(STEADIER * along_level, LEAST_CHANGE):
            return LineGrid
    blocks = find_blocks(small)
    if len(blocks) and ((link_blocks(blocks).neighbour >= 0).all(axis=1)).sum() >= FEWEST:
        return ColorGrid
    return None


def _change(light: FloatArray, other: FloatArray) -> float:
    """Median difference of the colours of light (N, 3)."""
    with np.errstate(invalid="ignore", divide="ignore"):
        units = [
            np.maximum(each, 0) / np.linalg.norm(np.maximum(each, 0), axis=1, keepdims=True) for each in (light, other)
        ]
    change = np.linalg.norm(units[0] - units[1], axis=1)
    change = change[np.isfinite(change)]
    return float(np.median(change)) if len(change) else np.nan
