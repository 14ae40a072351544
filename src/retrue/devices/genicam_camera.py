"""An industrial camera behind a GenTL producer (GigE Vision, USB3 Vision, CoaXPress), through Harvester."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from retrue.devices.drivers import imported
from retrue.devices.protocols import CameraFrame
from retrue.errors import DeviceError
from retrue.geometry.arrays import Image

PATIENCE = 5.0  # seconds without a frame after which a camera is taken for gone
BAYER = {
    "RG": cv2.COLOR_BayerBG2RGB,
    "GR": cv2.COLOR_BayerGB2RGB,
    "GB": cv2.COLOR_BayerGR2RGB,
    "BG": cv2.COLOR_BayerRG2RGB,
}
"""OpenCV names a mosaic by its second row, GenICam by its first."""


@dataclass
class GenicamCamera:
    """Settings are GenICam's standard features; frames come with the time at which they were fetched.

    Attributes
    ----------
    producer : path of the GenTL producer, a .cti file.
    device : serial number, or index among the cameras that the producer finds.
    exposure_ms, gain : ExposureTime and Gain; fixed, with ExposureAuto, GainAuto and BalanceWhiteAuto off.
    pixel_format : such as Mono8, BayerRG8, RGB8; not given: as it is.
    fps : AcquisitionFrameRate.
    trigger : whether each frame is triggered by software when it is asked for.
    """

    producer: str = ""
    device: int | str = 0
    exposure_ms: float | None = None
    gain: float | None = None
    pixel_format: str | None = None
    fps: float | None = None
    trigger: bool = False
    _harvester: Any = field(default=None, init=False)
    _acquirer: Any = field(default=None, init=False)

    @property
    def name(self) -> str:
        return f"GenICam camera {self.device}"

    @property
    def triggered(self) -> bool:
        """As the setup says."""
        return self.trigger

    def open(self) -> None:
        core = imported("harvesters.core", "genicam", self.name)
        self._harvester = core.Harvester()
        try:
            self._harvester.add_file(self.producer, check_existence=True)
            self._harvester.update()
            key = self.device if isinstance(self.device, int) else {"serial_number": self.device}
            self._acquirer = self._harvester.create(key)
        except Exception as error:  # GenTL's own, of many kinds
            found = len(self._harvester.device_info_list)
            self.close()
            raise DeviceError(
                self.name,
                f"cannot be opened through {self.producer or 'no producer'}, which finds {found}: {_line(error)}",
            ) from error
        for feature in ("ExposureAuto", "GainAuto", "BalanceWhiteAuto"):
            self._set(feature, "Off", needed=False)
        if self.pixel_format is not None:
            self._set("PixelFormat", self.pixel_format)
        if self.fps is not None:
            self._set("AcquisitionFrameRateEnable", True, needed=False)
            self._set("AcquisitionFrameRate", self.fps)
        if self.gain is not None:
            self._set("Gain", self.gain)
        if self.exposure_ms is not None:
            self.set_exposure(self.exposure_ms)
        else:
            self.exposure_ms = self._exposure()
        if self.trigger:
            self._set("TriggerSelector", "FrameStart", needed=False)
            self._set("TriggerMode", "On")
            self._set("TriggerSource", "Software")
        self._acquirer.start()

    def frame(self) -> CameraFrame:
        if self._acquirer is None:
            raise DeviceError(self.name, "is not open")
        try:
            if self.trigger:
                self._nodes.TriggerSoftware.execute()
            with self._acquirer.fetch(timeout=PATIENCE) as buffer:
                component = buffer.payload.components[0]
                shape = component.height, component.width, int(component.num_components_per_pixel)
                picture = np.array(component.data).reshape(shape)  # a copy: the buffer goes back to the camera
                return CameraFrame(_rgb(picture, str(component.data_format)), time.monotonic())
        except DeviceError:
            raise
        except Exception as error:
            raise DeviceError(self.name, f"sends no frames any more, is it plugged in? {_line(error)}") from error

    def set_exposure(self, exposure_ms: float) -> None:
        self._set("ExposureTime", 1000.0 * exposure_ms)
        self.exposure_ms = self._exposure()

    def close(self) -> None:
        for thing, how in ((self._acquirer, "stop"), (self._acquirer, "destroy"), (self._harvester, "reset")):
            if thing is not None:
                try:
                    getattr(thing, how)()
                except Exception:  # of a camera that is gone: there is nothing left to let go of
                    continue
        self._acquirer = self._harvester = None

    @property
    def _nodes(self) -> Any:
        return self._acquirer.remote_device.node_map

    def _exposure(self) -> float | None:
        node = getattr(self._nodes, "ExposureTime", None)
        return None if node is None else float(node.value) / 1000

    def _set(self, feature: str, value: Any, *, needed: bool = True) -> None:
        node = getattr(self._nodes, feature, None)
        try:
            if node is None:
                raise AttributeError("the camera does not have it")
            node.value = value
        except Exception as error:
            if needed:
                raise DeviceError(self.name, f"{feature} cannot be set to {value}: {_line(error)}") from error


def _rgb(picture: Image, data_format: str) -> Image:
    """(h, w) or (h, w, 3), red green blue; a mosaic is filled in."""
    if data_format.startswith("Bayer"):
        return np.asarray(cv2.cvtColor(picture[..., 0], BAYER[data_format[5:7]]))
    if picture.shape[2] == 1:
        return picture[..., 0]
    return np.ascontiguousarray(picture[..., 2::-1] if data_format.startswith("BGR") else picture[..., :3])


def _line(error: Exception) -> str:
    return " ".join(f"{type(error).__name__} {error}".split())
