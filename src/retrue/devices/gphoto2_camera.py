"""A digital camera on a USB cable, through gphoto2: every frame is a photograph, taken when it is asked for."""

from __future__ import annotations

import re
import time
from dataclasses import dataclass, field
from typing import Any, cast

import cv2
import numpy as np

from retrue.devices.drivers import imported
from retrue.devices.protocols import CameraFrame
from retrue.errors import DeviceError
from retrue.geometry.arrays import Image

SETTLE = 0.2  # seconds that a projector may take until what it was sent is on the wall


@dataclass
class Gphoto2Camera:
    """Settings are taken from the camera's own steps, the nearest one.

    Attributes
    ----------
    port : such as usb:001,004; not given: the first camera that is found.
    exposure_ms : shutter speed; the camera stands on M, with its own white balance fixed.
    iso : not given: as it is.
    """

    port: str | None = None
    exposure_ms: float | None = None
    iso: int | None = None
    triggered: bool = field(default=True, init=False)
    _gphoto2: Any = field(default=None, init=False)
    _camera: Any = field(default=None, init=False)

    @property
    def name(self) -> str:
        return f"camera at {self.port or 'USB'}"

    def open(self) -> None:
        gp = self._gphoto2 = imported("gphoto2", "gphoto2", self.name)
        try:
            camera = gp.Camera()
            if self.port is not None:
                ports = gp.PortInfoList()
                ports.load()
                camera.set_port_info(ports[ports.lookup_path(self.port)])
            camera.init()
        except gp.GPhoto2Error as error:
            raise DeviceError(
                self.name, f"cannot be opened, is it on, and used by no other program? {_line(error)}"
            ) from error
        self._camera = camera
        if self.iso is not None:
            self._choose("iso", float(self.iso), float)
        if self.exposure_ms is not None:
            self.set_exposure(self.exposure_ms)
        else:
            self.exposure_ms = self._exposure()

    def frame(self) -> CameraFrame:
        if self._camera is None:
            raise DeviceError(self.name, "is not open")
        gp = self._gphoto2
        time.sleep(SETTLE)
        at = time.monotonic()
        try:
            path = self._camera.capture(gp.GP_CAPTURE_IMAGE)
            file = self._camera.file_get(path.folder, path.name, gp.GP_FILE_TYPE_NORMAL)
            content = np.frombuffer(memoryview(file.get_data_and_size()), np.uint8)
            self._camera.file_delete(path.folder, path.name)
        except gp.GPhoto2Error as error:
            raise DeviceError(self.name, f"took no picture, is it on, and focused by hand? {_line(error)}") from error
        picture = cast("Image | None", cv2.imdecode(content, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION))
        if picture is None:
            raise DeviceError(self.name, f"{path.name} is no picture that can be read: set the camera to JPEG")
        return CameraFrame(np.ascontiguousarray(picture[..., ::-1]), at)

    def set_exposure(self, exposure_ms: float) -> None:
        self._choose("shutterspeed", exposure_ms, shutter_ms)
        self.exposure_ms = self._exposure()

    def close(self) -> None:
        camera, self._camera = self._camera, None
        if camera is not None:
            try:
                camera.exit()
            except self._gphoto2.GPhoto2Error:
                return  # it is gone already

    def _exposure(self) -> float | None:
        try:
            return shutter_ms(self._camera.get_config().get_child_by_name("shutterspeed").get_value())
        except (self._gphoto2.GPhoto2Error, ValueError):
            return None

    def _choose(self, name: str, value: float, read: Any) -> None:
        """Set it to the nearest step, in ratio."""
        try:
            config = self._camera.get_config()
            widget = config.get_child_by_name(name)
            steps: dict[str, float] = {}
            for number in range(widget.count_choices()):
                choice = widget.get_choice(number)
                try:
                    steps[choice] = read(choice)
                except ValueError:  # "auto", "bulb"
                    continue
            if not steps:
                raise DeviceError(self.name, f"{name} cannot be set from here: turn its dial to M")
            widget.set_value(min(steps, key=lambda choice: abs(np.log(max(steps[choice], 1e-9) / value))))
            self._camera.set_config(config)
        except self._gphoto2.GPhoto2Error as error:
            raise DeviceError(self.name, f"{name} cannot be set: turn its dial to M; {_line(error)}") from error


def shutter_ms(text: str) -> float:
    """Of a shutter speed as cameras write it, in seconds.

    >>> shutter_ms("1/125"), shutter_ms("0.5"), shutter_ms("2s")
    (8.0, 500.0, 2000.0)
    """
    found = re.fullmatch(r"(\d+(?:\.\d+)?)(?:/(\d+(?:\.\d+)?))?\s*s?", text.strip())
    if found is None:
        raise ValueError(text)
    return 1000 * float(found[1]) / float(found[2] or 1)


def _line(error: Exception) -> str:
    return " ".join(str(error).split())
