"""The watch: decode and verify each frame; where the rig has drifted, recalibrate, judge, write in place, go on."""

from __future__ import annotations

import threading
import time
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from retrue.answers import Reason, answer_report
from retrue.correspondences import Correspondences, each_once, same_points
from retrue.errors import FileError, RetrueError
from retrue.files.history import read_history, write_in_place
from retrue.files.rigs import read_rig
from retrue.recalibration.creep import creep_is_due
from retrue.recalibration.result import Accepted, Verification, unattended
from retrue.recalibration.streak import after_refusal, attempts, is_due
from retrue.rig import Rig
from retrue.watch.events import EventLog
from retrue.watch.frame import Frame, Source
from retrue.watch.frame_queue import FrameQueue
from retrue.watch.memory import Kept, Memory, creep_values
from retrue.watch.options import WatchOptions
from retrue.watch.record import supported
from retrue.watch.stages import Stages
from retrue.watch.state import WatchState, write_state
from retrue.watch.temperature import last_reading

LOOKED_BACK = 100  # entries of the history among which damage is looked for


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


@dataclass(slots=True)
class Watch:
    """Looks after one rig file. Memory is bounded by its options: it keeps a few drifted frames and no more.

    Attributes
    ----------
    rig_path : read again whenever somebody else has changed it; a rig is only written together with its history.
    state_path : where to go on after the end, saved after each frame.
    temperature : a table that somebody writes; its last value stands beside each frame.
    """

    rig_path: Path
    stages: Stages
    events: EventLog
    state: WatchState
    state_path: Path
    options: WatchOptions = field(default_factory=WatchOptions)
    temperature: Path | None = None
    _rig: Rig | None = None
    _stamp: tuple[int, ...] = ()
    _memory: Memory = field(init=False)
    _told: set[str] = field(default_factory=set[str])

    def __post_init__(self) -> None:
        self._memory = Memory(self.state_path.parent / "drifted")

    def run(self, source: Source, stop: threading.Event) -> dict[str, Any]:
        """Until the source ends or `stop` is set; returns the last event. Raises what the source raises."""
        resumed = bool(self.state.position)
        self._rig_in_place()
        self.events.write("started", rig=self.rig_path, source=self.state.source, resumed=resumed)
        self._tell_damage()
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
            self._save()
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
            counts, memory = self.state.counts, self._memory
            setattr(counts, found.verdict, getattr(counts, found.verdict) + 1)
            memory.add(counts.frames, rig, frame, points, found, self.options)
            suspect = found.verdict == "drifted" or bool(memory.streak.drifted)
            cloud = None if suspect else self._cloud(rig, points, frame.name, seconds)
            warm = last_reading(self.temperature) if frame.temperature is None else frame.temperature
            beside = {"creep": creep_values(memory.creep), "temperature": warm}
            self._write(
                "frame", frame, **_verification_values(found), unit=rig.unit, **beside, cloud=cloud, seconds=seconds
            )
            if is_due(memory.streak, self.options):
                self._recalibrate(rig)
            elif self._creep_is_due():
                self._recalibrate_crept(rig)
        self.state.position = frame.position
        self._save()

    def _save(self) -> None:
        self.state.memory = {"rig": list(self._stamp), **self._memory.document()}
        write_state(self.state_path, self.state)

    def _creep_is_due(self) -> bool:
        memory, limits = self._memory, self.options
        enough = len(memory.recent) >= min(limits.joint_frames, limits.remembered_frames)  # not so after a restart
        return enough and not memory.streak.drifted and creep_is_due(memory.creep, limits.creep)

    def _recalibrate(self, rig: Rig) -> None:
        kind = "bump" if self._memory.jumped else "creep"
        causes: list[Reason] = []
        seconds: dict[str, float] = {}
        for numbers in attempts(self._memory.streak, self.options):
            kept = [self._memory.kept[number] for number in numbers]
            with _timed(seconds, "recalibrate"):
                cause = self._attempt(rig, kept, seconds, kind)
            if cause is None:
                return
            causes.append(cause)
        self._memory.streak = after_refusal(self._memory.streak)
        self._refuse(kind, causes, seconds)

    def _recalibrate_crept(self, rig: Rig) -> None:
        """From the surest of the last frames; each of them may still be good."""
        kept = sorted(self._memory.recent, key=lambda item: item.uncertainty_deg)[: self.options.joint_frames]
        seconds: dict[str, float] = {}
        with _timed(seconds, "recalibrate"):
            cause = self._attempt(rig, kept, seconds, "creep")
        if cause is not None and self._memory.creep is not None:
            self._memory.creep = replace(self._memory.creep, rested=0)
            self._refuse("creep", [cause], seconds)

    def _refuse(self, kind: str, causes: Sequence[Reason], seconds: dict[str, float]) -> None:
        self.state.counts.refused += 1
        reason = "; ".join(dict.fromkeys(map(str, causes)))
        self.events.write("refused", kind=kind, verdict="refused", cause=causes[0].name, reason=reason, seconds=seconds)

    def _attempt(self, rig: Rig, kept: Sequence[Kept], seconds: dict[str, float], kind: str) -> Reason | None:
        """Recalibrate from these frames and write the rig; why not, where not."""
        # What a camera repeats that hangs tells no more.
        kept = each_once(kept, lambda one, other: same_points(one.points, other.points))
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
        clouds = [self._cloud(result.rig, item.points, item.name, seconds) for item in self._memory.kept.values()]
        self._memory.forget()
        self.state.counts.recalibrated += 1
        self.events.write(
            "recalibrated",
            kind=kind,
            history_id=entry.id,
            frames=[item.name for item in kept],
            **answer_report(result),
            change=entry.evidence["change"],
            sigma=entry.evidence["sigma"],
            clouds=[cloud for cloud in clouds if cloud is not None],
            seconds=dict(seconds),
        )
        self._tell_damage()
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
            if first:
                self._remember()
            else:
                self._memory.forget()
                self.events.write("rig changed", rig=self.rig_path)
        return self._rig

    def _remember(self) -> None:
        """Go on from what an earlier process knew, where it spoke of the rig that stands there now."""
        if self.state.memory.get("rig") == list(self._stamp):
            try:
                self._memory.restore(self.state.memory)
            except FileError as error:
                self.events.write("forgotten", reason=str(error))
        self._memory.tidy()

    def _tell_damage(self) -> None:
        """Lines of the history that cannot be read: nothing waits for them, but somebody must know."""
        try:
            damaged = [str(line) for line in read_history(self.rig_path, last=LOOKED_BACK).damaged]
        except FileError as error:
            damaged = [str(error)]
        if new := [line for line in damaged if line not in self._told]:
            self._told.update(new)
            self.events.write("history damaged", lines=len(new), reason=new[-1])

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
        "supported": supported(found),
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
