"""`retrue watch`."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import threading
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import OmitArgPrefixes, Positional, arg

from retrue.cli.command import Command, Outcome, PatternPath, RigPath, log, made_folder, require_writable
from retrue.errors import InputError
from retrue.recalibration.options import VerifyOptions
from retrue.watch.options import WatchOptions

if TYPE_CHECKING:
    from types import FrameType

    from retrue.watch.events import Event, Listener
    from retrue.watch.fleet import FleetListener
    from retrue.watch.state import WatchState
    from retrue.watch.watch import Watch as Watcher


@dataclass(frozen=True, kw_only=True)
class Watch(Command):
    """Look after a rig: verify every frame, recalibrate in place when it has drifted, and go on.

    A pose whose points cannot check the lenses is only written with --lens fixed.

    Attributes
    ----------
    rig
        The rig file; every rig that is written over is kept in the history beside it. Or fleet.toml, which names many.
    source
        A folder that pictures drop into, a video file, the address of a stream, or the index of a camera.
    second
        With --stereo: the same of the second camera; not needed where SOURCE holds a folder of each.
    stereo
        The rig is two cameras: frames are photographs, paired by the numbers of their names, as of time stamps.
    pattern
        What the projector shows, a colour or line grid, JSON; not needed for a folder of points CSVs.
    out
        Folder for events.jsonl, state.json and clouds; made where it is not there. A watch goes on where the last
        one with this folder ended.
    clouds
        Write a cloud per frame.
    metrics_port
        Serve metrics for Prometheus on this port of 127.0.0.1; needs `pip install '.[watch]'`.
    limits
        When to recalibrate, and what to wait for.
    judgement
        Limits of the method.
    """

    rig: RigPath
    source: Positional[Annotated[str | None, arg(metavar="SOURCE")]] = None
    second: Positional[Annotated[str | None, arg(metavar="SECOND")]] = None
    stereo: bool = False
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
        from retrue.watch.sources import open_pair, open_source, source_name
        from retrue.watch.state import read_state

        require_writable(self.rig)
        if self.rig.suffix == ".toml":
            return self._run_fleet()
        if self.source is None:
            raise InputError(f"{self.rig}: expected a SOURCE after the rig: a folder, a video, a stream or a camera")
        if self.stereo and (self.pattern is not None or self.clouds):
            raise InputError("--stereo: expected neither --pattern nor --clouds; reconstruct takes pairs")
        if self.second is not None and not self.stereo:
            raise InputError(f"{self.second}: expected one SOURCE, or --stereo")
        folder = made_folder(self.out)
        stop = threading.Event()
        with contextlib.ExitStack() as stack:
            stack.enter_context(held_file(folder / "lock", patience=0.0))
            names = [self.source] if self.second is None else [self.source, self.second]
            state = read_state(folder / "state.json", ", ".join(map(source_name, names)))
            if self.stereo:
                source = open_pair((self.source, self.second), self.limits, state.position)
            else:
                source = open_source(self.source, self.pattern is not None, self.limits, state.position)
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

    def _run_fleet(self) -> Outcome:
        """Many rigs, as a file names them."""
        from retrue.watch.alarms import Alarms
        from retrue.watch.fleet import summary, watch_fleet
        from retrue.watch.fleet_file import read_fleet
        from retrue.watch.metrics import Metrics
        from retrue.watch.rig_status import read_status
        from retrue.watch.status import Status
        from retrue.watch.work_pool import WorkPool

        given = self.source, self.second, self.stereo, self.pattern, self.clouds, self.limits, self.judgement
        if given != (None, None, False, None, False, WatchOptions(), VerifyOptions()):
            raise InputError(
                f"{self.rig}: expected source, pattern, clouds, limits and lens of each rig in it, "
                "not on the command line"
            )
        fleet, folder = read_fleet(self.rig), made_folder(self.out)
        stop = threading.Event()
        port = fleet.port if self.metrics_port is None else self.metrics_port
        with contextlib.ExitStack() as stack:
            pool = stack.enter_context(WorkPool(fleet.workers or os.cpu_count() or 1))
            listeners: list[FleetListener] = [stack.enter_context(Alarms(fleet.alarm)).observe]
            if port is not None:
                metrics = Metrics() if find_spec("prometheus_client") else None
                known = {rig.name: replace(read_status(folder / rig.name), state="starting") for rig in fleet.rigs}
                status = stack.enter_context(Status(known, port, metrics))
                listeners += [status.observe] if metrics is None else [status.observe, metrics.observe]
                log(f"http://127.0.0.1:{status.port}/")
            if self.json:
                listeners.append(_fleet_printer(stop))
            stack.enter_context(_set_by_signals(stop))
            found = summary(watch_fleet(fleet.rigs, folder, pool, listeners, stop))
        text = f"{self.out}: {len(fleet.rigs)} rigs, {found['frames']} frames, {found['recalibrated']} recalibrations"
        return Outcome(found, text)

    def _watch(self, state: WatchState, listeners: Sequence[Listener]) -> Watcher:
        from retrue.files.rigs import read_rig
        from retrue.watch.events import EventLog
        from retrue.watch.sources import open_pattern
        from retrue.watch.stages import real_stages
        from retrue.watch.watch import Watch as Watcher

        pattern = None if self.pattern is None else open_pattern(read_rig(self.rig), self.pattern)
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


def _fleet_printer(stop: threading.Event) -> FleetListener:
    """The same for events of many rigs, each with the rig's name."""
    printed, lock = _printer(stop), threading.Lock()

    def print_event(event: Event, rig: str) -> None:
        with lock:
            printed({**event, "rig": rig})

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
