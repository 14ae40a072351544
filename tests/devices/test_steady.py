"""A device that goes away is named in one sentence, waited for, and gone on with."""

from __future__ import annotations

import numpy as np
import pytest

from retrue.devices.exposure import find_exposure
from retrue.devices.protocols import CameraFrame
from retrue.devices.recorder import Recorder
from retrue.devices.steady import SteadyCamera, SteadyProjector
from retrue.errors import DeviceError
from tests.devices.rigs import GRAY, SIZE, Witness, small_rig


class Unplugged(Witness):
    """Goes away after some frames, and stays away for some tries to open it."""

    away = 0

    def open(self) -> None:
        if self.away > 0:
            self.away -= 1
            raise DeviceError(self.name, "cannot be opened")

    def frame(self) -> CameraFrame:
        if self.frames == 200:
            self.frames += 1
            self.away = 2
        if self.away:
            raise DeviceError(self.name, "sends no frames any more")
        return super().frame()


def test_a_camera_that_is_unplugged_while_it_records(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("retrue.devices.steady.PAUSE", 0.0)
    rig = small_rig()
    camera, told = Unplugged(rig), list[str]()
    frames = Recorder(SteadyCamera(camera, told.append), rig.projector).record(GRAY)
    assert camera.faults(GRAY, frames) == []
    assert told == [
        "simulated camera: sends no frames any more; waiting for it",
        "simulated camera: is back",
    ]


def test_patience_ends(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("retrue.devices.steady.PAUSE", 0.0)
    camera = Unplugged(small_rig())
    camera.frames = 200
    with pytest.raises(DeviceError, match="sends no frames any more"):
        SteadyCamera(camera, print, patience=0.0).frame()


def test_a_screen_that_comes_back_shows_what_it_showed(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("retrue.devices.steady.PAUSE", 0.0)
    shown: list[float] = []

    class Screen:
        name, size, lost = "screen 1", SIZE, False

        def open(self) -> None:
            self.lost = False
            shown.append(0.0)

        def close(self) -> None: ...

        def show(self, picture: np.ndarray, at: float = 0.0) -> float:
            shown.append(float(picture.mean()))
            return 0.0

        def wait(self, seconds: float) -> str:
            if not shown or self.lost:
                raise DeviceError(self.name, "is gone")
            return "next"

    screen, told = Screen(), list[str]()
    steady = SteadyProjector(screen, told.append)
    steady.show(np.full((SIZE[1], SIZE[0], 3), 77, np.uint8))
    screen.lost = True
    assert steady.wait(1.0) == "next"
    assert shown == [77.0, 0.0, 77.0]
    assert told == ["screen 1: is gone; waiting for it", "screen 1: is back"]


@pytest.mark.parametrize("bright_ms", [0.5, 8.0, 20.0])
def test_the_exposure_is_set_so_that_white_is_bright_and_nothing_clips(bright_ms: float):
    rig = small_rig(bright_ms=bright_ms, exposure_ms=12.0)
    find_exposure(rig.camera, rig.projector)
    picture = [rig.frame() for _ in range(4)][-1].picture
    assert np.percentile(picture, 99.5) > 180
    assert np.mean(picture >= 250) <= 0.001


def test_an_exposure_that_cannot_be_set_must_not_clip():
    class Fixed(Witness):
        exposure_ms = None  # type: ignore[assignment]

    rig = small_rig(exposure_ms=30.0)
    with pytest.raises(
        DeviceError, match=r"\d+ % of the picture is clipped under white, and its exposure cannot be set"
    ):
        find_exposure(Fixed(rig), rig.projector)
    rig = small_rig()
    assert find_exposure(Fixed(rig), rig.projector) is None
