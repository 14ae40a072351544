"""The bounded queue between the thread that grabs frames and the one that works on them."""

from __future__ import annotations

import threading
from collections import deque

from retrue.watch.frame import Frame, Source

PAUSE = 0.5  # seconds between two looks at whether we are to stop; each wakes a thread, and a fleet has a hundred


class FrameQueue:
    """At most `size` frames wait. A live source loses its oldest when it is full; any other source waits."""

    def __init__(self, size: int, *, drops: bool) -> None:
        self._frames: deque[Frame] = deque()
        self._size = size
        self._drops = drops
        self._changed = threading.Condition()
        self._closed = False
        self._error: BaseException | None = None
        self._dropped = 0

    def fill_from(self, source: Source, stop: threading.Event) -> None:
        """Grab until the source ends, fails, or `stop` is set; runs in a thread of its own."""
        error: BaseException | None = None
        try:
            for frame in source.frames(stop):
                self._put(frame, stop)
                if stop.is_set():
                    break
        except Exception as failure:  # raised again where the frames are taken
            error = failure
        with self._changed:
            self._closed, self._error = True, error
            self._changed.notify_all()

    def take(self, stop: threading.Event) -> Frame | None:
        """The oldest frame; None at the end, or as soon as `stop` is set. Raises what the source raised."""
        with self._changed:
            while not stop.is_set():
                if self._frames:
                    self._changed.notify_all()
                    return self._frames.popleft()
                if self._error is not None:
                    raise self._error
                if self._closed:
                    return None
                self._changed.wait(PAUSE)
        return None

    def take_dropped(self) -> int:
        """How many were dropped since this was last asked."""
        with self._changed:
            dropped, self._dropped = self._dropped, 0
        return dropped

    def _put(self, frame: Frame, stop: threading.Event) -> None:
        with self._changed:
            while len(self._frames) >= self._size and not stop.is_set():
                if self._drops:
                    self._frames.popleft()
                    self._dropped += 1
                else:
                    self._changed.wait(PAUSE)
            self._frames.append(frame)
            self._changed.notify_all()
