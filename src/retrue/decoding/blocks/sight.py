"""What the decoder saw of a colour grid, step by step: the record that drawings are made of, and advice."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from retrue.decoding.blocks.blobs import Blocks
from retrue.decoding.blocks.links import Links
from retrue.decoding.pictures import unusable_picture
from retrue.geometry.arrays import FloatArray, Image, IntArray
from retrue.patterns.color_grid import ColorGrid

GOOD_COUNT = 30  # points that a job can work with
SMALLEST_BLOCK = 5.0  # px
LINE_SURROUNDINGS = 16  # in a picture's side
LINE_CONTRAST = 0.3  # of the picture's scatter
NET_SHARE = 0.4  # of the picture's width and height
THINNEST_NET, THICKEST_NET = 0.15, 0.5  # of the box around it that the net fills


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
    block_px : median side of the decoded blocks, or of all blobs that have two neighbours, in px of `picture`; 0: none.
    blocks, links : in pixels of the halved picture.
    label : (N,) colour index of each blob.
    verdict : (N,) a `Verdict` each.
    holder : (rows, columns) blob that holds the block, or -1.
    light : (rows, columns, 3) what each block adds to its surroundings, in grey levels of eight bits.
    centre_px, sigma_px, confidence, color : of every block that was decoded, in pixels of `picture`.
    """

    pattern: ColorGrid
    picture: Image
    halvings: int
    block_px: float
    blocks: Blocks
    links: Links
    label: IntArray
    verdict: IntArray
    holder: IntArray
    centre_px: FloatArray
    sigma_px: FloatArray
    confidence: FloatArray
    color: NDArray[np.uint8]
    light: FloatArray

    def rejected(self) -> dict[str, int]:
        """How many blobs were rejected, by reason."""
        counts = np.bincount(self.verdict, minlength=len(Verdict))
        return {v.reason: int(counts[v]) for v in Verdict if v != Verdict.DECODED and counts[v]}


NOT_THIS = "not this pattern: a grid is there, but its colours are not those of this code"
MIRRORED = (
    "the projector's picture is mirrored, or the camera's"
    " (rear projection, a ceiling setting, a driver's, or seen in a mirror): switch it off"
)
LINES = "a grid of lines, the pattern is of blocks: give the pattern that was shown, or project a colour grid"


def advise(sight: GridSight, decoded: int) -> str:
    """One sentence for the user; empty where there is nothing to say."""
    if decoded >= GOOD_COUNT:
        return ""
    if unusable := unusable_picture(sight.picture):
        return unusable
    linked = int(((sight.links.neighbour >= 0).sum(axis=1) >= 3).sum())
    if linked < GOOD_COUNT:
        if _shows_lines(sight.picture):
            return LINES
        return "no grid seen: out of focus, or blocks smaller than 5 px: focus, move closer or use a coarser grid"
    if sight.block_px < SMALLEST_BLOCK:
        return "blocks smaller than 5 px: move closer or use a coarser grid"
    return NOT_THIS


def _shows_lines(picture: Image) -> bool:
    """Whether what is brighter than its surroundings hangs together as a net over much of the (h, w, 3) picture."""
    grey: NDArray[np.float32] = picture.max(axis=-1).astype(np.float32)
    side = max(3, min(grey.shape) // LINE_SURROUNDINGS)
    around = cast(NDArray[np.float32], cv2.blur(grey, (side, side)))
    bright = np.asarray(grey > around + LINE_CONTRAST * float(grey.std()), dtype=np.uint8)
    opened = cv2.morphologyEx(bright, cv2.MORPH_OPEN, np.ones((2, 2), np.uint8))
    _, _, boxes, _ = cv2.connectedComponentsWithStats(opened, connectivity=4)
    if len(boxes) < 2:
        return False
    *_, width, height, area = (float(value) for value in max(boxes[1:].tolist(), key=lambda box: box[4]))
    wide = width > NET_SHARE * grey.shape[1] and height > NET_SHARE * grey.shape[0]
    return wide and THINNEST_NET < area / (width * height) < THICKEST_NET
