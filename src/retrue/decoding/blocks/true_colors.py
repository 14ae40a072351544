"""What colour the scene has under each block: as white light shows it, not as the projector's own colours do.

Where there is a picture in white light, it tells. Without one, a block shows its surface in the light of its own colour
alone. Unmixed, it is a_k P_k in the projector's channels k, P its colour: where P_k is lit, a_k follows; a channel
that is dark there has the ratio to the lit ones that it has in the blocks around, and a M is what white would show,
M the mixing of the channels on the way from projector to camera.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from retrue.decoding.blocks.colors import DISPLAY_GAMMA, unmixing
from retrue.decoding.pictures import eight_bits, seen_colors, seen_levels
from retrue.decoding.surface import lengths, median
from retrue.geometry.arrays import BoolArray, FloatArray, Image
from retrue.kernels import surroundings as kernel
from retrue.patterns.color_grid import ColorGrid

REACH = 2  # blocks about one that tell of its dark channels
SPREAD = 1.0  # of their weights, in blocks
FARTHER = 1.4  # times the usual pitch: beyond it two blocks lie on two surfaces
CELLS: FloatArray = np.hypot(*np.mgrid[-REACH : REACH + 1, -REACH : REACH + 1])
NO_LESS: FloatArray = np.maximum(CELLS, 1.0)
LIT = 0.3  # of full light: a channel that is brighter tells of the surface


def true_colors(
    pattern: ColorGrid, centre_px: FloatArray, image: Image, black: Image | None, white: Image | None
) -> NDArray[np.uint8]:
    """(rows, columns, 3) red, green, blue of eight bits; 0 where `centre_px` (rows, columns, 2) is NaN.

    From the white picture as it is, the room's light included; without one, what the projector's white would add.
    """
    there: BoolArray = np.isfinite(centre_px[..., 0])
    colors = np.zeros((*there.shape, 3), np.uint8)
    if not there.any():
        return colors
    if white is not None:
        colors[there] = seen_colors(white, centre_px[there], "white")
        return colors
    seen = np.full((*there.shape, 3), np.nan)
    seen[there] = seen_levels(image, centre_px[there], "image") - _dark(image, black, centre_px)[there]
    palette = np.asarray(pattern.colors, dtype=np.float64) / 255
    unmixed = unmixing(np.maximum(seen[there], 0.0), palette)
    shown = (palette**DISPLAY_GAMMA)[np.asarray(pattern.code)]
    with np.errstate(invalid="ignore", divide="ignore"):
        amounts = np.where(shown > LIT, np.maximum(seen @ unmixed.T, 0.0) / shown, np.nan)
    full = _completed(amounts, centre_px)[there]
    colors[there] = eight_bits(full @ np.linalg.inv(unmixed).T, image)
    return colors


def _completed(amounts: FloatArray, centre_px: FloatArray) -> FloatArray:
    """(rows, columns, 3) amounts with the dark channels (NaN) filled in."""
    mean = _mean_around(amounts, centre_px)
    lit = np.isfinite(amounts)
    own, usual = (np.where(lit, of, 0.0).sum(axis=-1, keepdims=True) for of in (amounts, mean))
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.where(usual > 0, own / usual, 1.0)
    return np.where(lit, amounts, np.nan_to_num(mean * ratio))


def _mean_around(amounts: FloatArray, centre_px: FloatArray) -> FloatArray:
    """Weighted mean of what is known in the blocks around, of the same surface as far as their distance tells."""
    step = np.concatenate([lengths(np.diff(centre_px, axis=axis)).ravel() for axis in (0, 1)])
    step = step[np.isfinite(step)]
    pitch, mean = median(step) if len(step) else np.inf, np.empty_like(amounts)
    kernel.mean_of_blocks(amounts, centre_px, np.exp(-0.5 * (CELLS / SPREAD) ** 2), FARTHER * NO_LESS * pitch, mean)
    return mean


def _dark(image: Image, black: Image | None, centre_px: FloatArray) -> FloatArray:
    """(rows, columns, 3) the room's light: of the dark picture, or where four blocks leave a gap between them."""
    there = np.isfinite(centre_px[..., 0])
    dark = np.zeros((*there.shape, 3))
    if black is not None:
        dark[there] = seen_levels(black, centre_px[there], "black")
        return dark
    corner_px = (centre_px[:-1, :-1] + centre_px[1:, 1:]) / 2
    gap = np.isfinite(corner_px[..., 0])
    corners = np.full((there.shape[0] + 1, there.shape[1] + 1, 3), np.inf)
    corners[1:-1, 1:-1][gap] = seen_levels(image, corner_px[gap], "image")
    beside = np.minimum(corners[:, :-1], corners[:, 1:])
    least = np.minimum(beside[:-1], beside[1:])
    return np.where(np.isfinite(least), least, 0.0)
