"""Which colour each block has, from what the picture itself shows of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from retrue.geometry.arrays import FloatArray, IntArray
from retrue.kernels import blobs as kernel

DISPLAY_GAMMA = 2.2
PURE_SHARE = 0.06  # of the blocks, the purest red ones (green, blue) that show what red light looks like
SURE_MARGIN = 0.2  # of a colour that its cluster follows
ROUNDS = 4


@dataclass(frozen=True, slots=True, eq=False)
class Colors:
    """How the colours of the projector look in one picture.

    Attributes
    ----------
    unmixing : (3, 3) from what a block adds to its surroundings to amounts of the projector's red, green and blue.
    centres : (K, 3) where each colour lies, in amounts over the local level.
    """

    unmixing: FloatArray
    centres: FloatArray

    def amounts(self, added: FloatArray) -> FloatArray:
        """Of the projector's red, green and blue in light `added` (N, 3)."""
        return np.maximum(np.maximum(added, 0.0) @ self.unmixing.T, 0.0)

    def nearest(self, amounts: FloatArray, level: FloatArray) -> tuple[IntArray, FloatArray]:
        """Colour index (N,) and its margin (N,) in 0 .. 1, of `amounts` where white is `level`, (N, 3) each."""
        return _nearest(amounts / np.maximum(level, 1e-9), self.centres)


def local_level(amounts: FloatArray, around: IntArray) -> FloatArray:
    """Level of white (N, 3) about each block: of each channel the brightest of `amounts` (M, 3) in the blocks `around`
    it, (N, K) indices or -1, but not below a part of the brightest channel."""
    level = np.empty((len(around), 3))
    kernel.brightest(amounts, around, level)
    return level


def separate_colors(added: FloatArray, around: IntArray, palette: ArrayLike) -> tuple[Colors, IntArray, FloatArray]:
    """What colours look like, and colour index (N,) and margin (N,) of each block, of light `added` (N, 3).

    Projector and camera mix the channels alike everywhere, paint and vignetting scale them from place to
    place: the first is undone once for the picture, by the purest red, green and blue blocks in it, the
    second block by block, by the brightest of each channel among its neighbours. The clusters then move
    to where the picture has them.
    """
    palette = np.asarray(palette, dtype=np.float64) / 255.0
    centres = palette / np.maximum(palette.max(axis=0), 1e-9)
    unmixed = unmixing(np.maximum(added, 0.0), palette)
    amounts = Colors(unmixed, centres).amounts(added)
    seen = amounts / np.maximum(local_level(amounts, around), 1e-9)
    for _ in range(ROUNDS):
        label, margin = _nearest(seen, centres)
        member = np.where(margin > SURE_MARGIN, label, len(centres))
        sums = [np.bincount(member, seen[:, c], len(centres) + 1)[:-1] for c in range(3)]
        counts = np.bincount(member, minlength=len(centres) + 1)[:-1]
        moved = np.stack(sums, axis=-1) / np.maximum(counts, 1)[:, None]
        centres = np.where((counts >= 8)[:, None], moved, centres)
    return Colors(unmixed, centres), *_nearest(seen, centres)


def unmixing(light: FloatArray, palette: FloatArray) -> FloatArray:
    """Matrix from `light` (N, 3) to amounts of the projector's own red, green and blue.

    The chroma of all mixtures lies in the triangle of the three pure ones, so its corners are what red,
    green and blue look like. Needs the three in the palette; otherwise the channels stay as they are.
    """
    total = light.sum(axis=1)
    usable = total > 0
    scale = _quantile(light[usable], 0.95) if usable.any() else np.ones(3)
    scaled = light / np.maximum(scale, 1e-9)
    to_scale = np.diag(1 / np.maximum(scale, 1e-9))
    lit, dark = palette > 0.5, palette < 0.1
    pure = [(lit[:, c] & dark[:, c - 1] & dark[:, c - 2]).any() for c in range(3)]
    if usable.sum() < 30 or not all(pure):
        return to_scale
    chroma = scaled[usable] / scaled[usable].sum(axis=1, keepdims=True)
    count = max(3, int(PURE_SHARE * len(chroma)))
    purest = [chroma[np.argpartition(chroma[:, c], -count)[-count:]] for c in range(3)]
    corners = np.stack([_quantile(blocks, 0.5) for blocks in purest], axis=-1)
    if not (np.linalg.det(corners) > 0.05):
        return to_scale
    return np.linalg.inv(corners) @ to_scale


def _quantile(values: FloatArray, share: float) -> FloatArray:
    """(K,) the value below which that share of each column of (N, K) lies, between the two next to it."""
    at = share * (len(values) - 1)
    low, high = int(at), min(int(at) + 1, len(values) - 1)
    ordered = np.partition(np.ascontiguousarray(values.T), (low, high), axis=1)  # sorting takes five times as long
    return ordered[:, low] + (at - low) * (ordered[:, high] - ordered[:, low])


def _nearest(seen: FloatArray, centres: FloatArray) -> tuple[IntArray, FloatArray]:
    label, margin = np.empty(len(seen), np.int64), np.empty(len(seen))
    kernel.nearest_colors(seen, centres, label, margin)
    return label, margin
