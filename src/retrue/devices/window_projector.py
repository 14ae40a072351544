"""A projector as the operating system sees one: a screen, filled pixel for pixel by one window, through GLFW."""

from __future__ import annotations

import contextlib
import ctypes
import os
import subprocess
import sys
import time
import warnings
from collections.abc import Generator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retrue.devices.drivers import imported
from retrue.devices.gl_picture import GlPicture
from retrue.errors import DeviceError

LONGEST_WAIT = 0.2  # seconds between two looks at whether the screen is still there
KEYS = {"SPACE": "next", "RIGHT": "next", "ENTER": "next", "LEFT": "back", "ESCAPE": "quit", "Q": "quit"}


@dataclass
class WindowProjector:
    """Full screen at the screen's own video mode, so that nothing is scaled; must be used from one thread.

    Attributes
    ----------
    screen : number of the screen, from 0, in the order of the operating system.
    size : (width, height) that the screen must have; (0, 0): any, and the screen's own once it is open.
    """

    screen: int = 0
    size: tuple[int, int] = (0, 0)
    _glfw: Any = field(default=None, init=False)
    _window: Any = field(default=None, init=False)
    _picture: GlPicture | None = field(default=None, init=False)
    _wishes: list[str] = field(default_factory=list[str], init=False)

    @property
    def name(self) -> str:
        return f"screen {self.screen}"

    def open(self) -> None:
        glfw = self._glfw = imported("glfw", "window", self.name)
        with _quiet():
            if b"Wayland" in glfw.get_version_string() and os.environ.get("WAYLAND_DISPLAY") and not _starts():
                raise DeviceError(
                    self.name, "the desktop has neither keyboard nor mouse, without which no window opens: plug one in"
                )
            if not glfw.init():
                raise DeviceError(
                    self.name, "there is no display: log in to a desktop, or set DISPLAY or WAYLAND_DISPLAY"
                )
            try:
                self._open_on(self._monitor())
            except BaseException:
                self.close()
                raise

    def show(self, picture: NDArray[np.uint8], at: float = 0.0) -> float:
        if self._window is None or self._picture is None:
            raise DeviceError(self.name, "is not open")
        with _quiet():
            self._require_monitor()
            self._picture.draw(np.ascontiguousarray(picture))
            while (left := at - time.monotonic()) > 0:
                time.sleep(min(left, 0.05))
                self._glfw.poll_events()
            self._glfw.swap_buffers(self._window)
            self._picture.finish()  # waits until the swap is done, and with it for the screen's refresh
            self._glfw.poll_events()
        return time.monotonic()

    def wait(self, seconds: float) -> str:
        """Let so much time pass; returns at once "next", "back" or "quit" where somebody presses a key for it."""
        end = time.monotonic() + seconds
        with _quiet():
            while not self._wishes and (left := end - time.monotonic()) > 0:
                self._glfw.wait_events_timeout(min(LONGEST_WAIT, left))
                self._require_monitor()
        return self._wishes.pop(0) if self._wishes else ""

    def close(self) -> None:
        if self._glfw is not None:
            with _quiet():
                if self._window is not None:
                    self._glfw.destroy_window(self._window)
                self._glfw.terminate()
        self._glfw = self._window = self._picture = None

    def _monitor(self) -> Any:
        monitors = self._glfw.get_monitors()
        if not self.screen < len(monitors):
            raise DeviceError(
                self.name,
                f"there is no such screen, found {_counted(len(monitors))}: switch the projector on, plug it in",
            )
        return monitors[self.screen]

    def _open_on(self, monitor: Any) -> None:
        glfw = self._glfw
        mode = glfw.get_video_mode(monitor)
        width, height = mode.size.width, mode.size.height
        if any(self.size) and self.size != (width, height):
            raise DeviceError(
                self.name,
                f"expected {self.size[0]} x {self.size[1]} pixels, found {width} x {height}: "
                "set the screen to the projector's own resolution, or write its size into the setup",
            )
        bits = mode.bits
        hints = {glfw.RED_BITS: bits.red, glfw.GREEN_BITS: bits.green, glfw.BLUE_BITS: bits.blue}
        hints |= {glfw.REFRESH_RATE: mode.refresh_rate, glfw.AUTO_ICONIFY: False, glfw.DECORATED: False}
        hints |= {glfw.FOCUS_ON_SHOW: False, glfw.SAMPLES: 0}
        for hint, value in hints.items():
            glfw.window_hint(hint, value)
        self._window = glfw.create_window(width, height, "retrue", monitor, None)
        if not self._window:
            raise DeviceError(self.name, "no window can be opened on it: is OpenGL installed?")
        glfw.make_context_current(self._window)
        glfw.swap_interval(1)
        glfw.set_input_mode(self._window, glfw.CURSOR, glfw.CURSOR_HIDDEN)
        wishes = {getattr(glfw, f"KEY_{key}"): wish for key, wish in KEYS.items()}

        def pressed(_window: Any, key: int, _code: int, action: int, _modifiers: int) -> None:
            if action == glfw.PRESS and key in wishes:
                self._wishes.append(wishes[key])

        glfw.set_key_callback(self._window, pressed)
        glfw.poll_events()
        found = tuple(glfw.get_framebuffer_size(self._window))
        if found != (width, height):
            raise DeviceError(
                self.name,
                f"the desktop scales it: expected {width} x {height} pixels, found {found[0]} x {found[1]}; "
                "set its scaling to 100 %",
            )
        self._picture = GlPicture(_address_of(glfw), (width, height))
        self.size = (width, height)
        self.show(np.zeros((height, width, 3), np.uint8))

    def _require_monitor(self) -> None:
        monitors = self._glfw.get_monitors()
        mine = self._glfw.get_window_monitor(self._window)
        if self._glfw.window_should_close(self._window) or not mine or self.screen >= len(monitors):
            raise DeviceError(self.name, "is gone: plug it in, switch the projector on")
        size = self._glfw.get_video_mode(mine).size
        if self.size != (size.width, size.height):
            raise DeviceError(self.name, f"its resolution has changed to {size.width} x {size.height}: set it back")


def _address_of(glfw: Any) -> Any:
    def address(name: str) -> int:
        found = ctypes.cast(glfw.get_proc_address(name), ctypes.c_void_p).value
        if not found:
            raise DeviceError("screen", f"its OpenGL has no {name}: install its driver")
        return found

    return address


def _starts() -> bool:
    """Whether GLFW lives: it reads through a null pointer on a Wayland desktop without a seat (3.4; glfw/glfw#2517)."""
    tried = [sys.executable, "-W", "ignore", "-c", "import glfw; glfw.init()"]
    return subprocess.run(tried, check=False).returncode >= 0


def _counted(count: int) -> str:
    return "none" if count == 0 else f"{count}, numbered 0 to {count - 1}"


@contextlib.contextmanager
def _quiet() -> Generator[None]:
    """GLFW's warnings come as exceptions of our own, in one line."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield
