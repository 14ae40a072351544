"""The command line, run in process; and a small synthetic rig with a capture of it."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from retrue import Camera, Correspondences, Rig, RigidTransform, write_points, write_rig
from retrue.cli.main import main
from tests.asked_once import judged_once, lit_once

__all__ = ["judged_once", "lit_once"]

DATA = Path(__file__).parents[2].parent / "shared" / "data"


@dataclass(frozen=True)
class Run:
    """What a command left behind."""

    status: int
    out: str
    err: str

    @property
    def json(self) -> dict[str, Any]:
        """stdout, which must be one JSON object and nothing else."""
        value = json.loads(self.out)
        assert isinstance(value, dict)
        return value

    def require_complaint(self, *parts: str) -> None:
        """Bad input: status 2, nothing on stdout, and one line that says so, after whatever progress there was."""
        lines = self.err.splitlines()
        complaints = [line for line in lines if line.startswith("retrue: ")]
        assert self.status == 2, self
        assert self.out == ""
        assert len(complaints) == 1, lines
        assert lines[-1] == complaints[0], lines
        assert "Traceback" not in self.err
        for part in parts:
            assert part in complaints[0]


Retrue = Callable[..., Run]


@pytest.fixture
def retrue(capsys: pytest.CaptureFixture[str]) -> Retrue:
    """Runs `retrue ARGUMENT...`."""

    def run(*arguments: object) -> Run:
        capsys.readouterr()
        try:
            status = main([str(argument) for argument in arguments])
        except SystemExit as stop:
            status = int(stop.code or 0)
        captured = capsys.readouterr()
        return Run(status, captured.out, captured.err)

    return run


@pytest.fixture
def board() -> Path:
    """The real captures of a board, where they are."""
    folder = DATA / "procam-board"
    if not folder.is_dir():
        pytest.skip(f"no real captures: {folder} is not there")
    return folder


CAMERA = Camera((1280, 960), [[1500, 0, 640], [0, 1500, 480], [0, 0, 1]], [-0.08, 0.02, 0, 0, 0])
PROJECTOR = Camera((1024, 768), [[1600, 0, 512], [0, 1600, 700], [0, 0, 1]])
TRUE = RigidTransform.from_rotation_vector([0.1, 0.25, 0.02], [-400.0, 30.0, 60.0])


def wall_and_box(noise_px: float = 0.05, seed: int = 0) -> Correspondences:
    """A wall with a box before it, 600 points."""
    rng = np.random.default_rng(seed)
    pixels = rng.uniform([140, 100], [1140, 860], (600, 2))
    rays = np.column_stack([CAMERA.unproject(pixels), np.ones(len(pixels))])
    depth = 2000 / (rays @ np.array([0.15, -0.1, 1.0]))
    box = (np.abs(pixels - [500, 450]) < 120).all(axis=1)
    depth[box] *= 0.85
    seen = PROJECTOR.project(TRUE.apply(rays * depth[:, None]))
    noise = rng.normal(scale=noise_px, size=(2, len(pixels), 2))
    colors = rng.integers(0, 256, (len(pixels), 3)).astype(np.uint8)
    return Correspondences(pixels + noise[0], seen + noise[1], colors=colors)


@dataclass(frozen=True)
class Files:
    """Paths of a folder that holds the rig as it is, as it was, and a capture."""

    folder: Path
    rig: Path
    before: Path
    points: Path


@pytest.fixture
def files(tmp_path: Path) -> Files:
    """A rig turned by 5 degrees since `before`, and what it sees."""
    turn = RigidTransform.from_rotation_vector(np.radians([3.0, 4.0, 0.0]), np.zeros(3))
    paths = Files(tmp_path, tmp_path / "rig.json", tmp_path / "before.json", tmp_path / "points.csv")
    write_rig(paths.rig, Rig(CAMERA, PROJECTOR, TRUE, unit="mm"))
    write_rig(paths.before, Rig(CAMERA, PROJECTOR, turn @ TRUE, unit="mm"))
    write_points(paths.points, wall_and_box())
    return paths


def names(folder: Path) -> list[str]:
    """What lies in a folder, half-written files included."""
    return sorted(entry.name for entry in folder.iterdir())
