"""Stand-ins for packages that need hardware: what the drivers use of their interfaces, as their makers wrote them.

harvesters 1.4 (Harvester, ImageAcquirer, Buffer), python-gphoto2 2.6 (Camera, CameraWidget, CameraFile), picamera2 0.3.
"""

from __future__ import annotations

import sys
import time
from types import ModuleType, SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest


class Node:
    """A GenICam feature."""

    def __init__(self, value: Any, allowed: Any = None) -> None:
        self._value, self._allowed = value, allowed

    @property
    def value(self) -> Any:
        return self._value

    @value.setter
    def value(self, value: Any) -> None:
        if self._allowed is not None and value not in self._allowed:
            raise ValueError(f"OutOfRangeException: {value}")
        self._value = value


class Gentl:
    """A camera behind harvesters, with a mosaic of red, green, green, blue."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.serials, self.plugged, self.triggers, self.log = ["A1", "B2"], True, 0, list[str]()
        self.nodes = SimpleNamespace(
            ExposureTime=Node(5000.0), Gain=Node(0.0), ExposureAuto=Node("Continuous"), GainAuto=Node("Continuous"),
            PixelFormat=Node("BayerRG8", {"BayerRG8", "Mono8", "RGB8"}), AcquisitionFrameRate=Node(10.0),
            TriggerMode=Node("Off"), TriggerSource=Node("Line0"),
            TriggerSoftware=SimpleNamespace(execute=self._trigger),
        )  # fmt: skip
        core = ModuleType("harvesters.core")
        core.Harvester = lambda: self  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, "harvesters", ModuleType("harvesters"))
        monkeypatch.setitem(sys.modules, "harvesters.core", core)
        self.remote_device = SimpleNamespace(node_map=self.nodes)

    @property
    def device_info_list(self) -> list[Any]:
        return [SimpleNamespace(serial_number=serial) for serial in self.serials] if self.plugged else []

    def add_file(self, path: str, check_existence: bool = False, check_validity: bool = False) -> None:
        if not path.endswith(".cti"):
            raise FileNotFoundError(path)

    def update(self) -> None: ...

    def create(self, search_key: int | dict[str, str] | None = None) -> Any:
        numbers = range(len(self.device_info_list))
        if isinstance(search_key, dict):
            numbers = [n for n in numbers if self.serials[n] == search_key["serial_number"]]
        elif search_key not in numbers:
            raise IndexError("list index out of range")
        if not numbers:
            raise ValueError("no matching device")
        return self

    def start(self) -> None:
        self.log.append("start")

    def stop(self) -> None:
        self.log.append("stop")

    def destroy(self) -> None:
        self.log.append("destroy")

    def reset(self) -> None:
        self.log.append("reset")

    def _trigger(self) -> None:
        self.triggers += 1

    def fetch(self, *, timeout: float = 0, is_raw: bool = False, cycle_s: float | None = None) -> Any:
        if not self.plugged:
            raise TimeoutError("GenTL -1011")
        data = np.zeros((48, 64), np.uint8)
        data[::2, ::2] = 200  # red
        data[1::2, 1::2] = 40  # blue
        shape: dict[str, Any] = {"width": 64, "height": 48, "num_components_per_pixel": 1.0, "data_format": "BayerRG8"}
        if self.nodes.PixelFormat.value == "RGB8":
            data = np.tile(np.array([1, 2, 3], np.uint8), 48 * 64)
            shape |= {"num_components_per_pixel": 3.0, "data_format": "RGB8"}
        return _Buffer(SimpleNamespace(data=data.ravel(), **shape))


class _Buffer:
    def __init__(self, component: Any) -> None:
        self.payload = SimpleNamespace(components=[component])

    def __enter__(self) -> _Buffer:
        return self

    def __exit__(self, *_: object) -> None:
        self.payload.components[0].data[:] = 0  # goes back to the camera, which writes the next frame there


class Gphoto2(ModuleType):
    """A digital camera behind python-gphoto2."""

    GP_CAPTURE_IMAGE, GP_FILE_TYPE_NORMAL = 0, 1

    class GPhoto2Error(Exception):
        """As libgphoto2 says it."""

        def __init__(self, code: int) -> None:
            self.code, self.string = code, "Could not find the requested device on the USB port"
            super().__init__(f"[{code}] {self.string}")

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        super().__init__("gphoto2")
        self.plugged, self.raw, self.card = True, False, dict[tuple[str, str], bytes]()
        self.steps = {"shutterspeed": ["bulb", "30", "1", "1/2", "1/60", "1/125"], "iso": ["Auto", "100", "200"]}
        self.set_to = {"shutterspeed": "1/125", "iso": "Auto"}
        monkeypatch.setitem(sys.modules, "gphoto2", self)

    def Camera(self) -> Any:
        return _Camera(self)


class _Camera:
    def __init__(self, library: Gphoto2) -> None:
        self._library, self._config = library, dict(library.set_to)

    def _need(self) -> None:
        if not self._library.plugged:
            raise self._library.GPhoto2Error(-52)

    def init(self) -> None:
        self._need()

    def exit(self) -> None:
        self._need()

    def get_config(self) -> Any:
        self._need()
        return self

    def get_child_by_name(self, name: str) -> Any:
        steps, config = self._library.steps[name], self._config
        return SimpleNamespace(
            count_choices=lambda: len(steps),
            get_choice=lambda number: steps[number],
            get_value=lambda: config[name],
            set_value=lambda value: config.update({name: value}),
        )

    def set_config(self, config: Any) -> None:
        self._library.set_to = dict(self._config)

    def capture(self, kind: int) -> Any:
        self._need()
        assert kind == self._library.GP_CAPTURE_IMAGE
        picture = np.zeros((48, 64, 3), np.uint8)
        picture[..., 0] = 200  # red
        _, content = cv2.imencode(".jpg", picture[..., ::-1])
        self._library.card["/store", "IMG_1.JPG"] = b"II*\0raw" if self._library.raw else content.tobytes()
        return SimpleNamespace(folder="/store", name="IMG_1.JPG")

    def file_get(self, folder: str, name: str, kind: int) -> Any:
        return SimpleNamespace(get_data_and_size=lambda: self._library.card[folder, name])

    def file_delete(self, folder: str, name: str) -> None:
        del self._library.card[folder, name]


class Picamera2(ModuleType):
    """A Raspberry Pi's camera behind picamera2; settings come into force some frames later."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        super().__init__("picamera2")
        self.plugged, self.longest_us, self.out = True, 33_000, 0
        self.controls: dict[str, Any] = {"ExposureTime": 9000, "AnalogueGain": 2.0, "ColourGains": (1.5, 1.8)}
        self._coming: list[dict[str, Any]] = []
        self.configuration: Any = None
        monkeypatch.setitem(sys.modules, "picamera2", self)

    def Picamera2(self, camera_num: int = 0) -> Any:
        if not self.plugged:
            raise IndexError("list index out of range")
        return self

    def create_video_configuration(self, main: Any = None, controls: Any = None, **_: Any) -> Any:
        return {"main": main, "controls": controls}

    def configure(self, configuration: Any) -> None:
        self.configuration = configuration

    def start(self) -> None: ...
    def stop(self) -> None: ...
    def close(self) -> None: ...

    def set_controls(self, controls: dict[str, Any]) -> None:
        self._coming = [{}, {}, {}, controls]

    def capture_request(self) -> Any:
        if not self.plugged:
            raise RuntimeError("Camera frontend has timed out")
        if self._coming:
            self.controls |= self._coming.pop(0)
        self.controls["ExposureTime"] = min(self.controls["ExposureTime"], self.longest_us)
        self.out += 1
        width, height = self.configuration["main"]["size"]
        picture = np.zeros((height, width, 3), np.uint8)
        picture[..., 0 if self.configuration["main"]["format"] == "BGR888" else 2] = 200  # red
        began = time.clock_gettime_ns(time.CLOCK_BOOTTIME) - 20_000_000
        return SimpleNamespace(
            make_array=lambda name: picture,
            get_metadata=lambda: {**self.controls, "SensorTimestamp": began},
            release=self._release,
        )

    def _release(self) -> None:
        self.out -= 1
