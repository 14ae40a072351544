"""The watch: decode and verify each frame; where the rig has drifted, recalibrate, judge, write in place, go on."""

from __future__ import annotations

import threading
import time
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from retrue.answers import Reason, answer_report
from retrue.correspondences import Correspondences
from retrue.errors import FileError, RetrueError
from retrue.files.history import write_in_place
from retrue.files.rigs import read_rig
from retrue.recalibration.result import Accepted, Verification, unattended
from retrue.recalibration.streak import (
    Drifted,
    Streak,
    after_drifted,
    after_good,
    after_refusal,
    after_unknown,
    attempts,
    is_due,
)
from retrue.rig import Rig
from retrue.watch.events import EventLog
from retrue.watch.frame import Frame, Source
from retrue.watch.frame_queue import FrameQueue
from retrue.watch.options import WatchOptions
from retrue.watch.stages import Stages
from retrue.watch.state import WatchState, write_state


@dataclass(frozen=True, slots=True)
class FramesHold(Reason):
    """The frames together do not contradict the rig."""

    def __str__(self) -> str:
        return "the frames together say that the rig still holds"


@dataclass(frozen=True, slots=True)
class FramesDisagree(Reason):
    """The pose from all frames is not that of each."""

    def __str__(self) -> str:
        return "the frames do not agree on one pose: the rig, or something before it, is still moving"


@dataclass(frozen=True, slots=True)
class AttemptFailed(Reason):
    """An error came in between, as of a full disk."""

    problem: str

    def __str__(self) -> str:
        return self.problem


@dataclass(frozen=True, slots=True, eq=False)
class _Kept:
    """A drifted frame that may be recalibrated from."""

    name: str
    capture: Mapping[str, str]
    points: Correspondences


@dataclass(slots=True)
class Watch:
    """Looks after one rig file. Memory is bounded by its options: it keeps a few drifted frames and no more.

    Attributes
    ----------
    rig_path : read again whenever somebody else has changed it; a rig is only written together with its history.
    state_path : where to go on after the end, saved after each frame.
    """

    rig_path: Path
    stages: Stages
    events: EventLog
    state: WatchState
    state_path: Path
    options: WatchOptions = field(default_factory=WatchOptions)
    _rig: Rig | None = None
    _stamp: tuple[int, ...] = ()
    _streak: Streak = field(default_factory=Streak)
    _kept: dict[int, _Kept] = field(default_factory=dict[int, _Kept])

    def run(self, source: Source, stop: threading.Event) -> dict[str, Any]:
        """Until the source ends or `stop` is set; returns the last event. Raises what the source raises."""
        resumed = bool(self.state.position)
        self._rig_in_place()
        self.events.write("started", rig=self.rig_path, source=self.state.source, resumed=resumed)
        queue = FrameQueue(self.options.queue, drops=source.live)
        ended = threading.Event()
        grabber = threading.Thread(target=queue.fill_from, args=(source, ended), daemon=True)
        grabber.start()
        reason = "failed"
        try:
            while (frame := queue.take(stop)) is not None:
                self._count_dropped(queue.take_dropped())
                self.handle(frame)
            reason = "stopped" if stop.is_set() else "the source ended"
        finally:
            ended.set()
            grabber.join(timeout=5.0)  # a camera that hangs must not keep us
            self._count_dropped(queue.take_dropped())
            write_state(self.state_path, self.state)
            last = self.events.write("stopped", reason=reason, **asdict(self.state.counts))
        return last

    def handle(self, frame: Frame) -> None:
        """One frame, whatever it holds."""
        self.state.counts.frames += 1
        seconds: dict[str, float] = {}
        try:
            if frame.content is None:
                raise FileError(frame.name, frame.problem)
            rig = self._rig_in_place()
            with _timed(seconds, "decode"):
                points = self.stages.decode(frame)
            with _timed(seconds, "verify"):
                found = self.stages.verify(rig, [points])
        except Exception as error:  # a picture may hold anything, and must not end a watch of weeks
            self.state.counts.bad += 1
            self._write("bad frame", frame, reason=_one_line(error), seconds=seconds)
        else:
            self._follow(frame, points, found)
            suspect = found.verdict == "drifted" or bool(self._streak.drifted)
            cloud = None if suspect else self._cloud(rig, points, frame.name, seconds)
            self._write("frame", frame, **_verification_values(found), cloud=cloud, seconds=seconds)
            if is_due(self._streak, self.options):
                self._recalibrate(rig)
        self.state.position = frame.position
        write_state(self.state_path, self.state)

    def _follow(self, frame: Frame, points: Correspondences, found: Verification) -> None:
        counts = self.state.counts
        setattr(counts, found.verdict, getattr(counts, found.verdict) + 1)
        if found.verdict == "good":
            self._streak = after_good()
        elif found.verdict == "unknown":
            self._streak = after_unknown(self._streak, self.options)
        else:
            sigma = float("inf") if found.sigma is None else found.sigma.rotation_deg + found.sigma.translation_deg
            self._streak = after_drifted(self._streak, Drifted(counts.frames, sigma), self.options)
            self._kept[counts.frames] = _Kept(frame.name, frame.capture, points)
        remembered = {drifted.number for drifted in self._streak.drifted}
        self._kept = {number: kept for number, kept in self._kept.items() if number in remembered}

    def _recalibrate(self, rig: Rig) -> None:
        causes: list[Reason] = []
        seconds: dict[str, float] = {}
        for numbers in attempts(self._streak, self.options):
            kept = [self._kept[number] for number in numbers]
            with _timed(seconds, "recalibrate"):
                cause = self._attempt(rig, kept, seconds)
            if cause is None:
                return
            causes.append(cause)
        self._streak = after_refusal(self._streak)
        self.state.counts.refused += 1
        reason = "; ".join(dict.fromkeys(map(str, causes)))
        self.events.write("refused", verdict="refused", cause=causes[0].name, reason=reason, seconds=seconds)

    def _attempt(self, rig: Rig, kept: Sequence[_Kept], seconds: dict[str, float]) -> Reason | None:
        """Recalibrate from these frames and write the rig; why not, where not."""
        captures = [item.points for item in kept]
        try:
            result = unattended(self.stages.recalibrate(rig, captures))
            if not isinstance(result, Accepted):
                return result.cause
            if result.unchanged:
                return FramesHold()
            verdicts = [self.stages.verify(result.rig, [points]).verdict for points in captures]
            if "drifted" in verdicts or "good" not in verdicts:
                return FramesDisagree()
            entry = write_in_place(self.rig_path, result, [item.capture for item in kept])
        except Exception as error:  # a full disk may have room again, and other frames follow
            return AttemptFailed(_one_line(error))
        self._rig, self._stamp = result.rig, _stamp(self.rig_path)
        clouds = [self._cloud(result.rig, item.points, item.name, seconds) for item in self._kept.values()]
        self._streak, self._kept = Streak(), {}
        self.state.counts.recalibrated += 1
        self.events.write(
            "recalibrated",
            history_id=entry.id,
            frames=[item.name for item in kept],
            **answer_report(result),
            change=entry.evidence["change"],
            sigma=entry.evidence["sigma"],
            clouds=[cloud for cloud in clouds if cloud is not None],
            seconds=dict(seconds),
        )
        return None

    def _cloud(self, rig: Rig, points: Correspondences, name: str, seconds: dict[str, float]) -> Path | None:
        if self.stages.write_cloud is None:
            return None
        try:
            with _timed(seconds, "cloud"):
                return self.stages.write_cloud(rig, points, name)
        except RetrueError as error:
            self.events.write("no cloud", name=name, reason=_one_line(error))
            return None

    def _rig_in_place(self) -> Rig:
        """The rig in the file: whoever changes it, by hand or by a rollback, is obeyed from the next frame on."""
        stamp = _stamp(self.rig_path)
        if self._rig is None or stamp != self._stamp:
            first, self._stamp = self._rig is None, stamp
            try:
                self._rig = read_rig(self.rig_path)
            except FileError as error:
                if self._rig is None:
                    raise
                self.events.write("rig unreadable", reason=str(error))  # the one that we know is as good as ever
                return self._rig
            self._streak, self._kept = Streak(), {}
            if not first:
                self.events.write("rig changed", rig=self.rig_path)
        return self._rig

    def _count_dropped(self, count: int) -> None:
        if count:
            self.state.counts.dropped += count
            self.events.write("dropped", count=count)

    def _write(self, event: str, frame: Frame, **values: Any) -> None:
        self.events.write(event, number=self.state.counts.frames, name=frame.name, **values)


def _verification_values(found: Verification) -> dict[str, Any]:
    return {
        **answer_report(found),
        "band": found.band,
        "correspondences": found.correspondences,
        "epipolar_rms_px": found.epipolar_rms_px,
        "drift": None if found.drift is None else asdict(found.drift),
        "drift_sigmas": found.drift_sigmas,
    }


def _stamp(path: Path) -> tuple[int, ...]:
    """Changes when the file does; a missing file has one too, and is reported when it is read."""
    try:
        status = path.stat()
    except OSError:
        return ()
    return status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns


def _one_line(error: Exception) -> str:
    text = error.problem if isinstance(error, FileError) else str(error)
    kind = "" if isinstance(error, RetrueError) else f"{type(error).__name__}: "
    return " ".join(f"{kind}{text}".split())


@contextmanager
def _timed(seconds: dict[str, float], stage: str) -> Generator[None]:
    start = time.perf_counter()
    try:
        yield
    finally:
        seconds[stage] = seconds.get(stage, 0.0) + time.perf_counter() - start
