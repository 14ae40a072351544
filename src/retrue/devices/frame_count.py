"""The frames of a camera, counted by its own period, so that a lost one leaves its number out."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from retrue.devices.protocols import CameraDriver
from retrue.devices.references import grey_levels
from retrue.geometry.arrays import Image

EARLY = 0.5  # of a period: a frame that comes so long before it is due has another lag than those before it
LOST = 0.75  # of a period: one that comes so late is not late, but the one before it is lost
FOLLOWED = 0.1  # of the lateness of a frame, by which all later ones are expected later
MOST_MISSING = 2  # frames, among the last few, that may be lost without a doubt about which is which
RECENT = 8


@dataclass(frozen=True, slots=True, eq=False)
class Counted:
    """A frame.

    Attributes
    ----------
    number : of periods since the count began.
    picture : as the camera gave it. `levels` : the same as uint8.
    at : on the devices' clock. `due` : when it would have come, were it not a little late or early.
    in_step : whether it came about when a frame is due, so that its number can be trusted.
    """

    number: int
    picture: Image
    levels: Image
    at: float
    due: float
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
        if self._last is None:
            number, due, in_step = 0, frame.at, True
        else:
            expected = self._last.due + self._period
            late = (frame.at - expected) / self._period
            lost = 0 if late < LOST else max(1, round(late))
            late -= lost
            self._missing.append(lost)
            number = self._last.number + 1 + lost
            due = expected + (lost + FOLLOWED * late) * self._period
            in_step = late > -EARLY and sum(self._missing) < MOST_MISSING
        self._last = Counted(number, frame.picture, grey_levels(frame.picture), frame.at, due, in_step)
        return self._last
