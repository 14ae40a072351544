"""What a calibration can be told; apart from it, so that `--help` need not load NumPy."""

from __future__ import annotations

from dataclasses import dataclass

from retrue.ranges import check_ranges, ranged


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
        Refuse when the predicted error exceeds this share of the working distance; of a larger share where the devices
        stand closer than half of it, and of twice that where one coordinate alone was decoded.
    largest_rms_px
        Refuse when the corners miss by more.
    """

    dense: bool = True
    corner_limit: float = ranged(4.0, 0, above=True)
    view_limit: float = ranged(3.0, 1)
    largest_error: float = ranged(0.01, 0, above=True)
    largest_rms_px: float = ranged(3.0, 0, above=True)

    def __post_init__(self) -> None:
        check_ranges(self)
