"""A capture is simulated, decoded, and gives the rig back that made it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from retrue import Camera, Rig, RigidTransform, read_points, read_rig, write_rig
from retrue.files.patterns import write_pattern
from retrue.geometry.transform import direction_angle, rotation_angle
from retrue.patterns.color_grid import make_color_grid

from .conftest import Retrue, names

CAMERA = Camera((480, 360), [[600, 0, 250], [0, 605, 160], [0, 0, 1]], [-0.15, 0.05, 0.001, -0.001, 0])
PROJECTOR = Camera((320, 240), [[440, 0, 160], [0, 440, 235], [0, 0, 1]], [-0.05, 0.02, 0, 0.001, 0])
TRUE = RigidTransform.from_rotation_vector([0.12, 0.22, 0.03], [-300.0, -60.0, 40.0])


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    write_rig(tmp_path / "rig.json", Rig(CAMERA, PROJECTOR, TRUE, unit="mm"))
    return tmp_path / "rig.json"


def test_simulate_decode_recalibrate(tmp_path: Path, rig: Path, retrue: Retrue) -> None:
    pytest.importorskip("mitsuba", reason='the renderer is not installed: pip install ".[simulate]"')
    write_pattern(tmp_path / "pattern.json", make_color_grid((320, 240), rows=14, columns=18))
    out = tmp_path / "made"
    made = retrue(
        "simulate", "clutter", "--rig", rig, "--pattern", tmp_path / "pattern.json", "--out", out,
        "--samples", 4, "--bounces", 1, "--json",
    )  # fmt: skip
    assert made.status == 0, made.err
    assert max(made.json["dot_errors_px"].values()) < 0.05
    assert names(out) == [
        "black.png",
        "capture.png",
        "pattern.json",
        "points.csv",
        "rig.json",
        "truth.npz",
        "white.png",
    ]

    pattern = out / "pattern.json"
    assert retrue("decode", out / "capture.png", "--pattern", pattern, "--out", tmp_path / "points.csv").status == 0
    found, true = read_points(tmp_path / "points.csv"), read_points(out / "points.csv")
    away = np.linalg.norm(found.projector_px[:, None] - true.projector_px, axis=2)
    same = away.min(axis=1) < 1e-6
    assert same.sum() > 100
    error = np.linalg.norm(found.camera_px - true.camera_px[away.argmin(axis=1)], axis=1)[same]
    assert np.median(error) < 0.1

    turn = RigidTransform.from_rotation_vector(np.radians([2.0, -3.0, 1.0]), np.zeros(3))
    write_rig(tmp_path / "before.json", Rig(CAMERA, PROJECTOR, turn @ TRUE, unit="mm"))
    new = tmp_path / "new.json"
    run = retrue("recalibrate", tmp_path / "before.json", out / "capture.png", "--pattern", pattern, "--out", new)
    assert run.status == 0, run.out
    pose = read_rig(new).projector_from_camera
    assert np.degrees(rotation_angle(pose.R @ TRUE.R.T)) < 0.1
    assert np.degrees(direction_angle(pose.t, TRUE.t)) < 0.3


def test_without_the_renderer_the_extra_is_named(
    tmp_path: Path, rig: Path, retrue: Retrue, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("retrue.simulation.mitsuba_scene.find_spec", lambda _: None)
    run = retrue("simulate", "wall", "--rig", rig, "--pattern", rig, "--out", tmp_path / "made")
    run.require_complaint(".[simulate]")
    assert not (tmp_path / "made").exists()
