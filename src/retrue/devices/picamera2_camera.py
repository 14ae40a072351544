"""The camera of a Raspberry Pi, through Picamera2."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from retrue.devices.drivers import imported
from retrue.devices.protocols import CameraFrame
from retrue.errors import DeviceError

SETTLE = 8  # frames until new settings have surely come into force
TOLERANCE = 0.05  # of an exposure that the sensor rounds to whole rows


@dataclass
class Picamera2Camera:
    """Frames come with the time at which the sensor began to read them.

    Attributes
    ----------
    device : number of the camera.
    exposure_ms, gain : fixed. `colour_gains` : of red and of blue; not given: those at the start, kept from then on.
    size : (width, height). `fps` : frames a second.
    """

    device: int = 0
    exposure_ms: float | None = None
    gain: float | None = None
    red_gain: float | None = None
    blue_gain: float | None = None
    size: tuple[int, int] = (1456, 1088)
    fps: float = 30.0
    triggered: bool = field(default=False, init=False)
    _camera: Any = field(default=None, init=False)

    @property
    def name(self) -> str:
        return f"Raspberry Pi camera {self.device}"

    def open(self) -> None:
        package = imported("picamera2", "picamera2", self.name)
        try:
            camera = self._camera = package.Picamera2(self.device)
            # Picamera2 names formats as they lie in a word: "BGR888" are bytes red, green, blue.
            main = {"size": tuple(self.size), "format": "BGR888"}
            camera.configure(camera.create_video_configuration(main=main, controls={"FrameRate": self.fps}))
            camera.start()
            seen = self._settled()
            gains = seen.get("ColourGains", (1.0, 1.0))
            camera.set_controls(
                {
                    "AeEnable": False,
                    "AwbEnable": False,
                    "AnalogueGain": self.gain or float(seen["AnalogueGain"]),
                    "ColourGains": (self.red_gain or float(gains[0]), self.blue_gain or float(gains[1])),
                    "ExposureTime": round(1000 * self.exposure_ms) if self.exposure_ms else int(seen["ExposureTime"]),
                }
            )
            found = float(self._settled()["ExposureTime"]) / 1000
        except DeviceError:
            raise
        except Exception as error:  # libcamera's own, of many kinds
            self.close()
            raise DeviceError(self.name, f"cannot be opened, is its cable in? {_line(error)}") from error
        self._require(self.exposure_ms, found)
        self.exposure_ms = found

    def frame(self) -> CameraFrame:
        if self._camera is None:
            raise DeviceError(self.name, "is not open")
        try:
            request = self._camera.capture_request()
            try:
                picture = np.array(request.make_array("main"))
                began = float(request.get_metadata()["SensorTimestamp"]) / 1e9  # on the clock that counts from the boot
            finally:
                request.release()
        except Exception as error:
            raise DeviceError(self.name, f"sends no frames any more, is its cable in? {_line(error)}") from error
        return CameraFrame(picture, began + time.monotonic() - time.clock_gettime(time.CLOCK_BOOTTIME))

    def set_exposure(self, exposure_ms: float) -> None:
        self._camera.set_controls({"ExposureTime": round(1000 * exposure_ms)})
        found = float(self._settled()["ExposureTime"]) / 1000
        self._require(exposure_ms, found)
        self.exposure_ms = found

    def close(self) -> None:
        camera, self._camera = self._camera, None
        if camera is not None:
            camera.stop()
            camera.close()

    def _settled(self) -> dict[str, Any]:
        """What the camera says of a frame that new settings have reached."""
        seen: dict[str, Any] = {}
        for _ in range(SETTLE):
            request = self._camera.capture_request()
            seen = dict(request.get_metadata())
            request.release()
        return seen

    def _require(self, exposure_ms: float | None, found: float) -> None:
        if exposure_ms is not None and not abs(found - exposure_ms) <= max(TOLERANCE * exposure_ms, 0.1):
            raise DeviceError(
                self.name,
                f"exposure_ms = {exposure_ms:g} cannot be set, it takes {found:g}: "
                f"choose one below {1000 / self.fps:g}, or a lower fps",
            )


def _line(error: Exception) -> str:
    return " ".join(f"{type(error).__name__} {error}".split())
