"""The frames of a camera, counted by its own period, so that a lost one leaves its number out."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from retrue.devices.protocols import CameraDriver
from retrue.devices.references import grey_levels
from retrue.geometry.arrays import Image

BURST = 0.5  # of a period: frames that follow each other faster have waited somewhere
MOST_MISSING = 2  # frames, among the last few, that may be lost without a doubt about which is which
RECENT = 8


@dataclass(frozen=True, slots=True, eq=False)
class Counted:
    """A frame.

    Attributes
    ----------
    number : of periods since the count began.
    picture : as the camera gave it. `levels` : the same as uint8.
    at : on the devices' clock.
    in_step : whether it came when a frame is due, so that its number can be trusted.
    """

    number: int
    picture: Image
    levels: Image
    at: float
    in_step: bool


class FrameCount:
    """Counts on from 0."""

    def __init__(self, camera: CameraDriver, period: float) -> None:
        self._camera, self._period = camera, period
        self._last: Counted | None = None
        self._missing: deque[int] = deque(maxlen=RECENT)

    def next(self) -> Counted:
        """The next frame of the camera."""
        frame = self._camera.frame()
        number, in_step = 0, True
        if self._last is not None:
            periods = (frame.at - self._last.at) / self._period
            step = max(1, round(periods))
            number = self._last.number + step
            self._missing.append(step - 1)
            in_step = periods >= BURST and sum(self._missing) < MOST_MISSING
        self._last = Counted(number, frame.picture, grey_levels(frame.picture), frame.at, in_step)
        return self._last
