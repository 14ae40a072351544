"""How to read a Gray-code capture, from a sample of its pixels: noise, direction and width of the stripes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from retrue.decoding.gray.bits import CodeImage, decode_axis, neighbours
from retrue.decoding.gray.faults import require_order
from retrue.decoding.gray.sequence import GraySequence
from retrue.decoding.gray.stripe_edges import FloatImage
from retrue.geometry.arrays import Image

MAX_CELL = 32
"""Pixels: bands start at multiples of it, so that the cells of all bands lie on one grid."""
UNDECIDED = 3.0
"""Standard deviations: a bit whose pattern and inverse differ by less is undecided."""
LIT = 0.1
"""Of the strongest contrast: pixels to learn the noise from."""
STRIPS, STRIP_WIDTH = 8, 4
CHI_SQUARE_MEDIAN = 0.455


@dataclass(frozen=True, slots=True)
class Plan:
    """What the pictures themselves tell about how to read them.

    Attributes
    ----------
    noise_gain : variance of a picture's noise per unit of brightness (shot noise).
    resolved : share of the lit pixels that decide their code.
    along : for each axis of the code, the array axis along which its stripes follow each other more quickly.
    cells : for each axis of the code, the power of two (2 to MAX_CELL) nearest to a stripe's width in camera pixels.
    """

    noise_gain: float
    resolved: float
    along: tuple[int, ...]
    cells: tuple[int, ...]


def plan_reading(sequence: GraySequence) -> Plan:
    """From strips of rows and of columns. Raises `CaptureError` where bits are not in the pattern's order."""
    noise_gain = _noise_gain(sequence)
    axes = [_plan_axis(sequence, axis, noise_gain) for axis in range(len(sequence.stripes))]
    resolved = min(share for _, _, share in axes)
    return Plan(noise_gain, resolved, tuple(along for along, _, _ in axes), tuple(cell for _, cell, _ in axes))


def noise_of_difference(noise_gain: float, brightness: FloatImage) -> FloatImage:
    """Standard deviation of pattern - inverse where white + black is `brightness`; rounding leaves some, too."""
    return np.sqrt(np.maximum(np.float32(noise_gain) * brightness, np.float32(0.5)))


def _plan_axis(sequence: GraySequence, axis: int, noise_gain: float) -> tuple[int, int, float]:
    """Direction and cell of one axis of the code, and the share of lit pixels that decide it."""
    seen = [_neighbouring_codes(sequence, axis, along, noise_gain) for along in range(2)]
    steps = [float(np.count_nonzero(np.abs(b - a) == 1)) / max(len(a), 1) for a, b, _ in seen]
    along = 0 if steps[0] > steps[1] else 1
    code, neighbour, share = seen[along]
    require_order(code, neighbour, sequence.names[axis], ("column", "row")[sequence.stripes[axis].axis])
    stripe = 1 / max(steps[along], 1 / MAX_CELL)
    return along, min(max(2 ** round(math.log2(stripe)), 2), MAX_CELL), share


def _neighbouring_codes(
    sequence: GraySequence, axis: int, along: int, noise_gain: float
) -> tuple[CodeImage, CodeImage, float]:
    """Trusted codes (N,) of pixels, and of their neighbours along an array axis; and the share of lit ones."""
    patterns, inverses = (
        [_strips(image, along) for image in kind[axis]] for kind in (sequence.patterns, sequence.inverses)
    )
    read = decode_axis(patterns, inverses, along)
    white, black = (_strips(image, along).astype(np.float32) for image in (sequence.white, sequence.black))
    decided = np.float32(UNDECIDED) * noise_of_difference(noise_gain, white + black)
    lit = white - black > 2 * decided
    good = lit & (read.second_margin > decided)
    here, there = neighbours(along)
    both = good[here] & good[there]
    share = float(np.count_nonzero(good)) / max(int(np.count_nonzero(lit)), 1)
    return read.code[here][both], read.code[there][both], share


def _noise_gain(sequence: GraySequence) -> float:
    """Pattern + inverse is the same for every bit, but for the noise of four pictures; of the finest two bits.

    Without inverses: what the coarsest patterns differ from white, or from black; what stands for the difference of
    pattern and inverse, 2 pattern - white - black, has three times the variance of a true one.
    """
    axis = int(np.argmax([len(patterns) for patterns in sequence.patterns]))
    white, black = (_strips(image, 1).astype(np.float32) for image in (sequence.white, sequence.black))
    lit = white - black > LIT * float((white - black).max())
    if not sequence.paired:
        pattern = _strips(sequence.patterns[axis][0], 1).astype(np.float32)
        nearest = np.where(np.abs(white - pattern) < np.abs(pattern - black), white, black)
        gains = np.square(pattern - nearest)[lit] / np.maximum(nearest, 1)[lit]
        return 3 * float(np.median(gains)) / (2 * CHI_SQUARE_MEDIAN) if len(gains) else 0.0
    pairs = list(zip(sequence.patterns[axis][-2:], sequence.inverses[axis][-2:], strict=True))
    if len(pairs) < 2:
        return 0.0
    first, second = (_strips(pattern, 1).astype(np.float32) + _strips(inverse, 1) for pattern, inverse in pairs)
    gains = np.square(first - second)[lit] / np.maximum(white + black, 1)[lit]
    return float(np.median(gains)) / (2 * CHI_SQUARE_MEDIAN) if len(gains) else 0.0


def _strips(image: Image, along: int) -> Image:
    """Narrow strips, side by side, that run the whole length of the picture along an array axis."""
    side = image.shape[1 - along]
    starts = ((np.arange(STRIPS) + 0.5) / STRIPS * (side - STRIP_WIDTH)).astype(int)
    lines = np.unique(np.clip(starts[:, None] + np.arange(STRIP_WIDTH), 0, side - 1))
    return np.take(image, lines, axis=1 - along)
