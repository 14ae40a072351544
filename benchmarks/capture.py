"""Thousands of pictures shown and recorded on the simulated rig: none mixed, none wrong, none lost; and how quickly.

python -m benchmarks.capture [PICTURES] [--stream PICTURES] [--fps 25] [--seed 0]: 10 000 pictures by default, in
records of 42, each on a rig of its own with random lag of 0 to 5 frames, lost frames, and exposures that roll across
the changes. Then the same from MJPEG streams over HTTP.
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

STREAMS = 4
RECORD = 42  # pictures: those of a Gray code of 1024 x 768


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("pictures", type=int, nargs="?", default=10_000)
    parser.add_argument("--stream", type=int, default=10_000, help="pictures from streams")
    parser.add_argument("--fps", type=float, default=25.0, help="of the streams")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    kinds = {
        "steady: lag 0 to 5, exposures fit between changes": steady,
        "rolling: every change falls into some row's exposure": rolling,
        "lossy: 1 to 5 % of the frames lost, camera and projector out of step": lossy,
        "jittery: the lag changes from frame to frame, 0 to 5": jittery,
    }
    print(f"{'':70} pictures  mixed or wrong  frame times a picture")
    for name, options in kinds.items() if asked.pictures else ():
        measure(name, options, asked.pictures // len(kinds), asked.seed)
    for number in range(STREAMS if asked.stream else 0):
        stream(asked.seed + number, asked.stream // STREAMS, asked.fps)


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


def measure(name: str, options: Any, pictures: int, seed: int) -> None:
    """One line: what became of so many pictures."""
    random = np.random.default_rng(seed)
    done, faults, rates = 0, list[str](), list[float]()
    while done < pictures:
        rig = small_rig(
            seed=int(random.integers(2**31)), scene=str(random.choice(["wall", "step", "sphere"])), **options(random)
        )
        camera = Witness(rig)
        recorder = Recorder(camera, rig.projector)
        shown = [GRAY[int(index)] for index in random.integers(len(GRAY), size=RECORD)]
        recorder.record(shown[:4])  # measures
        before = rig.now()
        faults += camera.faults(shown, recorder.record(shown))
        rates.append((rig.now() - before) * rig.options.fps / RECORD)
        done += RECORD
    print(f"{name:70} {done:8}  {len(faults):14}  {told(rates)}", flush=True)
    for fault in faults[:5]:
        print("   ", fault)


def told(rates: list[float]) -> str:
    return f"{np.median(rates):.2f} (95 % {np.percentile(rates, 95):.2f}, worst {max(rates):.2f})"


def stream(seed: int, pictures: int, fps: float) -> None:
    """Records from one stream, told by what the same rig shows without noise."""
    random = np.random.default_rng(seed)
    options = {
        "lag_frames": int(random.integers(6)),
        "drop": 0.01 * (seed % STREAMS),
        "readout": float(random.uniform(0.2, 0.9)),
    }
    rig = small_rig(real_time=True, fps=fps, gamma=2.2, seed=seed, exposure_ms=20.0, bright_ms=20.0, **options)
    still = small_rig(gamma=2.2, electrons=np.inf, lag_frames=0)
    clean: list[np.ndarray] = []
    for picture in GRAY:
        still.show(np.repeat(picture[..., None], 3, axis=2), 0.0)
        clean.append([still.frame() for _ in range(3)][-1].picture.astype(float))
    done, wrong, rates = 0, 0, list[float]()
    with streaming(rig.camera) as address, contextlib.closing(OpencvCamera(address)) as camera:
        camera.open()
        recorder = Recorder(camera, rig.projector, RecordOptions(max_lag_frames=20))
        recorder.record(GRAY[:4])  # measures
        while done < pictures:
            shown = random.integers(len(GRAY), size=RECORD)
            start = time.perf_counter()
            frames = recorder.record([GRAY[int(index)] for index in shown])
            rates.append((time.perf_counter() - start) * fps / RECORD)
            for index, frame in zip(shown, frames, strict=True):
                apart = [float(np.abs(frame.picture - picture).mean()) for picture in clean]
                wrong += not (apart[index] < 4 and apart[index] <= min(apart) + 1e-9)
            done += RECORD
    name = f"MJPEG over HTTP, {fps:g} frames a second, lag {rig.options.lag_frames}, {rig.options.drop:.0%} lost"
    print(f"{name:70} {done:8}  {wrong:14}  {told(rates)}", flush=True)


if __name__ == "__main__":
    main()
