"""What is recorded is what was shown, whatever the camera does with its time."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import repeat
from typing import Any

import numpy as np
import pytest

from retrue.devices.options import RecordOptions
from retrue.devices.protocols import CameraFrame
from retrue.devices.recorder import Recorder
from retrue.errors import DeviceError, InputError
from tests.devices.rigs import GRAY, SIZE, Witness, small_rig


def recorded(options: dict[str, Any]) -> tuple[Witness, Recorder, list[CameraFrame]]:
    rig = small_rig(**options)
    camera = Witness(rig)
    recorder = Recorder(camera, rig.projector)
    return camera, recorder, recorder.record(GRAY)


@pytest.mark.parametrize(
    "options",
    [
        *({"lag_frames": lag} for lag in range(6)),
        {"lag_frames": 5, "readout": 0.95, "exposure_ms": 28.0, "bright_ms": 28.0},  # a change in each frame
        {"lag_frames": 3, "readout": 0.6, "exposure_ms": 15.0, "bright_ms": 15.0, "fps": 28.3, "drop": 0.02},
        {"lag_frames": 0, "lag_jitter_frames": 5, "readout": 0.8, "exposure_ms": 20.0, "bright_ms": 20.0},
        {"lag_frames": 0, "lag_jitter_frames": 4, "readout": 0.94, "exposure_ms": 28.0, "bright_ms": 28.0}
        | {
            "scene": "step",
            "drop": 0.03,
            "seed": 3,
        },  # frames are lost that no time tells of, one of them as it is timed
        {"lag_frames": 0, "lag_jitter_frames": 4, "readout": 0.64, "exposure_ms": 18.2, "bright_ms": 18.2}
        | {"drop": 0.06, "seed": 7},  # what is lost is shown for as long as its rows need
    ],
)
def test_each_picture_takes_little_more_than_two_frames_whatever_the_lag_and_the_shutter(options):
    rig = small_rig(**options)
    camera = Witness(rig)
    recorder = Recorder(camera, rig.projector)
    recorder.record(GRAY[:4])  # measures
    before = camera.frames
    pictures = [GRAY[number % len(GRAY)] for number in range(42)]
    frames = recorder.record(pictures)
    assert camera.faults(pictures, frames) == []
    assert camera.frames - before <= 2.5 * len(pictures)


@pytest.mark.parametrize(
    "options",
    [
        {"readout": 0.9, "exposure_ms": 20.0, "bright_ms": 20.0},  # every change falls into some row's exposure
        {"readout": 0.5, "exposure_ms": 15.0, "bright_ms": 15.0, "fps": 29.3, "drop": 0.03},  # and drifts through it
        {"readout": 0.5, "drop": 0.1, "seed": 3},
        {"readout": 0.5, "drop": 0.03, "lag_frames": 0, "lag_jitter_frames": 1, "seed": 1},
        {"readout": 0.5, "drop": 0.03, "lag_frames": 0, "lag_jitter_frames": 5, "seed": 4},
        {"gamma": 2.2, "electrons": 2000.0, "lag_frames": 4, "drop": 0.02},
        {"scene": "glossy", "refresh_hz": 0.0, "ambient": 0.3},
    ],
    ids=["rolling", "drifting", "dropping", "jitter", "much-jitter", "gamma", "glossy"],
)
def test_no_frame_is_mixed_wrong_or_lost(options):
    camera, _, frames = recorded(options)
    assert camera.faults(GRAY, frames) == []


def test_a_picture_that_is_lost_whole_shifts_no_other():
    """Two frames lost in a row, and lags that jump by four: for long, nothing but their range tells where it was."""
    options = {"scene": "step", "exposure_ms": 12.40907358339941, "bright_ms": 12.40907358339941, "drop": 0.03}
    rig = small_rig(**options, readout=0.5755916619310938, lag_frames=0, lag_jitter_frames=4, seed=1834895619)
    camera = Witness(rig)
    recorder = Recorder(camera, rig.projector)
    order = [9, 2, 27, 9, 27, 7, 20, 22, 18, 10, 19, 2, 10, 11, 25, 9, 5, 21, 14, 9, 25, 20, 9, 16, 28, 26, 24, 22, 18]
    pictures = [GRAY[index] for index in (*order, 12, 5, 14, 12, 14, 5, 26, 5, 4, 10, 12, 3, 16)]
    recorder.record(pictures[:4])  # measures
    assert camera.faults(pictures, recorder.record(pictures)) == []


def test_what_arrives_late_and_is_lost_while_the_machine_stands_still_shifts_no_picture():
    """The frame on its way comes when it goes on, those after it not at all: the next is many later, at no gap."""

    class Stalling(Witness):
        stalls: Iterator[float] = repeat(0.0)
        held: CameraFrame | None = None

        def frame(self) -> CameraFrame:
            if self.held is not None:
                frame, self.held = self.held, None
                return frame
            frame = super().frame()
            end = frame.at + next(self.stalls)
            while end > frame.at and (self.held is None or self.held.at < end):
                self.held = super().frame()
            return CameraFrame(frame.picture, end)

    rig = small_rig(readout=0.2, gamma=2.2)
    camera, random = Stalling(rig), np.random.default_rng(2)
    recorder = Recorder(camera, rig.projector)
    recorder.record(GRAY[:4])  # measures
    camera.stalls = (random.uniform(0, 0.4) if random.random() < 0.08 else 0.0 for _ in repeat(0))
    pictures = [GRAY[index] for index in random.integers(len(GRAY), size=30)]
    assert camera.faults(pictures, recorder.record(pictures)) == []


def test_what_looks_the_same_to_the_camera_is_recorded_all_the_same():
    rig = small_rig(lag_jitter_frames=2)
    camera = Witness(rig)
    half = np.zeros((SIZE[1], SIZE[0]), np.uint8)
    half[0] = 255  # out of the camera's sight
    pictures = [half, np.zeros_like(half), half, 255 - half]
    assert camera.faults(pictures, Recorder(camera, rig.projector).record(pictures)) == []


def test_the_rig_may_be_bumped_between_two_records():
    rig = small_rig()
    camera = Witness(rig)
    recorder = Recorder(camera, rig.projector)
    recorder.record(GRAY)
    rig.bump((2.0, -3.0, 1.0))
    assert camera.faults(GRAY, recorder.record(GRAY)) == []


def test_a_camera_that_looks_elsewhere_is_told_so():
    rig = small_rig(ambient=1.0, bright_ms=1e6)
    with pytest.raises(
        DeviceError, match=r"does not see what simulated projector shows: its white is .* point it there"
    ):
        Recorder(rig.camera, rig.projector).record(GRAY)


def test_pictures_for_another_projector_are_refused():
    rig = small_rig()
    with pytest.raises(InputError, match="expected 128 x 96 pixels for simulated projector, found 96 x 128"):
        Recorder(rig.camera, rig.projector).record([GRAY[0].T])


def test_what_never_stands_still_is_not_recorded():
    rig = small_rig()
    options = RecordOptions(attempts=2, max_lag_frames=8)
    recorder = Recorder(rig.camera, rig.projector, options)
    recorder.measure()

    class Moving(Witness):
        """Somebody waves a lamp before it."""

        def frame(self) -> CameraFrame:
            frame = super().frame()
            shade = np.uint8(60 + 50 * (self.frames % 3))
            return CameraFrame(frame.picture // 2 + shade, frame.at)

    recorder.camera = Moving(rig)
    with pytest.raises(DeviceError, match="no frame shows picture 1 of 1 as it stands still: is something moving"):
        recorder.record([GRAY[0]])


def test_a_camera_that_is_triggered_takes_one_frame_a_picture():
    rig = small_rig(lag_frames=0)

    class Triggered(Witness):
        """Exposes after it is asked."""

        triggered = True

        def frame(self) -> CameraFrame:
            for _ in range(3):
                frame = super().frame()
            return frame

    camera = Triggered(rig)
    recorder = Recorder(camera, rig.projector)
    frames = recorder.record(GRAY)
    assert camera.faults(GRAY, frames) == []
    assert camera.frames == 3 * (len(GRAY) + 2)


def test_what_is_held_is_recorded_as_it_stands_or_not_at_all():
    """White, then other pictures, then white again: the frames are those of the pictures, none of them mixed."""
    for seed in range(6):
        random = np.random.default_rng(seed)
        rig = small_rig(seed=seed, lag_frames=int(random.integers(6)), readout=float(random.uniform(0, 0.9)))
        camera, white = Witness(rig), np.full_like(GRAY[0], 255)
        rig.projector.show(np.repeat(white[..., None], 3, axis=2))
        for _ in range(8):
            camera.frame()
        shown = [white, GRAY[int(random.integers(4))], np.zeros_like(white)]
        frames = Recorder(camera, rig.projector).record_held(shown)
        assert frames is not None
        assert camera.faults(shown, frames) == []

    show, calls = rig.show, list[float]()

    def bumped(picture: np.ndarray, at: float) -> float:
        calls.append(at)
        if len(calls) == 3:  # as white comes back
            rig.bump((0.0, 0.3, 0.0))
        return show(picture, at)

    rig.projector.show(np.repeat(white[..., None], 3, axis=2))
    for _ in range(8):
        camera.frame()
    rig.show = bumped  # type: ignore[method-assign]
    assert Recorder(camera, rig.projector).record_held(shown) is None
