"""What the decoder saw of a colour grid, step by step: the record that drawings and advice are made of."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from retrue.decoding.blocks.blobs import Blocks
from retrue.decoding.blocks.links import Links
from retrue.geometry.arrays import FloatArray, Image, IntArray
from retrue.patterns.color_grid import ColorGrid


class Verdict(IntEnum):
    """What became of a blob."""

    DECODED = 0
    ALONE = 1
    NO_PLACE = 2
    TOO_FEW = 3
    DOUBLED = 4
    OFF_SURFACE = 5

    @property
    def reason(self) -> str:
        return REASONS[self]


REASONS = {
    Verdict.DECODED: "decoded",
    Verdict.ALONE: "no neighbours",
    Verdict.NO_PLACE: "colours fit no place of the code",
    Verdict.TOO_FEW: "surface too small to be sure",
    Verdict.DOUBLED: "place taken by a surer block",
    Verdict.OFF_SURFACE: "cut, or off its surface",
}


@dataclass(frozen=True, slots=True, eq=False)
class GridSight:
    """One look at a picture. N blobs; grid arrays are (rows, columns) of the code, NaN where nothing is.

    Attributes
    ----------
    picture : (h, w, 3) that was looked at, in full size.
    halvings : how many times it was halved to find the blocks.
    blocks, links : in pixels of the halved picture.
    label : (N,) colour index of each blob.
    verdict : (N,) a `Verdict` each.
    holder : (rows, columns) blob that holds the place, or -1.
    centre_px, sigma_px, confidence, color : of every place that was decoded, in pixels of `picture`.
    """

    pattern: ColorGrid
    picture: Image
    halvings: int
    blocks: Blocks
    links: Links
    label: IntArray
    verdict: IntArray
    holder: IntArray
    centre_px: FloatArray
    sigma_px: FloatArray
    confidence: FloatArray
    color: NDArray[np.uint8]

    @property
    def block_px(self) -> float:
        """Median side of the decoded blocks, or of all blobs that have a neighbour, in pixels of `picture`; 0: none."""
        good = self.verdict == Verdict.DECODED
        if not good.any():
            good = (self.links.neighbour >= 0).sum(axis=1) >= 2
        if not good.any():
            return 0.0
        return float(np.median(np.sqrt(12 * self.blocks.area()[good]))) * 2**self.halvings

    def rejected(self) -> dict[str, int]:
        """How many blobs were rejected, by reason."""
        counts = np.bincount(self.verdict, minlength=len(Verdict))
        return {v.reason: int(counts[v]) for v in Verdict if v != Verdict.DECODED and counts[v]}
