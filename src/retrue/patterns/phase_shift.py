"""Phase-shift sequences to project: a fine sine at several shifts, and what tells its turns."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Literal

from retrue.errors import InputError
from retrue.patterns.layouts import bits_of, gray_frames, sine_frames
from retrue.patterns.sequence import AXES, Frame, FrameSequence

Turns = Literal["gray", "cue", "coprime"]
LARGEST_RATIO = 8.0
"""Of one period to the next finer one: noise of a few hundredths of a turn does not confuse its turns."""
COPRIME_REACH = 9
"""How much longer, in pixels, the other coprime periods may be."""


def make_phase_shift(
    projector_size: tuple[int, int],
    period_px: float = 20.0,
    steps: int = 4,
    turns: Turns = "gray",
    axes: Sequence[Literal["column", "row"]] = AXES,
) -> FrameSequence:
    """A sine of `period_px` at `steps` equal shifts, for each axis, and the pictures that tell its turns.

    Parameters
    ----------
    projector_size : (width, height).
    period_px : of the finest sine; even, where a Gray code tells the turns.
    steps : three or more. Noise falls with their square root; five or more do not see the second harmonic that a
        camera's or projector's curve of brightness adds, seven not the third.
    turns : `gray`: a Gray code with inverses, two stripes a turn, the surest. `cue`: coarser sines, the last of one
        period over the projector. `coprime`: two more sines of nearly the same period, which look alike nowhere twice.
    axes : columns, rows or both.

    >>> make_phase_shift((1024, 768)).picture_count, make_phase_shift((1024, 768), turns="coprime").picture_count
    (36, 24)
    """
    if not 3 <= steps <= 100:
        raise InputError(f"steps: expected 3 to 100 shifts, found {steps}")
    if not 4 <= period_px <= max(projector_size):
        raise InputError(f"period: expected 4 to {max(projector_size)} projector pixels, found {period_px:g}")
    frames: list[Frame] = []
    for axis in axes:
        side = projector_size[AXES.index(axis)]
        frames += sine_frames(axis, period_px, steps)
        if turns == "gray":
            if period_px != int(period_px) or int(period_px) % 2:
                raise InputError(f"period: expected an even number of pixels for a Gray code, found {period_px:g}")
            stripe = int(period_px) // 2
            bits = range(bits_of(-(-side // stripe)))[::-1]
            frames += gray_frames(axis, bits, inverses=True, step_px=stripe)
        elif turns == "cue":
            for coarser in _ladder(period_px, side):
                frames += sine_frames(axis, coarser, steps)
        else:
            for other in _coprime(period_px, side):
                frames += sine_frames(axis, other, steps)
    return FrameSequence(projector_size, tuple(frames))


def _ladder(period_px: float, side: int) -> list[float]:
    """Coarser periods in equal ratios up to the projector's side."""
    count = 1
    while (side / period_px) ** (1 / count) > LARGEST_RATIO:
        count += 1
    return [float(side) if k == count else period_px * (side / period_px) ** (k / count) for k in range(1, count + 1)]


def _coprime(period_px: float, side: int) -> tuple[float, float]:
    """Two longer periods with which the sine's turns are told apart best: by the largest distance of any two."""

    def distance(pair: tuple[float, float]) -> float:
        turns = range(1, -(-side // int(period_px)) + 1)
        off = [[turn * period_px / other for other in pair] for turn in turns]
        return min(sum((each - round(each)) ** 2 for each in turn) for turn in off)

    longer = [period_px + extra for extra in range(1, COPRIME_REACH + 1)]
    return max(combinations(longer, 2), key=distance)
