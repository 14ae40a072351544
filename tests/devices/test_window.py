"""The projector's window, on a virtual screen: every pixel is the picture's, or it says why not."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from retrue.devices.window_projector import WindowProjector
from retrue.errors import DeviceError
from retrue.files.images import write_png
from retrue.patterns.color_grid import make_color_grid
from tests.devices.screens import needs_screen, needs_wayland, virtual_screen, wayland_desktop, weston

pytestmark = needs_screen
SIZE = (800, 600)
PROJECT = "from retrue.cli.main import main; import sys; sys.exit(main())", "project", "--screen", "0"


def test_the_screen_is_the_picture_byte_for_byte(tmp_path: Path):
    with virtual_screen(tmp_path, SIZE) as screen, contextlib.closing(WindowProjector(0, SIZE)) as window:
        window.open()
        assert window.size == SIZE
        assert screen.shows(np.zeros((600, 800, 3), np.uint8))
        for seed in range(3):
            noise = np.random.default_rng(seed).integers(0, 256, (600, 800, 3), dtype=np.uint8)
            window.show(noise)
            assert screen.shows(noise)
        grid = make_color_grid(SIZE).render()
        window.show(grid)
        assert screen.shows(grid)


def test_a_screen_of_another_size_or_number_is_refused(tmp_path: Path):
    with virtual_screen(tmp_path, SIZE):
        with pytest.raises(
            DeviceError, match=r"^screen 0: expected 1024 x 768 pixels, found 800 x 600: set the screen"
        ):
            WindowProjector(0, (1024, 768)).open()
        with pytest.raises(DeviceError, match=r"^screen 1: there is no such screen, found 1, numbered 0 to 0"):
            WindowProjector(1).open()
        with contextlib.closing(WindowProjector(0)) as window:  # as soon as it is there, it goes on
            window.open()
            assert window.size == SIZE


def test_no_display_is_one_sentence(monkeypatch: pytest.MonkeyPatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(DeviceError, match=r"^screen 0: there is no display: log in to a desktop, or set DISPLAY"):
        WindowProjector(0).open()


@needs_wayland
def test_a_desktop_that_has_ended_is_one_sentence(tmp_path: Path):
    write_png(tmp_path / "picture.png", np.zeros((600, 800, 3), np.uint8))
    gone = {"WAYLAND_DISPLAY": "wayland-gone", "XDG_SESSION_TYPE": "wayland", "XDG_RUNTIME_DIR": str(tmp_path)}
    environment = {name: value for name, value in os.environ.items() if name != "DISPLAY"} | gone
    words = [sys.executable, "-c", *PROJECT, "picture.png"]
    done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert (
        done.stderr == "retrue: screen 0: there is no display: log in to a desktop, or set DISPLAY or WAYLAND_DISPLAY\n"
    )


def test_project_shows_each_picture_for_its_time_and_ends(tmp_path: Path):
    pictures = np.random.default_rng(1).integers(0, 256, (2, 600, 800, 3), dtype=np.uint8)
    for number, picture in enumerate(pictures):
        write_png(tmp_path / f"{number}.png", picture)
    write_png(tmp_path / "small.png", pictures[0][:300])
    words = ["-c", *PROJECT]
    with virtual_screen(tmp_path, SIZE) as screen:
        shown = ["0.png", "1.png", "--seconds", "1.5"]
        with subprocess.Popen([sys.executable, *words, *shown], cwd=tmp_path, stdout=subprocess.PIPE, text=True) as run:
            try:
                assert screen.shows(pictures[0], patience=30.0)
                assert screen.shows(pictures[1])
                assert run.communicate(timeout=30)[0] == "ended\n"
                assert run.returncode == 0
            finally:
                run.kill()
        done = subprocess.run([sys.executable, *words, "small.png"], cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 2
        assert "small.png: expected 800 x 600 pixels for screen 0, found 800 x 300" in done.stderr


@needs_wayland
def test_a_desktop_without_keyboard_and_mouse_is_one_sentence(tmp_path: Path):
    write_png(tmp_path / "picture.png", np.zeros((600, 800, 3), np.uint8))
    runtime = tmp_path / "runtime"
    runtime.mkdir()
    with weston(runtime, "headless", SIZE) as environment:
        words = [sys.executable, "-c", *PROJECT, "picture.png"]
        done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == (
        "retrue: screen 0: the desktop has neither keyboard nor mouse, without which no window opens: plug one in\n"
    )


def test_a_monitor_that_is_unplugged_is_waited_for_and_shows_what_it_showed(tmp_path: Path):
    picture = np.random.default_rng(3).integers(0, 256, (600, 800, 3), dtype=np.uint8)
    write_png(tmp_path / "picture.png", picture)
    with virtual_screen(tmp_path, SIZE) as screen, contextlib.ExitStack() as stack:
        words = [sys.executable, "-c", *PROJECT, "picture.png"]
        run = stack.enter_context(subprocess.Popen(words, cwd=tmp_path, stderr=subprocess.PIPE, text=True))
        stack.callback(run.kill)
        assert run.stderr is not None
        assert screen.shows(picture, patience=30.0)
        with screen.unplugged():
            assert run.stderr.readline() == "screen 0: is gone: plug it in, switch the projector on; waiting for it\n"
            assert screen.hides(picture)
        assert screen.shows(picture, patience=30.0)
        assert run.stderr.readline() == "screen 0: is back\n"
        assert run.poll() is None


@needs_wayland
def test_a_desktop_that_ends_is_waited_for_and_shows_what_it_showed(tmp_path: Path):
    picture = np.random.default_rng(3).integers(0, 256, (600, 800, 3), dtype=np.uint8)
    write_png(tmp_path / "picture.png", picture)
    runtime = tmp_path / "runtime"
    runtime.mkdir()
    with virtual_screen(tmp_path, SIZE) as screen, contextlib.ExitStack() as stack:
        with weston(runtime, "x11", SIZE) as environment:
            words = [sys.executable, "-c", *PROJECT, "picture.png"]
            run = stack.enter_context(
                subprocess.Popen(words, cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True)
            )
            stack.callback(run.kill)
            assert screen.shows(picture, patience=30.0)
        assert run.stderr is not None
        assert run.stderr.readline() == "screen 0: is gone: plug it in, switch the projector on; waiting for it\n"
        assert screen.hides(picture)
        with weston(runtime, "x11", SIZE):
            assert screen.shows(picture, patience=30.0)
            assert run.stderr.readline() == "screen 0: is back\n"
            assert run.poll() is None


CHILD = """
import sys, numpy as np
from retrue.devices.window_projector import WindowProjector
window = WindowProjector(0, (int(sys.argv[1]), int(sys.argv[2])))
window.open()
import glfw
print(glfw.get_platform() == glfw.PLATFORM_WAYLAND, flush=True)
for line in sys.stdin:
    window.show(np.load(line.strip()))
    print("shown", flush=True)
window.close()
"""


@needs_wayland
def test_under_wayland_too(tmp_path: Path):
    """In a process of its own: which library GLFW loads depends on the desktop, and is settled once."""
    runtime = tmp_path / "runtime"
    runtime.mkdir()
    grid = make_color_grid(SIZE).render()
    noise = np.random.default_rng(1).integers(0, 256, grid.shape, dtype=np.uint8)
    with wayland_desktop(runtime, SIZE) as (screen, environment):

        def child(*size: int) -> subprocess.Popen[str]:
            command = [sys.executable, "-c", CHILD, *map(str, size)]
            pipe = subprocess.PIPE
            return subprocess.Popen(command, env=environment, stdin=pipe, stdout=pipe, stderr=pipe, text=True)

        window = child(*SIZE)
        assert window.stdin is not None
        assert window.stdout is not None
        assert window.stdout.readline() == "True\n"
        for number, picture in enumerate((np.zeros_like(grid), grid, noise, grid)):
            np.save(tmp_path / f"{number}.npy", picture)
            print(tmp_path / f"{number}.npy", file=window.stdin, flush=True)
            assert window.stdout.readline() == "shown\n"
            assert screen.shows(picture)
        window.communicate(timeout=60)
        assert window.returncode == 0
        _, said = child(1024, 768).communicate(timeout=60)
        assert "screen 0: expected 1024 x 768 pixels, found 800 x 600: set the screen" in said
