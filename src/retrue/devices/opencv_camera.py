"""A USB camera, a video file or a network stream, through OpenCV."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np

from retrue.devices.protocols import CameraFrame
from retrue.errors import DeviceError
from retrue.geometry.arrays import Image
from retrue.video_stream import open_video

BUFFERED = 8  # frames that wait for whoever takes them; older ones are gone
PATIENCE = 5.0  # seconds without a frame after which a camera is taken for gone
OPENING = 10_000  # ms for a stream to answer
MANUAL = 1.0  # of V4L2's exposure modes
TOLERANCE = 0.25  # of an exposure that a camera may round to a step that it has


@dataclass
class OpencvCamera:
    """Frames are fetched by a thread of their own as they come, so that each has its time and none waits in a queue.

    Attributes
    ----------
    device : index of a USB camera, path of a video, or address of a stream.
    exposure_ms, gain, white_balance_k : fixed while it is open; not given: as they are.
    size : (width, height), where the camera has several. `fps` : the same.
    """

    device: int | str = 0
    exposure_ms: float | None = None
    gain: float | None = None
    white_balance_k: float | None = None
    size: tuple[int, int] | None = None
    fps: float | None = None
    triggered: bool = field(default=False, init=False)
    _capture: Any = field(default=None, init=False)
    _thread: threading.Thread | None = field(default=None, init=False)
    _frames: deque[CameraFrame] = field(
        default_factory=lambda: deque[CameraFrame](maxlen=BUFFERED), init=False, compare=False
    )
    _changed: threading.Condition = field(default_factory=threading.Condition, init=False, compare=False)
    _stop: bool = field(default=False, init=False)

    @property
    def name(self) -> str:
        return f"camera {self.device}"

    def open(self) -> None:
        capture = open_video(self.device, OPENING, int(1000 * PATIENCE))
        if not capture.isOpened():
            capture.release()
            raise DeviceError(self.name, "cannot be opened: is it plugged in, and does no other program use it?")
        self._capture = capture
        if self.size is not None:
            self._set(cv2.CAP_PROP_FRAME_WIDTH, self.size[0], "size")
            self._set(cv2.CAP_PROP_FRAME_HEIGHT, self.size[1], "size")
        if self.fps is not None:
            self._set(cv2.CAP_PROP_FPS, self.fps, "fps")
        if self.white_balance_k is not None:
            capture.set(cv2.CAP_PROP_AUTO_WB, 0)
            self._set(cv2.CAP_PROP_WB_TEMPERATURE, self.white_balance_k, "white_balance_k")
        if self.gain is not None:
            self._set(cv2.CAP_PROP_GAIN, self.gain, "gain")
        if self.exposure_ms is not None:
            self.set_exposure(self.exposure_ms)
        elif isinstance(self.device, int):
            self.exposure_ms = self._read_exposure()
        self._stop = False
        self._frames.clear()
        self._thread = threading.Thread(target=self._fetch, args=(capture,), daemon=True)
        self._thread.start()

    def frame(self) -> CameraFrame:
        with self._changed:
            self._changed.wait_for(lambda: bool(self._frames) or self._thread is None, PATIENCE)
            if not self._frames:
                ended = isinstance(self.device, str) and Path(self.device).exists()
                raise DeviceError(
                    self.name, "has ended" if ended else "sends no frames any more: is it plugged in, and switched on?"
                )
            return self._frames.popleft()

    def set_exposure(self, exposure_ms: float) -> None:
        if not isinstance(self.device, int):
            raise DeviceError(
                self.name, "the exposure of a stream cannot be set from here: set it on the camera, leave it out"
            )
        if self._capture.getBackendName() == "V4L2":
            self._capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, MANUAL)
            self._capture.set(cv2.CAP_PROP_EXPOSURE, round(10 * exposure_ms))
        else:
            self._capture.set(cv2.CAP_PROP_EXPOSURE, math.log2(exposure_ms / 1000))
        found = self._read_exposure()
        if found is None or not abs(found - exposure_ms) <= max(TOLERANCE * exposure_ms, 0.1):
            raise DeviceError(
                self.name,
                f"exposure_ms = {exposure_ms:g} cannot be set, it stays at {found}: set it with the camera's tool",
            )
        self.exposure_ms = found

    def close(self) -> None:
        self._stop = True
        if self._thread is not None:
            self._thread.join(2 * PATIENCE)
        if self._capture is not None:
            self._capture.release()
        self._thread = self._capture = None

    def _set(self, key: int, value: float, name: str) -> None:
        self._capture.set(key, value)
        found = self._capture.get(key)
        if not abs(found - value) <= 0.01 * abs(value):
            raise DeviceError(self.name, f"{name}: cannot be set to {value:g}, it stays at {found:g}")

    def _read_exposure(self) -> float | None:
        """In ms: V4L2 counts tenths of them, others tell the logarithm of seconds; None where it says nothing."""
        found = float(self._capture.get(cv2.CAP_PROP_EXPOSURE))
        if self._capture.getBackendName() == "V4L2":
            return found / 10 if found > 0 else None
        return 1000 * 2.0**found if -20 < found < 5 and found != 0 else None

    def _fetch(self, capture: Any) -> None:
        """Until the camera ends or we do; a file is not read faster than it is taken."""
        whole = isinstance(self.device, str) and Path(self.device).exists()
        while not self._stop:
            ok, picture = capture.read()
            at = time.monotonic()
            if not ok:
                break
            frame = CameraFrame(np.ascontiguousarray(cast("Image", picture)[..., ::-1]), at)
            with self._changed:
                while whole and len(self._frames) == BUFFERED and not self._stop:
                    self._changed.wait(0.1)
                self._frames.append(frame)
                self._changed.notify_all()
        with self._changed:
            self._thread = None
            self._changed.notify_all()
