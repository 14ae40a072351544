"""Frames of files and streams through OpenCV, and one sentence where there are none."""

from __future__ import annotations

import contextlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from retrue.devices.opencv_camera import OpencvCamera
from retrue.devices.options import RecordOptions
from retrue.devices.recorder import Recorder
from retrue.devices.steady import SteadyCamera
from retrue.errors import DeviceError
from tests.devices.mjpeg import streaming
from tests.devices.rigs import GRAY, small_rig


def test_a_stream_records_what_was_shown():
    rig = small_rig(real_time=True, fps=25.0, gamma=2.2, readout=0.2)
    pictures = GRAY[:4] + GRAY[-2:]
    with streaming(rig.camera) as address, contextlib.closing(OpencvCamera(address)) as camera:
        camera.open()
        frames = Recorder(camera, rig.projector, RecordOptions(max_lag_frames=12)).record(pictures)
    still = small_rig(gamma=2.2, electrons=np.inf, lag_frames=0)
    for picture, frame in zip(pictures, frames, strict=True):
        still.show(np.repeat(picture[..., None], 3, axis=2), 0.0)
        expected = [still.frame() for _ in range(3)][-1].picture
        assert np.abs(frame.picture.astype(float) - expected).mean() < 4  # grey levels: noise, and JPEG


def test_a_stream_that_goes_away_is_gone_on_with_when_it_is_back_and_nobody_else_speaks(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("retrue.devices.steady.PAUSE", 0.01)
    rig, told, tries = small_rig(real_time=True, fps=60.0), list[str](), list[int]()
    with contextlib.ExitStack() as stack:
        plugged = stack.enter_context(contextlib.ExitStack())
        address = plugged.enter_context(streaming(rig.camera))
        camera = stack.enter_context(contextlib.closing(SteadyCamera(OpencvCamera(address), told.append)))
        camera.open()
        before = camera.frame().at
        plugged.close()
        reopen = OpencvCamera.open

        def plug_in(self: OpencvCamera) -> None:
            """At the third try."""
            tries.append(len(told))
            if len(tries) == 3:
                stack.enter_context(streaming(rig.camera, port=int(address.split(":")[2].split("/")[0])))
            reopen(self)

        monkeypatch.setattr(OpencvCamera, "open", plug_in)
        while not tries:  # what had come before is handed out first
            assert camera.frame().at > before
    assert tries == [1, 1, 1]
    name = f"camera {address}"
    assert told == [
        f"{name}: sends no frames any more: is it plugged in, and switched on?; waiting for it",
        f"{name}: is back",
    ]
    assert capfd.readouterr() == ("", "")


def test_a_file_gives_its_frames_and_then_says_that_it_has_ended(tmp_path: Path):
    path = tmp_path / "clip.avi"
    writer = cv2.VideoWriter(str(path), cv2.CAP_OPENCV_MJPEG, cv2.VideoWriter.fourcc(*"MJPG"), 10, (64, 48))
    for level in range(0, 200, 10):
        writer.write(np.full((48, 64, 3), level, np.uint8))
    writer.release()
    with contextlib.closing(OpencvCamera(str(path))) as camera:
        camera.open()
        levels = [camera.frame().picture.mean() for _ in range(20)]
        assert np.abs(np.array(levels) - np.arange(0, 200, 10)).max() < 3
        with pytest.raises(DeviceError, match=r"clip.avi: has ended$"):
            camera.frame()


def test_what_cannot_be_opened_or_set_is_said_in_one_sentence(tmp_path: Path):
    with pytest.raises(DeviceError, match=r"^camera 97: cannot be opened: is it plugged in, and does no other"):
        OpencvCamera(97).open()
    rig = small_rig(real_time=True, fps=60.0)
    with (
        streaming(rig.camera) as address,
        contextlib.closing(OpencvCamera(address, exposure_ms=5.0)) as camera,
        pytest.raises(DeviceError, match="the exposure of a stream cannot be set from here"),
    ):
        camera.open()
