"""How to read a Gray-code capture, from a sample of its rows: noise, direction and width of the stripes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from retrue.decoding.gray_bits import CodeImage, decode_axis, neighbours
from retrue.decoding.gray_faults import require_order, swapped_bits
from retrue.decoding.gray_sequence import GraySequence
from retrue.decoding.gray_subpixel import FloatImage
from retrue.geometry.arrays import BoolArray

MAX_CELL = 32
"""Pixels: bands start at multiples of it, so that the cells of all bands lie on one grid."""
SAMPLE_EVERY, SAMPLE_ROWS = 128, 8
CHI_SQUARE_MEDIAN = 0.455


@dataclass(frozen=True, slots=True)
class Plan:
    """What the pictures themselves tell about how to read them.

    Attributes
    ----------
    noise_gain : variance of a picture's noise per unit of brightness (shot noise).
    along : for each axis of the code, the array axis along which its stripes follow each other more quickly.
    cells : for each axis of the code, the power of two (2 to MAX_CELL) nearest to a stripe's width in camera pixels.
    """

    noise_gain: float
    along: tuple[int, int]
    cells: tuple[int, int]

    def noise(self, white: FloatImage, black: FloatImage) -> FloatImage:
        """Standard deviation of pattern - inverse; no less than rounding to integers leaves."""
        return np.sqrt(np.maximum(np.float32(self.noise_gain) * (white + black), np.float32(0.5)))


def plan_reading(sequence: GraySequence) -> Plan:
    """From some blocks of rows. Raises `CaptureError` where bits are not in the pattern's order."""
    height = sequence.white.shape[0]
    blocks = [
        slice(start, start + SAMPLE_ROWS) for start in range(min(SAMPLE_EVERY, height) // 2, height, SAMPLE_EVERY)
    ]
    contrasts = [sequence.white[rows].astype(np.float32) - sequence.black[rows] for rows in blocks]
    least = 0.1 * max(float(contrast.max()) for contrast in contrasts)
    lit = [contrast > least for contrast in contrasts]
    directions, cells = zip(*(_plan_axis(sequence, axis, blocks, lit) for axis in range(2)), strict=True)
    return Plan(_noise_gain(sequence, blocks, lit), directions, cells)


def _plan_axis(sequence: GraySequence, axis: int, blocks: Sequence[slice], lit: Sequence[BoolArray]) -> tuple[int, int]:
    """Direction and cell of one axis of the code."""
    codes: list[CodeImage] = []
    for rows in blocks:
        patterns, inverses = ([image[rows] for image in kind[axis]] for kind in (sequence.patterns, sequence.inverses))
        codes.append(decode_axis(patterns, inverses, along=1).code)
    pairs: list[tuple[CodeImage, CodeImage]] = []
    for along in range(2):
        here, there = neighbours(along)
        both = [block[here] & block[there] for block in lit]
        firsts, seconds = (
            np.concatenate([code[side][ok] for code, ok in zip(codes, both, strict=True)]) for side in (here, there)
        )
        pairs.append((firsts, seconds))
    steps = [float(np.mean(np.abs(second - first) == 1)) if len(first) else 0.0 for first, second in pairs]
    along = int(np.argmax(steps))
    names = sequence.names[axis]
    require_order(swapped_bits(*pairs[along], len(names)), names, ("column", "row")[axis])
    stripe = 1 / max(steps[along], 1 / MAX_CELL)
    return along, int(2 ** np.clip(np.round(np.log2(stripe)), 1, np.log2(MAX_CELL)))


def _noise_gain(sequence: GraySequence, blocks: Sequence[slice], lit: Sequence[BoolArray]) -> float:
    """Pattern + inverse is the same for every bit, but for the noise of four pictures; of the finest two bits."""
    axis = int(np.argmax([len(patterns) for patterns in sequence.patterns]))
    patterns, inverses = sequence.patterns[axis][-2:], sequence.inverses[axis][-2:]
    gains: list[FloatImage] = []
    for rows, block in zip(blocks, lit, strict=True):
        first, *others = (p[rows].astype(np.float32) + i[rows] for p, i in zip(patterns, inverses, strict=True))
        brightness = np.maximum(sequence.white[rows].astype(np.float32) + sequence.black[rows], 1)
        gains += [np.square(first - other)[block] / brightness[block] for other in others]
    values = np.concatenate(gains) if gains else np.zeros(0, np.float32)
    return float(np.median(values)) / (2 * CHI_SQUARE_MEDIAN) if len(values) else 0.0
