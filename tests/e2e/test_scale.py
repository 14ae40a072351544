"""`retrue scale`: a rig whose t has the wrong length, and something in view whose size is known."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from retrue import read_rig, reconstruct, write_cloud, write_points, write_rig
from tests.acceptance.simulated import RIG, ball, noisy, seen

from .conftest import Retrue

FAR, DIAMETER = 600.0, 60.0
CENTRES = np.array([[-60.0, 0, FAR], [70.0, 10, FAR + 20]])


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A rig that takes everything for 0.8 times as large, two balls as it sees them, and its cloud."""
    folder = tmp_path_factory.mktemp("scale")
    points, _ = seen([ball(*centre, DIAMETER) for centre in CENTRES], 2)
    points = noisy(points, np.random.default_rng(0), 0.05)
    pose = RIG.projector_from_camera
    rig = replace(RIG, projector_from_camera=replace(pose, t=0.8 * pose.t))
    write_rig(folder / "rig.json", rig)
    write_points(folder / "balls.csv", points)
    write_cloud(folder / "cloud.ply", reconstruct(rig, points))
    return folder


def clicked(number: int) -> list[str]:
    """In the camera's picture, on the front of a ball."""
    front = CENTRES[number] * (1 - DIAMETER / 2 / np.linalg.norm(CENTRES[number]))
    return [f"{value:.2f}" for value in RIG.camera.project(front[None])[0]]


@pytest.mark.parametrize(
    ("known", "balls"),
    [
        (f"sphere:{DIAMETER}mm+-0.02mm", (0,)),
        (f"spheres:{DIAMETER}mm:{np.linalg.norm(CENTRES[1] - CENTRES[0]):.4f}mm", (0, 1)),
    ],
)
def test_balls_give_the_scale_and_its_sigma(retrue: Retrue, files: Path, tmp_path: Path, known, balls) -> None:
    clicks = [word for number in balls for word in clicked(number)]
    words = [files / "rig.json", files / "balls.csv", "--known", known, "--click", *clicks]
    run = retrue("scale", *words, "--out", tmp_path / "new.json", "--json")
    assert run.status == 0, run.err
    assert 0 < run.json["sigma"] < 0.003
    assert abs(run.json["factor"] * 0.8 - 1) < 4 * run.json["sigma"]
    rig = read_rig(tmp_path / "new.json")
    assert np.linalg.norm(rig.projector_from_camera.t) == pytest.approx(
        np.linalg.norm(RIG.projector_from_camera.t), rel=4 * run.json["sigma"]
    )
    assert rig.evidence["scale_sigma"] == run.json["sigma"]


def test_two_places_of_the_viewer_in_a_cloud(retrue: Retrue, files: Path, tmp_path: Path) -> None:
    ends = CENTRES * (1 - DIAMETER / 2 / np.linalg.norm(CENTRES, axis=1, keepdims=True))
    length = float(np.linalg.norm(ends[1] - ends[0]))
    at = [f"{value:.3f}" for value in (0.8 * ends).ravel()]
    words = [files / "rig.json", files / "cloud.ply", "--known", f"points:{length:.3f}mm", "--at", *at]
    run = retrue("scale", *words, "--out", tmp_path / "new.json")
    assert run.status == 0, run.err
    factor = float(run.out.split("lengths x ")[1].split(",")[0])
    assert factor == pytest.approx(1.25, rel=0.01)


def test_mistakes_are_named(retrue: Retrue, files: Path, tmp_path: Path) -> None:
    words = [files / "rig.json", files / "balls.csv", "--out", tmp_path / "new.json", "--known"]
    retrue("scale", *words, "plane", "--click", 1, 2).require_complaint("--known", "plane has no length")
    retrue("scale", *words, "nonsense", "--click", 1, 2).require_complaint(
        "--known", "points:LENGTH", "found 'nonsense'"
    )
    retrue("scale", *words, "sphere:60mm").require_complaint("expected --click or --at")
    retrue("scale", *words, "sphere:60mm", "--click", 1, 2, 3).require_complaint("--click", "2 numbers", "found 3")
    retrue("scale", *words, "points:6mm", "--at", 1, 2, 3, 1, 2, -3).require_complaint("--at", "Z above 0")
    retrue("scale", *words, "points:6", "--click", 1, 2, 3, 4).require_complaint("--known", "found 'points:6'")
    assert not (tmp_path / "new.json").exists()
