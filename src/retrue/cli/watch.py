"""`retrue watch`."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import threading
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import OmitArgPrefixes, Positional, arg

from retrue.cli.command import Command, Outcome, PatternPath, RigPath, made_folder, require_writable
from retrue.errors import FileError, InputError
from retrue.recalibration.options import VerifyOptions
from retrue.watch.options import WatchOptions

if TYPE_CHECKING:
    from types import FrameType

    from retrue.watch.events import Event, Listener
    from retrue.watch.frame import Position, Source
    from retrue.watch.state import WatchState
    from retrue.watch.watch import Watch as Watcher


@dataclass(frozen=True, kw_only=True)
class Watch(Command):
    """Look after a rig: verify every frame, recalibrate in place when it has drifted, and go on.

    A pose whose points cannot check the lenses is only written with --lens fixed.

    Attributes
    ----------
    rig
        The rig file; every rig that is written over is kept in the history beside it.
    source
        A folder that pictures drop into, a video file, the address of a stream, or the index of a camera.
    pattern
        What the projector shows, a colour or line grid, JSON; not needed for a folder of points CSVs.
    out
        Folder for events.jsonl, state.json and clouds; made where it is not there. A watch goes on where the last
        one with this folder ended.
    clouds
        Write a cloud per frame.
    metrics_port
        Serve metrics for Prometheus on this port of 127.0.0.1; needs `pip install 'retrue[watch]'`.
    limits
        When to recalibrate, and what to wait for.
    judgement
        Limits of the method.
    """

    rig: RigPath
    source: Positional[Annotated[str, arg(metavar="SOURCE")]]
    pattern: PatternPath = None
    out: Path
    clouds: bool = False
    metrics_port: int | None = None
    limits: OmitArgPrefixes[WatchOptions] = field(default_factory=WatchOptions)
    judgement: OmitArgPrefixes[VerifyOptions] = field(default_factory=VerifyOptions)

    def run(self) -> Outcome:
        from retrue.cli.status_line import StatusLine
        from retrue.files.file_lock import held_file
        from retrue.watch.metrics import Metrics
        from retrue.watch.state import read_state

        require_writable(self.rig)
        # Under one name however it was called, so that a later start knows it again.
        name = self.source if not Path(self.source).exists() else os.path.realpath(self.source)
        folder = made_folder(self.out)
        stop = threading.Event()
        with contextlib.ExitStack() as stack:
            stack.enter_context(held_file(folder / "lock", patience=0.0))
            state = read_state(folder / "state.json", name)
            source = self._source(state.position)
            listeners: list[Listener] = [StatusLine(state.counts).observe]
            if self.json:
                listeners.append(_printer(stop))
            if self.metrics_port is not None:
                listeners.append(stack.enter_context(Metrics(self.metrics_port)).observe)
            watch = self._watch(state, listeners)
            stack.callback(watch.events.close)
            stack.enter_context(_set_by_signals(stop))
            last = watch.run(source, stop)
        return Outcome(last, f"{self.out}: {last['frames']} frames, {last['recalibrated']} recalibrations")

    def _source(self, position: Position) -> Source:
        from retrue.files.images import SUFFIXES
        from retrue.files.video import is_stream
        from retrue.watch.folder import FolderSource
        from retrue.watch.video import VideoSource

        path = Path(self.source)
        if path.is_dir():
            return FolderSource(path, self.limits, position)
        if self.pattern is None:
            raise InputError("a video needs the pattern that it shows: give --pattern P.json")
        if self.source.isdecimal() and not path.exists():
            return VideoSource(int(self.source[:9]), position)
        if is_stream(self.source):
            return VideoSource(self.source, position)
        if not path.exists():
            raise FileError(path, "expected a folder, a video, the address of a stream or the index of a camera")
        if path.suffix.lower() in SUFFIXES:
            raise FileError(path, "one picture is no stream: give the folder that it lies in")
        return VideoSource(path, position)

    def _watch(self, state: WatchState, listeners: Sequence[Listener]) -> Watcher:
        from retrue.files.patterns import read_pattern
        from retrue.files.rigs import read_rig
        from retrue.patterns.color_grid import ColorGrid
        from retrue.patterns.line_grid import LineGrid
        from retrue.rasters import check_pattern
        from retrue.watch.events import EventLog
        from retrue.watch.stages import real_stages
        from retrue.watch.watch import Watch as Watcher

        pattern = None if self.pattern is None else read_pattern(self.pattern)
        if pattern is not None and not isinstance(pattern, ColorGrid | LineGrid):
            raise FileError(
                str(self.pattern), "a watch reads single pictures: expected a colour or line grid, found a sequence"
            )
        if pattern is not None and self.pattern is not None:
            check_pattern(read_rig(self.rig), pattern.projector_size, self.pattern)
        stages = real_stages(pattern, made_folder(self.out / "clouds") if self.clouds else None, self.judgement)
        events = EventLog(self.out / "events.jsonl", listeners)
        return Watcher(self.rig, stages, events, state, self.out / "state.json", self.limits)


def _printer(stop: threading.Event) -> Listener:
    """Prints events as lines, but for the last, which is the command's own answer; stops where nobody reads them."""

    def print_event(event: Event) -> None:
        if event["event"] == "stopped" or stop.is_set():
            return
        try:
            print(json.dumps(event), flush=True)
        except BrokenPipeError:
            stop.set()
            sys.stdout = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115

    return print_event


@contextlib.contextmanager
def _set_by_signals(stop: threading.Event) -> Generator[None]:
    """SIGINT and SIGTERM set it, so that the frame in work is finished and what is known is saved."""

    def handle(_signal: int, _frame: FrameType | None) -> None:
        stop.set()

    before = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
