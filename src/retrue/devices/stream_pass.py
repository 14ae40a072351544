"""Pictures shown one after another at the camera's pace, and the frame of each, which comes some frames late.

Before them and after them a tag is shown, which tells the lag at both ends: another one at each end, and another one
than the pass before began with, so that none is taken for one that is still on its way. A picture's frames are those
between its arrival and that of the next one; two in a row must agree. As soon as frames come early, or more are missing
than one, or two pictures in a row are not found, the count is not to be trusted: the pass ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from retrue.devices.frame_count import RECENT, Counted, FrameCount
from retrue.devices.protocols import CameraDriver, CameraFrame, ProjectorDriver
from retrue.devices.references import References
from retrue.devices.shown_pictures import Picture, coarse_change, tag_pictures
from retrue.geometry.arrays import Image

VISIBLE_CHANGE = 0.4  # of full scale: two pictures that differ so much must look different
SHARE_OF_CHANGE = 0.1  # of white over black by which they must, in some rows


@dataclass(frozen=True, slots=True)
class Pace:
    """How pictures follow each other.

    Attributes
    ----------
    period : seconds between two frames.
    hold : frames that a picture stays for.
    delay : share of a period that passes between the arrival of a frame and the change of the picture.
    """

    period: float
    hold: int
    delay: float


def run_pass(
    camera: CameraDriver,
    projector: ProjectorDriver,
    references: References,
    pictures: Sequence[Picture],
    pace: Pace,
    max_lag: int,
    turn: int,
) -> dict[int, CameraFrame]:
    """The frames of those pictures that are proven, by position; none where the lag was not the same at both ends.

    `turn` is odd and even in turn from pass to pass.
    """
    tags = tag_pictures(projector.size)
    shown = [tags[turn % 2], *pictures, tags[2]]
    ends = references.tags[turn % 2], references.tags[2]
    found = _Pass(camera, projector, references, shown, ends, pace).run(max_lag)
    return {index - 1: frame for index, frame in found.items()}


class _Pass:
    def __init__(
        self,
        camera: CameraDriver,
        projector: ProjectorDriver,
        references: References,
        shown: Sequence[Picture],
        ends: tuple[Image, Image],
        pace: Pace,
    ) -> None:
        self._count = FrameCount(camera, pace.period)
        self._first_end, self._last_end = ends
        self._projector, self._references, self._shown, self._pace = projector, references, shown, pace
        self._shown_at: list[int] = []  # number of the frame at whose arrival each picture was shown
        self._frames: list[Counted] = []  # those that may still be needed
        self._before: Counted | None = None  # what the picture before looked like
        self._found: dict[int, CameraFrame] = {}

    def run(self, max_lag: int) -> dict[int, CameraFrame]:
        lag = self._arrival(0, self._first_end, max_lag)
        if lag is None:
            return {}
        judged, missed = 1, 0
        while judged < len(self._shown) - 1:
            frame = self._take()
            if not frame.in_step or missed == 2:
                return self._certain(judged)
            if len(self._shown_at) > judged + 1 and frame.number >= self._shown_at[judged + 1] + lag - 1:
                missed = 0 if self._judge(judged, lag) else missed + 1
                judged += 1
        return self._found if self._arrival(judged, self._last_end, lag + 2) == lag else {}

    def _take(self) -> Counted:
        """The next frame; shows the next picture when its time has come."""
        frame = self._count.next()
        self._frames.append(frame)
        turn = len(self._shown_at)
        if turn < len(self._shown) and (turn == 0 or frame.number >= self._shown_at[-1] + self._pace.hold):
            self._projector.show(self._shown[turn], frame.due + self._pace.delay * self._pace.period)
            self._shown_at.append(frame.number)
        return frame

    def _judge(self, index: int, lag: int) -> bool:
        """Find the frame of that picture; forget those before it."""
        first, end = self._shown_at[index] + lag, self._shown_at[index + 1] + lag
        window = [frame for frame in self._frames if first <= frame.number < end]
        self._frames = [frame for frame in self._frames if frame.number >= end]
        pairs = [
            (a, b)
            for a, b in pairwise(window)
            if b.number == a.number + 1 and self._references.agree(a.levels, b.levels)
        ]
        if not pairs:
            self._before = None
            return False
        frame = pairs[(len(pairs) - 1) // 2][1 if len(pairs) < 3 else 0]
        change = coarse_change(self._shown[index], self._shown[index - 1])
        if (
            self._before is not None
            and change >= VISIBLE_CHANGE
            and not self._references.differ(frame.levels, self._before.levels, SHARE_OF_CHANGE)
        ):
            self._before = None
            return False
        self._before = frame
        self._found[index] = CameraFrame(frame.picture, frame.at)
        return True

    def _certain(self, judged: int) -> dict[int, CameraFrame]:
        """What was found well before the count became doubtful."""
        doubtful = judged - 2 - RECENT // self._pace.hold
        return {index: frame for index, frame in self._found.items() if index < doubtful}

    def _arrival(self, index: int, looks: Image, most: int) -> int | None:
        """After how many frames that picture is first seen whole; None where it is not, or the count is doubtful."""
        waiting = [frame for frame in self._frames if index and frame.number >= self._shown_at[index]]
        while True:
            frame = waiting.pop(0) if waiting else self._take()
            if not frame.in_step or frame.number > self._shown_at[index] + most:
                return None
            if self._references.matches(frame.levels, looks):
                self._before = frame
                return frame.number - self._shown_at[index]
