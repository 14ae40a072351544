"""Many watches in one process: a thread that waits for each rig, processes that work for all of them."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from retrue.errors import FileError, RetrueError
from retrue.files.file_lock import held_file
from retrue.files.rigs import read_rig
from retrue.watch.events import Event, EventLog
from retrue.watch.fleet_file import FleetRig
from retrue.watch.sources import open_pattern, open_source, source_name
from retrue.watch.state import read_state
from retrue.watch.watch import Watch
from retrue.watch.work_pool import WorkPool, pooled_stages

FleetListener = Callable[[Event, str], None]
"""Hears an event, and of which rig."""

FIRST_PAUSE, LONGEST_PAUSE = 1.0, 60.0  # seconds before a rig that failed is tried again


def watch_fleet(
    rigs: Sequence[FleetRig], out: Path, pool: WorkPool, listeners: Sequence[FleetListener], stop: threading.Event
) -> dict[str, dict[str, Any]]:
    """Until every source has ended, or `stop` is set; returns the last event of each rig.

    A rig whose file, source or disk fails is told, and tried again after a while; the others do not notice.
    """
    last: dict[str, dict[str, Any]] = {}
    threads = [
        threading.Thread(target=_look_after, args=(rig, out / rig.name, pool, listeners, stop, last), daemon=True)
        for rig in rigs
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        while thread.is_alive():  # not for ever at once: signals are handled in between
            thread.join(timeout=0.5)
    return last


def _look_after(
    rig: FleetRig,
    out: Path,
    pool: WorkPool,
    listeners: Sequence[FleetListener],
    stop: threading.Event,
    last: dict[str, dict[str, Any]],
) -> None:
    pause = FIRST_PAUSE
    told = [_named(listener, rig.name) for listener in listeners]
    while not stop.is_set():
        try:
            last[rig.name] = _watched(rig, out, pool, told, stop)
            return
        except Exception as error:  # whatever it is, it must stay with this rig
            problem = str(error) if isinstance(error, RetrueError) else f"{type(error).__name__}: {error}"
            last[rig.name] = _tell(out, told, " ".join(problem.split()))
        stop.wait(pause)
        pause = min(2 * pause, LONGEST_PAUSE)


def _watched(
    rig: FleetRig, out: Path, pool: WorkPool, told: Sequence[Callable[[Event], None]], stop: threading.Event
) -> dict[str, Any]:
    out.mkdir(parents=True, exist_ok=True)
    if rig.clouds:
        (out / "clouds").mkdir(exist_ok=True)
    with contextlib.ExitStack() as stack:
        stack.enter_context(held_file(out / "lock", patience=0.0))
        state = read_state(out / "state.json", source_name(rig.source))
        pattern = open_pattern(read_rig(rig.rig), rig.pattern)
        source = open_source(rig.source, pattern is not None, rig.limits, state.position)
        events = EventLog(out / "events.jsonl", told)
        stack.callback(events.close)
        stages = pooled_stages(pattern, out / "clouds" if rig.clouds else None, rig.judgement, pool)
        watch = Watch(rig.rig, stages, events, state, out / "state.json", rig.limits, rig.temperature)
        return watch.run(source, stop)


def _tell(out: Path, told: Sequence[Callable[[Event], None]], problem: str) -> dict[str, Any]:
    """That a watch failed, in its log where that can be written."""
    with contextlib.suppress(FileError, OSError):
        events = EventLog(out / "events.jsonl", told)
        with contextlib.closing(events):
            return events.write("failed", reason=problem)
    return {"event": "failed", "reason": problem}


def _named(listener: FleetListener, name: str) -> Callable[[Event], None]:
    return lambda event: listener(event, name)


def summary(last: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Counts of each rig, and of all."""
    counted = {name: {key: value for key, value in event.items() if key != "time"} for name, event in last.items()}
    frames = sum(event.get("frames", 0) for event in last.values())
    recalibrated = sum(event.get("recalibrated", 0) for event in last.values())
    return {"rigs": counted, "frames": frames, "recalibrated": recalibrated}
