"""Virtual screens: an X server that draws into memory, whose pixels can be read; and a Wayland desktop on it."""

from __future__ import annotations

import contextlib
import ctypes
import os
import shutil
import struct
import subprocess
import time
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

needs_wayland = pytest.mark.skipif(
    shutil.which("Xvfb") is None or shutil.which("weston") is None, reason="no Wayland desktop: make display"
)
needs_screen = pytest.mark.skipif(shutil.which("Xvfb") is None, reason="no virtual screen: make display")


@contextlib.contextmanager
def virtual_screen(folder: Path, size: tuple[int, int]) -> Generator[VirtualScreen]:
    """A display of its own, named in DISPLAY until the block ends."""
    reading, writing = os.pipe()
    screen = [f"{size[0]}x{size[1]}x24", "-fbdir", str(folder), "-nolisten", "tcp"]
    server = subprocess.Popen(
        ["Xvfb", "-noreset", "-displayfd", str(writing), "-screen", "0", *screen],
        pass_fds=[writing],
        stderr=subprocess.DEVNULL,
    )
    os.close(writing)
    with os.fdopen(reading) as stream:
        display = f":{stream.readline().strip()}"
    before = {name: os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "XDG_SESSION_TYPE")}
    os.environ["DISPLAY"] = display
    for name in ("WAYLAND_DISPLAY", "XDG_SESSION_TYPE"):
        os.environ.pop(name, None)
    try:
        yield VirtualScreen(server, folder / "Xvfb_screen0")
    finally:
        server.terminate()
        server.wait()
        for name, value in before.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value


@contextlib.contextmanager
def wayland_desktop(folder: Path, size: tuple[int, int]) -> Generator[tuple[VirtualScreen, dict[str, str]]]:
    """A compositor whose only output fills a virtual screen, and the environment in which programs find it."""
    with virtual_screen(folder, size) as screen, weston(folder, "x11", size) as environment:
        yield screen, environment


@contextlib.contextmanager
def weston(folder: Path, backend: str, size: tuple[int, int]) -> Generator[dict[str, str]]:
    """The compositor, and the environment in which programs find it; a headless one has neither keyboard nor mouse."""
    folder.chmod(0o700)
    settings = {**os.environ, "XDG_RUNTIME_DIR": str(folder), "LIBGL_ALWAYS_SOFTWARE": "1"}
    output = [f"--width={size[0]}", f"--height={size[1]}", "--use-pixman"]
    desktop = [f"--backend={backend}-backend.so", "--shell=kiosk-shell.so", "--socket=wayland-test", "--idle-time=0"]
    server = subprocess.Popen(
        ["weston", *desktop, *output], env=settings, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL
    )
    try:
        end = time.monotonic() + 60
        while not (folder / "wayland-test").is_socket():
            assert server.poll() is None
            assert time.monotonic() < end
            time.sleep(0.05)
        settings.pop("DISPLAY", None)
        yield {**settings, "WAYLAND_DISPLAY": "wayland-test", "XDG_SESSION_TYPE": "wayland"}
    finally:
        server.terminate()
        server.wait()


class VirtualScreen:
    """What is on it, from the picture (XWD) that the server keeps in a file."""

    def __init__(self, server: subprocess.Popen[bytes], path: Path) -> None:
        self.server, self._path = server, path

    def pixels(self) -> np.ndarray:
        """(h, w, 3), red green blue."""
        content = self._path.read_bytes()
        head = struct.unpack(">25I", content[:100])
        start, width, height, stride = head[0] + 12 * head[19], head[4], head[5], head[12]
        rows = np.frombuffer(content, np.uint8, stride * height, start).reshape(height, stride)
        return rows[:, : 4 * width].reshape(height, width, 4)[..., 2::-1]

    def shows(self, picture: np.ndarray, patience: float = 10.0) -> bool:
        """Whether it comes to show exactly that."""
        return self._comes_to(lambda: np.array_equal(self.pixels(), picture), patience)

    def hides(self, picture: np.ndarray, patience: float = 10.0) -> bool:
        """Whether it comes to show something else."""
        return self._comes_to(lambda: not np.array_equal(self.pixels(), picture), patience)

    @staticmethod
    def _comes_to(happens: Callable[[], bool], patience: float) -> bool:
        end = time.monotonic() + patience
        while not happens():
            if time.monotonic() > end:
                return False
            time.sleep(0.02)
        return True

    @contextlib.contextmanager
    def unplugged(self) -> Generator[None]:
        """The monitor, by RandR."""
        x11, randr = ctypes.CDLL("libX11.so.6"), ctypes.CDLL("libXrandr.so.2")
        x11.XOpenDisplay.restype = ctypes.c_void_p
        x11.XDefaultRootWindow.restype = ctypes.c_ulong
        display = ctypes.c_void_p(x11.XOpenDisplay(None))
        root = ctypes.c_ulong(x11.XDefaultRootWindow(display))
        randr.XRRGetScreenResources.restype = ctypes.POINTER(_Resources)
        randr.XRRGetCrtcInfo.restype = ctypes.POINTER(_Crtc)
        resources = randr.XRRGetScreenResources(display, root)
        crtc = ctypes.c_ulong(resources.contents.crtcs[0])
        info = randr.XRRGetCrtcInfo(display, resources, crtc).contents

        def set_up(mode: int, outputs: Any, count: int) -> None:
            now, upright = ctypes.c_ulong(0), 1
            assert not randr.XRRSetCrtcConfig(
                display, resources, crtc, now, 0, 0, ctypes.c_ulong(mode), upright, outputs, count
            )
            x11.XSync(display, 0)

        set_up(0, None, 0)
        try:
            yield
        finally:
            set_up(info.mode, info.outputs, info.noutput)
            x11.XCloseDisplay(display)


class _Resources(ctypes.Structure):
    _fields_ = [
        ("timestamp", ctypes.c_ulong),
        ("config_timestamp", ctypes.c_ulong),
        ("ncrtc", ctypes.c_int),
        ("crtcs", ctypes.POINTER(ctypes.c_ulong)),
    ]


class _Crtc(ctypes.Structure):
    _fields_ = [
        ("timestamp", ctypes.c_ulong),
        ("x", ctypes.c_int),
        ("y", ctypes.c_int),
        ("width", ctypes.c_uint),
        ("height", ctypes.c_uint),
        ("mode", ctypes.c_ulong),
        ("rotation", ctypes.c_ushort),
        ("noutput", ctypes.c_int),
        ("outputs", ctypes.POINTER(ctypes.c_ulong)),
    ]
