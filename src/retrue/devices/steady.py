"""Devices that come back: one that goes away is waited for, in one sentence, and opened again."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from retrue.devices.protocols import CameraDriver, CameraFrame, ProjectorDriver, Size
from retrue.errors import DeviceError

Result = TypeVar("Result")
PAUSE = 0.5  # seconds between two tries to open it


class _Steady:
    """`tell` is handed a sentence when the device goes, and another one when it is back."""

    def __init__(self, device: Any, tell: Callable[[str], None], patience: float) -> None:
        self._device, self._tell, self._patience = device, tell, patience

    @property
    def name(self) -> str:
        return self._device.name

    def open(self) -> None:
        self._device.open()

    def close(self) -> None:
        self._device.close()

    def _done(self, work: Callable[[], Result]) -> Result:
        """What `work` returns, however often the device must be opened for it; the error, where patience ends."""
        try:
            return work()
        except DeviceError as error:
            gone, problem = time.monotonic(), error
        self._tell(f"{problem}; waiting for it")
        while time.monotonic() - gone < self._patience:
            try:
                self._device.close()
                self._device.open()
                self._reopened()
                result = work()
            except DeviceError as error:
                problem = error
                time.sleep(PAUSE)
            else:
                self._tell(f"{self.name}: is back")
                return result
        raise problem

    def _reopened(self) -> None:
        """What else it takes to go on where it was."""


class SteadyCamera(_Steady):
    """A camera that is waited for, so many seconds, when it goes away."""

    def __init__(self, camera: CameraDriver, tell: Callable[[str], None], patience: float = 60.0) -> None:
        super().__init__(camera, tell, patience)

    @property
    def triggered(self) -> bool:
        return self._device.triggered

    @property
    def exposure_ms(self) -> float | None:
        return self._device.exposure_ms

    def frame(self) -> CameraFrame:
        return self._done(self._device.frame)

    def set_exposure(self, exposure_ms: float) -> None:
        self._device.set_exposure(exposure_ms)


class SteadyProjector(_Steady):
    """A projector that is waited for, so many seconds, when it goes away."""

    def __init__(self, projector: ProjectorDriver, tell: Callable[[str], None], patience: float = 60.0) -> None:
        super().__init__(projector, tell, patience)
        self._last: NDArray[np.uint8] | None = None

    @property
    def size(self) -> Size:
        return self._device.size

    def show(self, picture: NDArray[np.uint8], at: float = 0.0) -> float:
        shown_at = self._done(lambda: self._device.show(picture, at))
        self._last = picture
        return shown_at

    def wait(self, seconds: float) -> str:
        """As a window waits, for the time or for a key."""
        end = time.monotonic() + seconds
        while not (wish := self._done(lambda: self._device.wait(min(PAUSE, max(end - time.monotonic(), 0.0))))):
            if time.monotonic() >= end:
                break
        return wish

    def _reopened(self) -> None:
        if self._last is not None:
            self._device.show(self._last)
