"""What a calibration can be told; apart from it, so that `--help` need not load NumPy."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class CalibrationOptions:
    """How to calibrate.

    Attributes
    ----------
    dense
        Use the decoded points on the board and around it, not only its corners.
    corner_limit
        Leave a corner out that misses by more than this many sigmas.
    view_limit
        Leave a view out if the others fit better without it by more than this factor.
    largest_error
        Refuse when the predicted error exceeds this share of the working distance.
    largest_rms_px
        Refuse when the corners miss by more.
    """

    dense: bool = True
    corner_limit: float = 4.0
    view_limit: float = 3.0
    largest_error: float = 0.01
    largest_rms_px: float = 3.0
