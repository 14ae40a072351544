"""Where examples run: a folder that holds what a page takes for granted, and what its examples leave."""

from __future__ import annotations

import ast
import contextlib
import functools
import io
import os
import shlex
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import retrue
from retrue.cli.main import main
from retrue.patterns.color_grid import make_color_grid
from tests.docs.pages import ROOT, Example

GIVEN = ROOT / "docs" / "try"
"""What a reader has: a rig file from before a bump, and one picture, of the pattern, from after it."""
LONGEST = 60  # seconds that a command may take


class Sandbox:
    """Runs the examples of one page, in their order."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._names: dict[str, Any] = {}
        self._status = 0
        for name in ("rig.json", "wall.jpg", "setup.toml"):
            shutil.copyfile(GIVEN / name, folder / name)
        retrue.write_pattern(folder / "pattern.json", given("pattern"))
        retrue.write_rig(folder / "calibration.yml", given("rig"), to="scan3d-capture")
        retrue.write_rig(folder / "camera_info.yaml", given("rig"), to="ros-camera")

    def run(self, example: Example) -> str:
        """What it prints."""
        with _inside(self.folder), _printed() as printed:
            if example.language == "python":
                self._names |= {name: given(name) for name in _taken_for_granted(example.source) - self._names.keys()}
                exec(compile(example.source, "example", "exec"), self._names)
            else:
                self._call(example.source.replace("\\\n", " "))
        return printed.getvalue()

    def drawn(self, shown: str) -> Path | None:
        """The file of that name that the examples left, if they did."""
        return next(self.folder.rglob(Path(shown).name), None)

    def _call(self, command: str) -> None:
        if command == "echo $?":
            print(self._status)
        elif command.startswith("retrue "):
            try:
                self._status = main(_words(command)[1:])
            except SystemExit as stop:  # --help
                self._status = int(stop.code or 0)
        else:
            done = subprocess.run(
                ["sh", "-c", command], capture_output=True, text=True, timeout=LONGEST, check=False, cwd=self.folder
            )
            print(done.stdout + done.stderr, end="")
            self._status = done.returncode


@functools.cache
def given(name: str) -> Any:
    """What a page may take for granted in Python, by the name that it calls it."""
    match name:
        case "rig":
            return retrue.read_rig(GIVEN / "rig.json")
        case "pattern":
            return make_color_grid((1024, 768))
        case "image" | "photograph":
            return retrue.read_image(GIVEN / "wall.jpg")
        case "points":
            return retrue.decode(given("pattern"), given("image"))
        case _:
            return retrue.recalibrate(given("rig"), [given("points")])


def _taken_for_granted(source: str) -> set[str]:
    """Which of the given names are used, and not made."""
    names = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Name)]
    made = {name.id for name in names if isinstance(name.ctx, ast.Store)}
    return {name.id for name in names} & {"rig", "pattern", "image", "photograph", "points", "result"} - made


def _words(command: str) -> list[str]:
    """As the shell takes them apart, and fills in the names that a * stands for."""
    words = shlex.split(command, comments=True)
    return [name for word in words for name in (sorted(map(str, Path().glob(word))) if "*" in word else [word])]


@contextlib.contextmanager
def _inside(folder: Path) -> Iterator[None]:
    """As on a terminal of 80 columns, in that folder."""
    before = {name: os.environ.get(name) for name in ("COLUMNS", "MPLBACKEND", "LC_ALL")}
    os.environ.update({"COLUMNS": "80", "MPLBACKEND": "agg", "LC_ALL": "C"})
    try:
        with contextlib.chdir(folder):
            yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextlib.contextmanager
def _printed() -> Iterator[io.StringIO]:
    """Both streams as a terminal shows them: in one."""
    stream = io.StringIO()
    with contextlib.redirect_stdout(stream), contextlib.redirect_stderr(stream):
        yield stream
