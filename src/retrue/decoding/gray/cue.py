"""A Gray code that tells which turn of a sine a pixel sees: stripes, not edges."""

from __future__ import annotations

import numpy as np

from retrue.decoding.gray.plan import UNDECIDED, noise_of_difference
from retrue.decoding.gray.sequence import GraySequence
from retrue.decoding.sequence.noise import FloatImage
from retrue.decoding.sequence.unwrap import Coarse
from retrue.geometry.arrays import BoolArray

NARROW = 4
"""A stripe need not be narrower than that part of a turn; finer bits may be blurred."""
EDGE_REACH = 0.25
"""Stripes: how far from an edge its bit may be undecided."""
BESIDE_EDGE = 0.6
"""Of the contrast: a bit whose pattern and inverse differ by less is seen at its edge, on which side of it a camera's
curve, or white and black that are a little off, may decide."""


def as_cue(sequence: GraySequence, period_px: float) -> GraySequence:
    """The code without bits that are finer than the turns of that sine need."""
    while 2 * NARROW * sequence.stripes[0].width_px <= 2 * period_px:
        coarser = sequence.coarser()
        if coarser is None:
            break
        sequence = coarser
    return sequence


def read_cue(sequence: GraySequence, noise_gain: float, rows: slice) -> tuple[Coarse, BoolArray]:
    """The coordinate of one axis in a band: the middle of the stripe, or the edge where one bit is seen at its edge.

    Returns
    -------
    tuple
        the coordinate, and where the code can be trusted at all.
    """
    (stripes,), (patterns,), (inverses,) = sequence.stripes, sequence.patterns, sequence.inverses
    white, black = sequence.white[rows].astype(np.float32), sequence.black[rows].astype(np.float32)
    decided = np.float32(UNDECIDED) * noise_of_difference(noise_gain, white + black)
    gray = np.zeros(white.shape, np.int32)
    least = np.full(white.shape, np.inf, np.float32)
    second = least.copy()
    unsure = np.zeros_like(gray)
    for place, (pattern, inverse) in enumerate(zip(patterns, inverses, strict=True)):
        bit = len(patterns) - 1 - place
        difference = pattern[rows].astype(np.float32) - inverse[rows]
        margin = np.abs(difference)
        gray |= (difference > 0).astype(np.int32) << bit
        unsure = np.where(margin < least, bit, unsure)
        second = np.minimum(second, np.maximum(least, margin))
        least = np.minimum(least, margin)
    code, other = _number(gray), _number(gray ^ (1 << unsure))
    undecided = least <= decided
    at_edge = (undecided | (least < BESIDE_EDGE * (white - black))) & (np.abs(code - other) == 1)
    width, offset = np.float32(stripes.width_px), np.float32(stripes.offset_px - 0.5)
    px: FloatImage = np.where(at_edge, np.maximum(code, other), code + np.float32(0.5)).astype(np.float32)
    reach = np.where(at_edge & undecided, np.float32(EDGE_REACH), np.float32(0.5)) * width
    inside = (code >= stripes.first) & (code <= stripes.last)
    trusted = (white - black > 2 * decided) & (second > decided) & (~undecided | at_edge) & inside
    return Coarse(px * width + offset, np.zeros_like(px), reach, np.inf), trusted


def _number(gray: np.ndarray) -> np.ndarray:
    """n of the Gray code n ^ (n >> 1), up to 16 bits."""
    for shift in (1, 2, 4, 8):
        gray = gray ^ (gray >> shift)
    return gray
