"""One colour picture of a colour grid -> correspondences of block centres."""

from __future__ import annotations

import numpy as np

from retrue.correspondences import Correspondences
from retrue.decoding.grid_blocks import find_blocks
from retrue.decoding.grid_centres import refine_centres
from retrue.decoding.grid_colors import separate_colors
from retrue.decoding.grid_links import link_blocks
from retrue.decoding.grid_windows import Code, place_blocks, significant
from retrue.geometry.arrays import Image
from retrue.patterns.color_grid import ColorGrid


def decode_color_grid(
    pattern: ColorGrid, image: Image, black: Image | None = None, white: Image | None = None
) -> Correspondences:
    """Block centres of `pattern` in a picture."""
    blocks = find_blocks(image)
    links = link_blocks(blocks)
    label, _ = separate_colors(blocks.color, links.around, pattern.colors)
    code = Code(pattern)
    place = place_blocks(code, links, label)
    good = significant(code, links, label, place)
    index = np.flatnonzero(good)
    row, column, _ = code.split(place[index])
    coarse = np.full((code.rows, code.columns, 2), np.nan)
    coarse[row, column] = blocks.centre[index]
    centres = refine_centres(image, coarse, pattern.block / pattern.pitch)
    cells = np.argwhere(np.isfinite(centres.camera_px[..., 0]))
    projector_px = np.asarray(pattern.origin) + pattern.pitch * cells[:, ::-1]
    camera_px = centres.camera_px[cells[:, 0], cells[:, 1]]
    return Correspondences(camera_px, projector_px, cells=cells)
