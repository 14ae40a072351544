"""Frames of two cameras, each from its own source, put together by the time that names, or arrival, tell."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np

from retrue.files.pairs import words
from retrue.watch.frame import Frame, Position, Source

HELD = 4  # frames of each camera that may wait for the other: pictures take memory
STEPS = 16  # between frames, from which the usual one is known
WAIT = 0.02  # seconds
SAME_MOMENT = 0.25  # of the usual time between two frames of one camera


_Arrivals = queue.Queue["tuple[float, Frame] | Exception | None"]


@dataclass(slots=True)
class _Pending:
    """Frames of one camera that wait for their partner, by moment."""

    frames: dict[float, Frame] = field(default_factory=dict[float, Frame])
    moments: list[float] = field(default_factory=list[float])
    position: Position = field(default_factory=dict[str, Any])

    def add(self, moment: float, frame: Frame) -> None:
        """One more."""
        self.frames[moment] = frame
        self.moments = [*self.moments, moment][-STEPS:]
        self.position = frame.position

    @property
    def interval(self) -> float:
        """The usual time between frames; 0 where nobody knows."""
        steps = np.diff(np.unique(self.moments))
        return float(np.median(steps)) if len(steps) else 0.0

    def saved(self) -> Position:
        """Where to go on, so that those that wait are read again."""
        if "after" not in self.position:
            return self.position
        held = [frame.name for frame in self.frames.values()]
        return {**self.position, "waiting": [*cast("list[str]", self.position.get("waiting", [])), *held]}


@dataclass(slots=True)
class PairedSource:
    """Pairs of two sources: frames whose numbers, as of time stamps, differ by less than a quarter of the usual step.

    Of live cameras, whose frames have no common numbers, the moment of arrival counts. A frame is given up, and named,
    when both cameras went on without its partner.
    """

    first: Source
    second: Source
    _pending: tuple[_Pending, _Pending] = field(default_factory=lambda: (_Pending(), _Pending()))

    @property
    def live(self) -> bool:
        """Whether one of them is."""
        return self.first.live or self.second.live

    def frames(self, stop: threading.Event) -> Iterator[Frame]:
        """Each pair once both are there, in their order; what has no partner, with a problem."""
        ended = threading.Event()
        arrived = (_Arrivals(HELD), _Arrivals(HELD))
        for source, arrivals in zip((self.first, self.second), arrived, strict=True):
            threading.Thread(target=self._grab, args=(source, arrivals, stop, ended), daemon=True).start()
        over = [False, False]
        try:
            while not (stop.is_set() or (all(over) and not any(pending.frames for pending in self._pending))):
                if not self._take(arrived, over):
                    stop.wait(WAIT)
                yield from self._pairs(over)
        finally:
            ended.set()

    def _grab(self, source: Source, arrivals: _Arrivals, stop: threading.Event, ended: threading.Event) -> None:
        """Hand over what a source gives, and at its end None, or what it raised."""
        last: Exception | None = None
        try:
            for count, frame in enumerate(source.frames(stop)):
                moment = time.monotonic() if self.live else _moment(frame.name, float(count))
                _put((moment, frame), arrivals, stop, ended)
                if stop.is_set() or ended.is_set():
                    return
        except Exception as error:
            last = error
        _put(last, arrivals, stop, ended)

    def _take(self, arrived: tuple[_Arrivals, _Arrivals], over: list[bool]) -> bool:
        """One frame, of the camera that fewer wait of; whether there was one. Raises what a source raised."""
        for side in sorted((0, 1), key=lambda side: len(self._pending[side].frames)):
            if over[side] or len(self._pending[side].frames) >= HELD:
                continue
            try:
                item = arrived[side].get_nowait()
            except queue.Empty:
                continue
            if isinstance(item, Exception):
                raise item
            if item is None:
                over[side] = True
            else:
                self._pending[side].add(*item)
            return True
        return False

    def _pairs(self, over: list[bool]) -> Iterator[Frame]:
        """Those that are complete; and what the other camera has passed, or will never reach."""
        left, right = self._pending
        while left.frames and right.frames:
            a, b = min(left.frames), min(right.frames)
            interval = max(left.interval, right.interval)
            if abs(a - b) <= SAME_MOMENT * interval:
                yield self._joined(left.frames.pop(a), right.frames.pop(b))
            elif interval > 0 or all(over):
                yield self._alone(*((left, a) if a < b else (right, b)))
            else:
                return
        for pending, other_over in zip(self._pending, over[::-1], strict=True):
            while pending.frames and other_over:
                yield self._alone(pending, min(pending.frames))

    def _alone(self, pending: _Pending, moment: float) -> Frame:
        frame = pending.frames.pop(moment)
        problem = frame.problem or "no frame of the other camera is of its time"
        return Frame(frame.name, None, self._position(), frame.capture, problem)

    def _joined(self, left: Frame, right: Frame) -> Frame:
        name = left.name if left.name == right.name else f"{left.name}, {right.name}"
        digests = [frame.capture.get("sha256") for frame in (left, right)]
        capture = {"name": name} | ({"sha256": " ".join(map(str, digests))} if all(digests) else {})
        unread = next((frame for frame in (left, right) if frame.content is None), None)
        if unread is not None:
            return Frame(name, None, self._position(), capture, f"{unread.name}: {unread.problem}")
        if not (isinstance(left.content, np.ndarray) and isinstance(right.content, np.ndarray)):
            return Frame(name, None, self._position(), capture, "expected photographs, found tables of points")
        warm = right.temperature if left.temperature is None else left.temperature
        return Frame(name, (left.content, right.content), self._position(), capture, temperature=warm)

    def _position(self) -> Position:
        return {"first": self._pending[0].saved(), "second": self._pending[1].saved()}


def _put(
    item: tuple[float, Frame] | Exception | None, arrivals: _Arrivals, stop: threading.Event, ended: threading.Event
) -> None:
    while not (stop.is_set() or ended.is_set()):
        with suppress(queue.Full):
            arrivals.put(item, timeout=0.1)
            return


def _moment(name: str, otherwise: float) -> float:
    """The last number of a frame's name; its place where there is none."""
    return next((float(word) for word in reversed(words(Path(name).stem)) if isinstance(word, int)), otherwise)
