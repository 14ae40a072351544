"""A watch over thousands of simulated frames: jumps, a slow drift, dark frames and broken files in between.

python benchmarks/watch_stream.py [FRAMES]

Prints how many frames each jump took, recalibrations that nothing called for, what was logged, and the memory.
"""

from __future__ import annotations

import json
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "watch"))

from stream import RIG, STAGES, SimulatedSource

from retrue.files.history import read_history
from retrue.files.rigs import read_rig, write_rig
from retrue.geometry.transform import rotation_angle
from retrue.watch.events import EventLog
from retrue.watch.frame import Frame
from retrue.watch.state import WatchState
from retrue.watch.watch import Watch

WITHIN = 5  # frames in which a jump must be found
WARM = 0.1  # share of the frames after which memory must be flat


@dataclass(slots=True)
class Measured(SimulatedSource):
    """Notes the memory of the process as it goes."""

    megabytes: list[float] = field(default_factory=list)

    def frames(self, stop: threading.Event) -> Iterator[Frame]:
        for frame in SimulatedSource.frames(self, stop):
            pages = int(Path("/proc/self/statm").read_text().split()[1])
            self.megabytes.append(pages * 4096 / 2**20)
            yield frame


def main(count: int) -> int:
    jumps = {int(share * count): turn for share, turn in ((0.1, (1.0, -0.7, 0.4)), (0.3, (0, 2, 0)), (0.9, (0, -1, 1)))}
    drift = (int(0.5 * count), int(0.8 * count), (0.5, 0.5, 0.0))
    source = Measured(count, jumps=jumps, drift=drift, dark=7, broken=11)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_rig(folder / "rig.json", RIG)
        events = EventLog(folder / "events.jsonl")
        watch = Watch(folder / "rig.json", STAGES, events, WatchState("simulated"), folder / "state.json")
        start = time.perf_counter()
        watch.run(source, threading.Event())
        seconds = time.perf_counter() - start
        events.close()
        logged = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
        off = read_rig(folder / "rig.json").projector_from_camera.R @ source.rig_at(count - 1).projector_from_camera.R.T
        entries = len(read_history(folder / "rig.json"))
    found = [
        max(int(frame.removeprefix("frame ")) for frame in event["frames"])
        for event in logged
        if event["event"] == "recalibrated"
    ]
    took = {jump: min((number - jump + 1 for number in found if number >= jump), default=count) for jump in jumps}
    excused = {number for jump in jumps for number in range(jump, jump + WITHIN + 5)} | set(
        range(drift[0], drift[1] + 50)
    )
    false = [number for number in found if number not in excused]
    frames = sum(event["event"] in ("frame", "bad frame") for event in logged)
    warm = source.megabytes[int(WARM * count) :]
    growth = warm[-1] / warm[0] - 1
    print(f"{count} frames in {seconds:.0f} s; {watch.state.counts}")
    print(f"frames until a jump was found: {took}; recalibrations in all {len(found)}, uncalled for {false}")
    print(f"events logged for {frames} frames; history of {entries} rigs")
    print(f"the rig ends {np.degrees(rotation_angle(off)):.3f} deg off the true one")
    print(f"memory {warm[0]:.1f} MB after {WARM:.0%}, {warm[-1]:.1f} MB at the end ({growth:+.1%})")
    good = (
        max(took.values()) <= WITHIN and not false and frames == count and entries == len(found) + 1 and growth < 0.05
    )
    return int(not good)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 5000))
