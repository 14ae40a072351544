"""Drivers of cameras that are not here: what they set, what they return, and what they say when it goes."""

from __future__ import annotations

import contextlib
import time

import numpy as np
import pytest

from retrue.devices.genicam_camera import GenicamCamera
from retrue.devices.gphoto2_camera import Gphoto2Camera
from retrue.devices.picamera2_camera import Picamera2Camera
from retrue.errors import DeviceError
from tests.devices.fakes import Gentl, Gphoto2, Picamera2


def test_genicam_fixes_what_is_automatic_and_fills_in_the_mosaic(monkeypatch: pytest.MonkeyPatch):
    fake = Gentl(monkeypatch)
    with contextlib.closing(GenicamCamera("p.cti", "B2", exposure_ms=20.0, gain=3.0, fps=25.0)) as camera:
        camera.open()
        assert (fake.nodes.ExposureTime.value, fake.nodes.Gain.value) == (20_000.0, 3.0)
        assert (fake.nodes.ExposureAuto.value, fake.nodes.GainAuto.value) == ("Off", "Off")
        assert fake.nodes.AcquisitionFrameRate.value == 25.0
        assert camera.frame().picture[20, 20].tolist() == [200, 0, 40]  # still there, though the buffer is gone
        camera.set_exposure(7.5)
        assert camera.exposure_ms == fake.nodes.ExposureTime.value / 1000 == 7.5
        assert not camera.triggered
    assert fake.log == ["start", "stop", "destroy", "reset"]


def test_genicam_takes_a_frame_when_it_is_asked(monkeypatch: pytest.MonkeyPatch):
    fake = Gentl(monkeypatch)
    camera = GenicamCamera("p.cti", trigger=True, pixel_format="RGB8")
    camera.open()
    assert (camera.triggered, camera.exposure_ms, fake.nodes.TriggerMode.value) == (True, 5.0, "On")
    assert camera.frame().picture[7, 9].tolist() == [1, 2, 3]
    assert fake.triggers == 1


def test_genicam_says_what_is_wrong(monkeypatch: pytest.MonkeyPatch):
    fake = Gentl(monkeypatch)
    with pytest.raises(DeviceError, match=r"^GenICam camera 0: cannot be opened through p.so, which finds 2: File"):
        GenicamCamera("p.so").open()
    with pytest.raises(DeviceError, match="PixelFormat cannot be set to YUV: ValueError"):
        GenicamCamera("p.cti", pixel_format="YUV").open()
    camera = GenicamCamera("p.cti")
    camera.open()
    fake.plugged = False
    with pytest.raises(DeviceError, match=r"sends no frames any more, is it plugged in\? TimeoutError"):
        camera.frame()
    camera.close()
    with pytest.raises(DeviceError, match="which finds 0: IndexError"):
        camera.open()
    fake.plugged = True
    camera.open()
    assert camera.frame().picture.shape == (48, 64, 3)


def test_gphoto2_takes_the_nearest_step_and_leaves_nothing_on_the_card(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("retrue.devices.gphoto2_camera.SETTLE", 0.0)
    fake = Gphoto2(monkeypatch)
    with contextlib.closing(Gphoto2Camera(exposure_ms=15.0, iso=180)) as camera:
        camera.open()
        assert fake.set_to == {"shutterspeed": "1/60", "iso": "200"}
        assert camera.exposure_ms == pytest.approx(1000 / 60)
        assert camera.triggered
        red, green, blue = camera.frame().picture[20, 20].tolist()
        assert red > 190
        assert max(green, blue) < 10
        assert fake.card == {}
        fake.raw = True
        with pytest.raises(DeviceError, match=r"IMG_1.JPG is no picture that can be read: set the camera to JPEG"):
            camera.frame()
        fake.plugged = False
        with pytest.raises(DeviceError, match=r"^camera at USB: took no picture, is it on, .* Could not find the"):
            camera.frame()
    with pytest.raises(DeviceError, match="cannot be opened, is it on, and used by no other program"):
        Gphoto2Camera().open()
    fake.plugged, fake.steps["shutterspeed"] = True, ["Auto"]
    with pytest.raises(DeviceError, match="shutterspeed cannot be set from here: turn its dial to M"):
        Gphoto2Camera(exposure_ms=10.0).open()


def test_picamera2_keeps_the_colours_that_it_began_with_and_waits_for_its_settings(monkeypatch: pytest.MonkeyPatch):
    fake = Picamera2(monkeypatch)
    with contextlib.closing(Picamera2Camera(exposure_ms=12.0, size=(64, 48))) as camera:
        camera.open()
        assert fake.controls["ColourGains"] == (1.5, 1.8)
        assert (fake.controls["AeEnable"], fake.controls["AwbEnable"]) == (False, False)
        assert camera.exposure_ms == 12.0
        camera.set_exposure(4.0)
        assert fake.controls["ExposureTime"] == 4000
        frame = camera.frame()
        assert np.unique(frame.picture.reshape(-1, 3), axis=0).tolist() == [[200, 0, 0]]
        assert 0.015 < time.monotonic() - frame.at < 5
        assert fake.out == 0
        with pytest.raises(DeviceError, match=r"exposure_ms = 50 cannot be set, it takes 33: choose one below 33.3333"):
            camera.set_exposure(50.0)
        fake.plugged = False
        with pytest.raises(DeviceError, match=r"^Raspberry Pi camera 0: sends no frames any more, is its cable in\?"):
            camera.frame()
    with pytest.raises(DeviceError, match=r"cannot be opened, is its cable in\? IndexError"):
        camera.open()
    fake.plugged = True
    camera.open()
    assert camera.frame().picture.shape == (48, 64, 3)
