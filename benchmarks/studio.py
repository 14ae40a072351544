"""How soon the studio knows, and what it keeps: from a frame to its verdict, and memory over thousands of frames.

python -m benchmarks.studio [--frames 5000]: at 1280 x 960 the time from a frame to the verdict that pages show,
against that of decoding and verifying alone; then so many frames, each of them verified, and memory on the way.
"""

from __future__ import annotations

import argparse
import gc
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import retrue
from retrue.decoding.decode import decode
from retrue.devices.drivers import LiveRig, make_rig
from retrue.devices.protocols import CameraFrame
from retrue.devices.setup import Setup
from retrue.patterns.color_grid import make_color_grid
from retrue.recalibration.verify import verify
from retrue.studio import studio as module
from retrue.studio.drift_log import REMEMBERED
from retrue.studio.studio import Studio

LOOKS = 12


@dataclass
class Timed:
    """A camera that remembers when its last frame came, in processor time of this process."""

    camera: Any
    came: float = 0.0
    picture: Any = None

    def frame(self) -> CameraFrame:
        frame = self.camera.frame()
        self.came, self.picture = time.process_time(), frame.picture
        return frame


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--frames", type=int, default=5000)
    asked = parser.parse_args()
    module.WATCH_SECONDS = module.REFRESH = 0.0  # each frame
    latency()
    memory(asked.frames)


def opened(folder: Path, size: tuple[int, int], projector: tuple[int, int]) -> tuple[Studio, LiveRig]:
    """A studio that watches a simulated rig, which it knows."""
    setup = Setup(
        {"driver": "simulated", "size": list(size), "projector_size": list(projector)}, {"driver": "simulated"}
    )
    live = make_rig(setup)
    assert live.simulated is not None
    retrue.write_rig(folder / "rig.json", live.simulated.true_rig)
    studio = Studio(setup, folder)
    studio._drift.switch(True)
    studio._set(watching=True)
    return studio, live


def latency() -> None:
    with tempfile.TemporaryDirectory() as name:
        studio, live = opened(Path(name), (1280, 960), (1024, 768))
        pattern = make_color_grid(live.projector.size)
        live.projector.show(pattern.render())
        camera = live.camera = Timed(live.camera)  # type: ignore[assignment]
        rig = retrue.read_rig(studio.rig_path)
        looks, alone = list[float](), list[float]()
        before = None
        for _ in range(LOOKS + 4):
            before = studio._look(live, pattern, before)
            looks.append(time.process_time() - camera.came)
            start = time.process_time()
            verify(rig, [decode(pattern, camera.picture)])
            alone.append(time.process_time() - start)
        found, least = float(np.median(looks[4:])), float(np.median(alone[4:]))
    print(
        f"1280 x 960: {1000 * found:.0f} ms from a frame to its verdict, {1000 * least:.0f} ms to decode and verify it"
    )
    print(f"ratio {found / least:.2f} (goal 1.5)", flush=True)


def memory(frames: int) -> None:
    with tempfile.TemporaryDirectory() as name:
        studio, live = opened(Path(name), (320, 240), (512, 384))
        pattern = make_color_grid(live.projector.size)
        live.projector.show(pattern.render())
        before, marks = None, [0, frames // 5, frames // 2, frames]
        for number in range(frames + 1):
            if number in marks:
                gc.collect()
                print(f"{number:6} frames: {resident():.1f} MB, {len(studio.state.readings)} readings", flush=True)
            before = studio._look(live, pattern, before)
        assert len(studio.state.readings) == min(frames + 1, REMEMBERED)


def resident() -> float:
    """Of this process, in MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 1e6


if __name__ == "__main__":
    main()
