"""`--stereo`: pairs of photographs through the front door."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from retrue import Camera, Rig, RigidTransform, read_history, read_rig, write_png, write_rig
from retrue.geometry.transform import rotation_angle
from retrue.simulation.photographs import photograph, textured_scene

from .conftest import DATA, Retrue

LEFT = Camera((320, 240), [[300, 0, 159.5], [0, 300, 119.5], [0, 0, 1]], [-0.1, 0.02, 0, 0, 0])
RIGHT = Camera((300, 260), [[330, 0, 150], [0, 330, 131], [0, 0, 1]], [-0.08, 0.02, 0, 0, 0])
RIG = Rig(LEFT, RIGHT, RigidTransform.from_rotation_vector([0.02, -0.06, 0.03], [-150.0, 4, 6]), unit="mm")


@pytest.fixture(scope="module")
def pairs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with rig.json, before.json, and two pairs in photographs/."""
    folder = tmp_path_factory.mktemp("stereo")
    (folder / "photographs").mkdir()
    for number in (1, 2):
        pair = photograph(RIG, textured_scene(RIG, 1200.0, seed=10 + number), supersample=1, seed=number)
        write_png(folder / "photographs" / f"left{number:02d}.png", pair.left)
        write_png(folder / "photographs" / f"right{number:02d}.png", pair.right)
    write_rig(folder / "rig.json", RIG)
    turned = RigidTransform.from_rotation_vector(np.radians([2.0, 1, -1]), np.zeros(3)) @ RIG.projector_from_camera
    write_rig(folder / "before.json", replace(RIG, projector_from_camera=turned))
    return folder


def test_recalibrate_takes_a_folder_of_pairs_and_tells_each_axis(retrue: Retrue, pairs: Path, tmp_path: Path) -> None:
    new = tmp_path / "new.json"
    run = retrue("recalibrate", pairs / "before.json", pairs / "photographs", "--stereo", "--out", new, "--json")
    assert run.status == 0, run
    report = run.json
    assert report["verdict"] == "accepted"
    assert len(report["axes"]) == 5
    assert all(axis["sigma_deg"] > 0 for axis in report["axes"])
    assert report["axes"][0]["name"] == "rotation about the baseline"
    found = read_rig(new).projector_from_camera
    assert np.degrees(rotation_angle(found.R @ RIG.projector_from_camera.R.T)) < 0.1
    assert "left01.png, right01.png: " in run.err


def test_a_pair_that_is_handed_in_twice_is_named(retrue: Retrue, pairs: Path, tmp_path: Path) -> None:
    for side in ("left", "right"):
        for number in (1, 3):
            (tmp_path / f"{side}0{number}.png").write_bytes((pairs / "photographs" / f"{side}01.png").read_bytes())
    run = retrue("verify", pairs / "rig.json", tmp_path, "--stereo")
    run.require_complaint("left03.png, right03.png: holds the same points as left01.png, right01.png")


def test_the_answer_speaks_of_two_cameras(retrue: Retrue, pairs: Path, tmp_path: Path) -> None:
    photographs = [pairs / "photographs" / name for name in ("left01.png", "right01.png")]
    run = retrue("recalibrate", pairs / "before.json", *photographs, "--stereo", "--out", tmp_path / "new.json")
    assert run.status == 0
    assert "projector" not in run.out
    assert "first camera" in run.out
    assert "direction of t towards the scene: " in run.out


def test_verify_tells_a_rig_that_holds_from_one_that_moved(retrue: Retrue, pairs: Path) -> None:
    assert retrue("verify", pairs / "rig.json", pairs / "photographs", "--stereo").status == 0
    moved = retrue("verify", pairs / "before.json", pairs / "photographs", "--stereo", "--json")
    assert moved.status == 1
    assert moved.json["verdict"] == "drifted"


def test_the_history_names_each_photograph(retrue: Retrue, pairs: Path, tmp_path: Path) -> None:
    rig = tmp_path / "rig.json"
    rig.write_bytes((pairs / "before.json").read_bytes())
    words = ("recalibrate", rig, pairs / "photographs", "--stereo", "--in-place", "--lens", "fixed")
    assert retrue(*words).status == 0
    captures = [capture["name"] for capture in read_history(rig).entries[-1].captures]
    assert captures == ["left01.png", "right01.png", "left02.png", "right02.png"]


def test_reconstruct_sees_every_pixel(retrue: Retrue, pairs: Path, tmp_path: Path) -> None:
    photographs = [pairs / "photographs" / name for name in ("left01.png", "right01.png")]
    cloud, mesh = tmp_path / "cloud.ply", tmp_path / "mesh.ply"
    run = retrue("reconstruct", pairs / "rig.json", *photographs, "--stereo", "--out", cloud, "--mesh", mesh, "--json")
    assert run.status == 0, run
    assert run.json["points"] > 30_000
    assert run.json["faces"] > run.json["points"]
    moved = retrue("reconstruct", pairs / "before.json", *photographs, "--stereo", "--out", tmp_path / "no.ply")
    assert moved.status == 1
    assert not (tmp_path / "no.ply").exists()


def test_the_demo_finds_the_pose_and_sees_the_scene(retrue: Retrue, tmp_path: Path) -> None:
    run = retrue("demo", "--stereo", "--out", tmp_path / "out", "--json")
    assert run.status == 0, run
    report = run.json
    assert report["error_before"]["rotation_deg"] > 1.5
    assert report["error_after"]["rotation_deg"] < 0.1
    assert report["depth_error"] < 0.01
    assert all(Path(path).exists() for path in report["files"])


def test_mistakes_are_named(retrue: Retrue, pairs: Path, tmp_path: Path) -> None:
    left, right = (pairs / "photographs" / name for name in ("left01.png", "right01.png"))
    rig = pairs / "rig.json"
    retrue("verify", rig, left, "--stereo").require_complaint("captures of two cameras", "found 1")
    retrue("verify", rig, right, left, "--stereo").require_complaint("right01.png", "left and right are exchanged")
    retrue("verify", rig, left, tmp_path / "no.png", "--stereo").require_complaint("no.png", "no such file")
    retrue("verify", rig, left, right, "--stereo", "--pattern", "p.json").require_complaint("show no pattern")
    retrue("reconstruct", rig, pairs / "photographs", "--stereo", "--out", tmp_path / "c.ply").require_complaint(
        "expected one pair of photographs", "found 2"
    )
    retrue("reconstruct", rig, left, right, "--out", tmp_path / "c.ply").require_complaint("expected one CAPTURE")
    broken = tmp_path / "left09.png"
    broken.write_bytes(left.read_bytes()[:4000])
    retrue("verify", rig, broken, right, "--stereo").require_complaint("left09.png", "damaged or cut short")


@pytest.mark.parametrize(("name", "pairs", "joint"), [("room", 5, (0.03, 0.08)), ("hall", 10, (0.075, 1.3))])
def test_real_pairs_agree_with_their_calibration(name: str, pairs: int, joint: tuple[float, float]) -> None:
    folder = DATA / "stereo-photographs" / name
    if not folder.is_dir():
        pytest.skip(f"no photographs: {folder} is not there")
    from retrue import recalibrate
    from retrue.files.photographs import read_photographs
    from retrue.geometry.transform import direction_angle

    rig = read_rig(folder / "rig.json")
    captures = [pair.capture.points for pair in islice(read_photographs([folder], rig), pairs)]
    pose, true = recalibrate(rig, captures).evidence.pose, rig.projector_from_camera
    assert pose is not None
    assert np.degrees(rotation_angle(pose.R @ true.R.T)) < joint[0]
    assert np.degrees(direction_angle(pose.t, true.t)) < joint[1]


def test_a_watch_pairs_two_folders_and_puts_the_rig_right(retrue: Retrue, pairs: Path, tmp_path: Path) -> None:
    for number in range(4):
        for side in ("left", "right"):
            (tmp_path / "in" / side).mkdir(parents=True, exist_ok=True)
            picture = (pairs / "photographs" / f"{side}0{1 + number % 2}.png").read_bytes()
            (tmp_path / "in" / side / f"{100 * number}.png").write_bytes(picture)
        (tmp_path / "in" / "left" / f"{100 * number}.json").write_text(f'{{"temperature": {20 + number}}}')
    (tmp_path / "in" / "left" / "400.png").write_bytes(picture)
    rig = tmp_path / "rig.json"
    rig.write_bytes((pairs / "before.json").read_bytes())
    quick = (
        "--poll-seconds",
        "0.01",
        "--settle-seconds",
        "0.02",
        "--patience-seconds",
        "0.05",
        "--idle-seconds",
        "0.3",
    )
    run = retrue(
        "watch", rig, tmp_path / "in", "--stereo", "--out", tmp_path / "out", "--lens", "fixed", "--json", *quick
    )
    assert run.status == 0, run
    told = [json.loads(line) for line in run.out.splitlines()]
    frames = [event for event in told if event["event"] == "frame"]
    assert [event["temperature"] for event in frames] == [20, 21, 22, 23]
    assert [event["verdict"] for event in frames] == ["drifted", "drifted", "drifted", "good"]
    assert [event["name"] for event in told if event["event"] == "bad frame"] == ["400.png"]
    found = read_rig(rig).projector_from_camera
    assert np.degrees(rotation_angle(found.R @ RIG.projector_from_camera.R.T)) < 0.1
    plot = tmp_path / "track.png"
    run = retrue("history", rig, "--watched", tmp_path / "out", "--plot", plot, "--json")
    assert run.status == 0, run
    watched = run.json["watched"]
    assert [frame["temperature"] for frame in watched["frames"]] == [20, 21, 22, 23]
    assert all(max(map(abs, frame["moved_deg"])) > 1 for frame in watched["frames"])  # from the rig before the bump
    assert watched["changes"][0]["kind"] == "bump"
    assert plot.read_bytes().startswith(b"\x89PNG")
    retrue("history", rig, "--watched", tmp_path).require_complaint("expected the record of a watch")
    refused = retrue("watch", rig, tmp_path / "in" / "left", "--stereo", "--out", tmp_path / "out", *quick)
    refused.require_complaint("expected two sources, or a folder that holds a folder of each camera")
