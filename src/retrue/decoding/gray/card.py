"""What a Gray-code decoder has to say about a capture: counts, reasons, and what to change."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from retrue.decoding.gray.faults import CAPTURE
from retrue.decoding.gray.sequence import GraySequence
from retrue.errors import CaptureError

REASONS = {
    "undecided": "pattern and inverse too alike in more than one bit",
    "outside": "code beyond the projector",
    "alone": "too few stripe edges around, or all to one side",
    "rough": "stripe edges around do not lie on one surface",
}


def decode_card(sequence: GraySequence, points: int, counts: Sequence[Mapping[str, int]]) -> dict[str, Any]:
    """Counts of pixels: all, lit, decoded, rejected by reason; coverage of the picture; advice.

    Raises `CaptureError` where nothing was decoded.
    """
    total = {key: sum(count[key] for count in counts) for key in counts[0]}
    lit, pixels = total["lit"], sequence.white.size
    rejected = {
        "undecided": lit - total["agreed"],
        "outside": total["outside"],
        "alone": total["alone"],
        "rough": total["rough"],
    }
    if points == 0:
        reason = max(rejected, key=lambda name: rejected[name])
        what = f"{rejected[reason]} of {lit} lit pixels: {REASONS[reason]}" if lit else "no pixel is lit"
        raise CaptureError(CAPTURE, f"nothing decodes: {what}; do the pictures show this pattern?")
    return {
        "pixels": pixels,
        "lit": lit,
        "points": points,
        "coverage": points / pixels,
        "rejected": rejected,
        "advice": _advice(sequence, lit, rejected),
    }


def _advice(sequence: GraySequence, lit: int, rejected: Mapping[str, int]) -> list[str]:
    advice: list[str] = []
    pixels = sequence.white.size
    if lit < 0.2 * pixels:
        advice.append(f"the projector lights {100 * lit / pixels:.0f} % of the picture: turn it towards the scene")
    if rejected["undecided"] > 0.5 * lit:
        advice.append("most pixels do not resolve the finest stripes: focus, expose longer, or use a larger step")
    if rejected["alone"] > 0.5 * lit:
        advice.append("stripe edges are sparse: noise or texture hides them; expose longer")
    white = sequence.white[::4, ::4]
    saturated = float(np.mean(white >= np.iinfo(white.dtype).max))
    if saturated > 0.05:
        advice.append(f"{100 * saturated:.0f} % of the white picture is overexposed: shorten the exposure")
    return advice
