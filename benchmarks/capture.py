"""Thousands of pictures shown and recorded on the simulated rig: none mixed, none wrong, none lost; and how quickly.

python -m benchmarks.capture [PICTURES] [--stream RECORDS]: 10 000 pictures by default, in records of 42, each on a rig
of its own with random lag of 0 to 5 frames, lost frames, and exposures that roll across the changes. Then the same from
an MJPEG stream over HTTP.
"""

from __future__ import annotations

import argparse
import contextlib
import time
from typing import Any

import numpy as np

from retrue.devices.opencv_camera import OpencvCamera
from retrue.devices.options import RecordOptions
from retrue.devices.recorder import Recorder
from tests.devices.mjpeg import streaming
from tests.devices.rigs import GRAY, Witness, small_rig

RECORD = 42  # pictures: those of a Gray code of 1024 x 768


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("pictures", type=int, nargs="?", default=10_000)
    parser.add_argument("--stream", type=int, default=2, help="records from a stream")
    asked = parser.parse_args()
    kinds = {
        "steady: lag 0 to 5, exposures fit between changes": steady,
        "rolling: every change falls into some row's exposure": rolling,
        "lossy: 1 to 5 % of the frames lost, camera and projector out of step": lossy,
        "jittery: the lag changes from frame to frame, 0 to 5": jittery,
    }
    print(f"{'':70} pictures  mixed or wrong  frames a picture")
    for name, options in kinds.items():
        measure(name, options, asked.pictures // len(kinds))
    for number in range(asked.stream):
        stream(number)


def steady(random: np.random.Generator) -> dict[str, Any]:
    return {"lag_frames": int(random.integers(6)), "readout": float(random.uniform(0, 0.4))}


def rolling(random: np.random.Generator) -> dict[str, Any]:
    exposure = float(random.uniform(12, 28))
    rows = {"readout": float(random.uniform(0.5, 0.95)), "exposure_ms": exposure, "bright_ms": exposure}
    return {"lag_frames": int(random.integers(6)), **rows}


def lossy(random: np.random.Generator) -> dict[str, Any]:
    return {**rolling(random), "drop": float(random.uniform(0.01, 0.05)), "fps": float(random.uniform(24, 31))}


def jittery(random: np.random.Generator) -> dict[str, Any]:
    return {**rolling(random), "drop": 0.03, "lag_frames": 0, "lag_jitter_frames": int(random.integers(1, 6))}


def measure(name: str, options: Any, pictures: int) -> None:
    """One line: what became of so many pictures."""
    random = np.random.default_rng(0)
    done, faults, rates = 0, list[str](), list[float]()
    while done < pictures:
        rig = small_rig(
            seed=int(random.integers(2**31)), scene=str(random.choice(["wall", "step", "sphere"])), **options(random)
        )
        camera = Witness(rig)
        recorder = Recorder(camera, rig.projector)
        shown = [GRAY[int(index)] for index in random.integers(len(GRAY), size=RECORD)]
        recorder.record(shown[:4])  # measures
        before = camera.frames
        faults += camera.faults(shown, recorder.record(shown))
        rates.append((camera.frames - before) / RECORD)
        done += RECORD
    print(f"{name:70} {done:8}  {len(faults):14}  {np.median(rates):.2f} (worst {max(rates):.2f})", flush=True)
    for fault in faults[:5]:
        print("   ", fault)


def stream(seed: int) -> None:
    """A record from a stream, told by what the same rig shows without noise."""
    rig = small_rig(real_time=True, fps=20.0, readout=0.3, gamma=2.2, seed=seed)
    still = small_rig(gamma=2.2, electrons=np.inf, lag_frames=0)
    shown = [GRAY[index % len(GRAY)] for index in range(RECORD)]
    with streaming(rig.camera) as address, contextlib.closing(OpencvCamera(address)) as camera:
        camera.open()
        recorder = Recorder(camera, rig.projector, RecordOptions(max_lag_frames=20))
        recorder.record(shown[:4])
        start = time.perf_counter()
        frames = recorder.record(shown)
        rate = (time.perf_counter() - start) * rig.options.fps / RECORD
    clean: list[np.ndarray] = []
    for picture in shown:
        still.show(np.repeat(picture[..., None], 3, axis=2), 0.0)
        clean.append([still.frame() for _ in range(3)][-1].picture.astype(float))
    wrong = 0
    for number, frame in enumerate(frames):
        apart = [float(np.abs(frame.picture - picture).mean()) for picture in clean]
        wrong += not (apart[number] < 4 and apart[number] <= min(apart) + 1e-9)
    print(f"{'MJPEG over HTTP on loopback, 20 frames a second':70} {RECORD:8}  {wrong:14}  {rate:.2f}", flush=True)


if __name__ == "__main__":
    main()
