"""Every command through its front door, on files that are as they should be."""

import json
import re
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest

from retrue import Correspondences, read_pattern, read_points, read_rig, write_points
from retrue.cli.commands import EXAMPLES
from retrue.files.ply import read_ply
from retrue.geometry.transform import direction_angle, rotation_angle

from .conftest import TRUE, names, wall_and_box

COMMANDS = ["demo", "pattern", "decode", "recalibrate", "verify", "reconstruct", "watch", "history", "rollback", "diff"]
DEMO = Path(__file__).parents[2] / "src" / "retrue" / "demo_data"


def degrees_from_truth(pose):
    return np.degrees([rotation_angle(pose.R @ TRUE.R.T), direction_angle(pose.t, TRUE.t)])


@pytest.mark.parametrize("command", COMMANDS)
def test_help(retrue, command):
    run = retrue(command, "--help")
    assert run.status == 0
    assert f"usage: retrue {command}" in run.out
    assert "--json" in run.out


@pytest.mark.parametrize("command", EXAMPLES)
def test_help_says_what_each_option_is(retrue, command):
    lines = retrue(command, "--help").out.splitlines()
    for option, below in pairwise(lines):
        if named := re.match(r"│ --[\w-]+( \S+)? +(?=[│(])(.*)", option):
            said = below.strip("│ ") if named[2] == "│" else named[2]
            assert not said.startswith(("(default", "(required")), option


def test_help_names_every_command(retrue):
    run = retrue("--help")
    assert run.status == 0
    assert all(command in run.out for command in COMMANDS)


def test_version(retrue):
    assert retrue("--version").out.startswith("retrue 0.")


def test_the_installed_script_runs():
    script = Path(sys.executable).parent / "retrue"
    done = subprocess.run([script, "verify", "no.json", "no.csv"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("retrue: no.json: ")
    assert len(done.stderr.splitlines()) == 1


def test_recalibrate_finds_the_pose_and_writes_it(retrue, files):
    run = retrue("recalibrate", files.before, files.points, "--out", files.folder / "new.json", "--json")
    assert run.status == 0
    report = run.json
    assert report["verdict"] == "accepted"
    assert report["correspondences"] == 600
    assert report["seconds"] > 0
    assert report["rms_px"] < 0.1
    assert set(report["change"]) == {"rotation_deg", "translation_deg", "length", "displacement"}
    assert report["change"]["rotation_deg"] == pytest.approx(5, abs=0.1)
    statistical = report["details"]["sigma_statistical"]["rotation_deg"]
    assert 0 < statistical < 0.1
    assert statistical < report["sigma"]["rotation_deg"] < 0.5  # with uncertain intrinsics and bowed planes
    assert sum(candidate["chosen"] for candidate in report["candidates"]) == 1
    for candidate in report["candidates"]:
        assert {"R", "t", "rms_px", "off_plane_rms_px", "chosen"} <= set(candidate)
    written = read_rig(files.folder / "new.json").projector_from_camera
    assert np.array_equal(written.R, report["projector_from_camera"]["R"])
    assert np.array_equal(written.t, report["projector_from_camera"]["t"])
    assert (degrees_from_truth(written) < [0.1, 0.2]).all()
    assert np.linalg.norm(written.t) == pytest.approx(np.linalg.norm(TRUE.t))


def test_recalibrate_takes_a_known_distance(retrue, files):
    cloud = files.folder / "cloud.ply"
    assert retrue("reconstruct", files.rig, files.points, "--out", cloud).status == 0
    points = read_points(files.points)
    on_the_wall = np.array([[300, 700], [900, 300]])  # with points all around
    first, second = (int(np.argmin(np.linalg.norm(points.camera_px - pixel, axis=1))) for pixel in on_the_wall)
    X = read_ply(cloud)[0]
    length = 2 * float(np.linalg.norm(X[first] - X[second]))  # so that the rig comes out twice as large
    pixels = [",".join(map(str, points.camera_px[row])) for row in (first, second)]
    out = files.folder / "new.json"
    run = retrue("recalibrate", files.before, files.points, "--out", out, "--known-distance", *pixels, length)
    assert run.status == 0
    assert np.linalg.norm(read_rig(out).projector_from_camera.t) == pytest.approx(2 * np.linalg.norm(TRUE.t), rel=0.01)


def test_recalibrate_may_replace_its_own_rig(retrue, files):
    assert retrue("recalibrate", files.before, files.points, "--out", files.before).status == 0
    assert degrees_from_truth(read_rig(files.before).projector_from_camera)[0] < 0.1


def test_a_refusal_writes_nothing(retrue, files):
    before = files.before.read_bytes()
    lines = files.points.read_text().splitlines(keepends=True)
    rng = np.random.default_rng(1)
    noise = "".join(",".join(f"{x:.3f}" for x in rng.uniform(0, 700, 4)) + "\n" for _ in range(200))
    files.points.write_text("camera_x,camera_y,projector_x,projector_y\n" + noise)
    assert len(lines) > 200
    run = retrue("recalibrate", files.before, files.points, "--out", files.before, "--json")
    assert run.status == 1
    assert run.json["verdict"] == "refused"
    assert run.json["projector_from_camera"] is None
    assert run.json["reason"]
    assert files.before.read_bytes() == before
    assert names(files.folder) == ["before.json", "points.csv", "rig.json"]


@pytest.mark.parametrize(("which", "verdict", "status"), [("rig", "good", 0), ("before", "drifted", 1)])
def test_verify(retrue, files, which, verdict, status):
    run = retrue("verify", getattr(files, which), files.points, "--json")
    assert run.status == status
    assert run.json["verdict"] == verdict
    assert {"epipolar_rms_px", "reason", "correspondences", "seconds"} <= set(run.json)
    assert names(files.folder) == ["before.json", "points.csv", "rig.json"]


def test_reconstruct_writes_a_cloud_and_a_mesh(retrue, files):
    cloud, mesh = files.folder / "cloud.ply", files.folder / "mesh.ply"
    run = retrue("reconstruct", files.rig, files.points, "--out", cloud, "--mesh", mesh, "--json")
    assert run.status == 0
    X, colors, faces = read_ply(cloud)
    assert (len(X), len(faces)) == (run.json["points"], 0)
    assert colors.std() > 50
    wall = X @ np.array([0.15, -0.1, 1.0])
    assert np.isin(np.round(wall / 100), [17, 20]).mean() > 0.99
    assert len(read_ply(mesh)[2]) == run.json["faces"] > 600


def test_decode_copies_a_csv(retrue, files):
    run = retrue("decode", files.points, "--out", files.folder / "copy.csv", "--json")
    assert run.status == 0
    assert run.json["correspondences"] == 600
    assert run.json["seconds"] > 0
    assert (files.folder / "copy.csv").read_bytes() == files.points.read_bytes()


@pytest.mark.parametrize(
    ("kind", "size", "pictures"),
    [("color-grid", (1024, 768), 1), ("line-grid", (800, 600), 1), ("gray-code", (256, 192), 34)],
)
def test_pattern_makes_what_decode_reads(retrue, tmp_path, kind, size, pictures):
    run = retrue("pattern", kind, "--projector-size", *size, "--out", tmp_path / "a" / "b", "--json")
    assert run.status == 0
    assert len(run.json["pictures"]) == pictures
    assert read_pattern(run.json["pattern"]).projector_size == size
    assert len(names(tmp_path / "a" / "b")) == pictures + 1
    shown = run.json["pictures"][0] if kind != "gray-code" else tmp_path / "a" / "b"
    decoded = retrue("decode", shown, "--pattern", run.json["pattern"], "--out", tmp_path / "points.csv", "--json")
    assert decoded.status == 0
    points = read_points(tmp_path / "points.csv")
    assert len(points) == decoded.json["correspondences"] > 500
    assert np.abs(points.camera_px - points.projector_px).max() < 0.6


def test_decode_the_picture_that_ships(retrue, tmp_path):
    out = tmp_path / "points.csv"
    run = retrue("decode", DEMO / "scene.jpg", "--pattern", DEMO / "pattern.json", "--out", out, "--json")
    assert run.status == 0
    assert run.json["correspondences"] > 1500


def test_demo(retrue, tmp_path):
    run = retrue("demo", "--out", tmp_path / "out", "--json")
    assert run.status == 0
    assert names(tmp_path / "out") == ["cloud.ply", "cloud.png", "mesh.ply", "report.html", "residuals.png", "rig.json"]
    assert run.json["error_before"]["rotation_deg"] == pytest.approx(5, abs=1e-3)
    assert run.json["error_after"]["rotation_deg"] < 0.05
    assert run.json["error_after"]["translation_deg"] < 0.1


def test_demo_speaks_plainly(retrue, tmp_path):
    run = retrue("demo", "--out", tmp_path / "out")
    assert run.status == 0
    assert "Distance from the true pose" in run.out
    assert "{" not in run.out


@pytest.fixture
def no_matplotlib(monkeypatch):
    """As after `pip install retrue`, without the extra."""
    for name in [name for name in sys.modules if name.partition(".")[0] == "matplotlib"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)


def test_without_matplotlib_the_demo_leaves_its_page_and_says_what_draws_pictures(retrue, tmp_path, no_matplotlib):
    run = retrue("demo", "--out", tmp_path / "out")
    assert run.status == 0
    assert names(tmp_path / "out") == ["cloud.ply", "mesh.ply", "report.html", "rig.json"]
    assert "pip install '.[plot]'" in run.out
    assert "and pictures" not in run.out


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (("decode", DEMO / "scene.jpg", "--pattern", DEMO / "pattern.json", "--debug", "seen", "--out"), "--debug"),
        (("history", DEMO / "rig_true.json", "--plot"), "--plot"),
        (("experiment", "noise", "--out"), "experiment"),
    ],
)
def test_what_draws_names_the_extra_before_any_work(retrue, tmp_path, no_matplotlib, arguments, what):
    run = retrue(*arguments, tmp_path / "out")
    run.require_complaint(f"{what}: ", "pip install '.[plot]'")
    assert not (tmp_path / "out").exists()


def test_options_reach_the_job(retrue, files):
    out = files.folder / "new.json"
    run = retrue("recalibrate", files.before, files.points, "--out", out, "--max-points", 100, "--json")
    assert run.json["correspondences"] == 600
    assert run.json["details"]["points_used"] == 100


def test_json_has_no_nan(retrue, files):
    run = retrue("verify", files.rig, files.points, "--json")
    json.loads(run.out, parse_constant=lambda constant: pytest.fail(f"{constant} in JSON"))


@pytest.mark.parametrize("command", ["recalibrate", "verify"])
def test_a_word_on_the_lenses(retrue, files, command):
    out = ["--out", files.folder / "new.json"] if command == "recalibrate" else []
    run = retrue(command, files.before, files.points, *out, "--lens", "fixed")
    assert run.out.startswith(
        "accepted, on your word that nobody touched the lenses: "
        if out
        else "recalibrate: the capture supports another"
    )
    retrue(command, files.before, files.points, *out, "--lens", "mended").require_complaint("--lens", "mended")


def test_json_tells_of_lenses_and_rivals(retrue, files):
    report = retrue("recalibrate", files.before, files.points, "--out", files.folder / "new.json", "--json").json
    assert report["lens"] == report["lenses"]["verdict"] == "unchecked"
    assert [len(report["lenses"][key]) for key in ("focal_change", "focal_sigma")] == [2, 2]
    assert len(report["rivals"]) == len(report["candidates"]) - 1 > 0
    for rival in report["rivals"]:
        assert rival["margin"] == pytest.approx(rival["points"] + rival["light"] + rival["move"])


def test_a_mirrored_capture_is_named_by_every_command_and_writes_nothing(retrue, files):
    seen = wall_and_box()
    write_points(files.points, Correspondences(seen.camera_px, [1023, 0] + seen.projector_px * [-1, 1]))
    out = files.folder / "out.ply"
    for command, to in {"recalibrate": ("--out", out), "verify": (), "reconstruct": ("--out", out)}.items():
        run = retrue(command, files.rig, files.points, *to, "--json")
        assert (run.status, run.json["cause"]) == (1, "PictureMirrored"), run
        assert "mirrored" in run.json["reason"]
    assert not out.exists()


def test_rays_that_miss_each_other_write_no_cloud(retrue, files):
    rng = np.random.default_rng(0)
    write_points(files.points, Correspondences(rng.uniform(100, 900, (9, 2)), rng.uniform(100, 700, (9, 2))))
    cloud = files.folder / "cloud.ply"
    run = retrue("reconstruct", files.rig, files.points, "--out", cloud, "--json")
    assert (run.status, run.json["verdict"], run.json["cause"]) == (1, "drifted", "RaysMiss")
    assert not cloud.exists()
    assert retrue("reconstruct", files.rig, files.points, "--out", cloud, "--anyway").status == 0


def test_what_the_decoder_sees_reaches_every_command(retrue, tmp_path):
    grey = tmp_path / "grey.png"
    picture = cv2.imread(str(DEMO / "scene.jpg"), cv2.IMREAD_GRAYSCALE)
    cv2.imwrite(str(grey), np.repeat(picture[..., None], 3, axis=2))
    pattern, out = ("--pattern", DEMO / "pattern.json"), tmp_path / "out.ply"
    for command, to in {"recalibrate": ("--out", out), "verify": (), "reconstruct": ("--out", out)}.items():
        run = retrue(command, DEMO / "rig_true.json", grey, *pattern, *to, "--json")
        assert (run.status, run.json["cause"]) == (1, "TooFewPoints"), run
        assert run.json["reason"].endswith("not a colour picture")
        assert run.json["advice"] == ["grey.png: not a colour picture"]
    assert not out.exists()


def test_reconstruct_refuses_a_capture_that_contradicts_the_rig(retrue, files):
    cloud = files.folder / "cloud.ply"
    run = retrue("reconstruct", files.before, files.points, "--out", cloud, "--json")
    assert (run.status, run.json["verdict"], run.json["out"]) == (1, "drifted", None)
    assert not cloud.exists()
    assert "--anyway" in retrue("reconstruct", files.before, files.points, "--out", cloud).out
    assert retrue("reconstruct", files.before, files.points, "--out", cloud, "--anyway").status == 0
    assert cloud.exists()
    assert retrue("reconstruct", files.rig, files.points, "--out", cloud, "--json").json["verdict"] == "good"


def test_the_package_runs_as_a_module():
    done = subprocess.run([sys.executable, "-m", "retrue", "--version"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.split()[0], done.stderr) == (0, "retrue", "")


@pytest.mark.parametrize("words", [["--version"], ["--help"], ["recalibrate", "--help"]])
def test_what_nobody_reads_to_its_end_is_no_fault(words):
    """As `| head` leaves it."""
    command = [sys.executable, "-m", "retrue", *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as run:
        run.stdout.close()
        assert run.stderr.read() == b""
    assert run.returncode == 0


def test_a_pattern_is_written_beside_no_other_pictures(retrue, tmp_path):
    """Whoever shows or reads the folder would have the pictures of an earlier, longer pattern too."""
    out = tmp_path / "pattern"
    sequence = ("pattern", "gray-code", "--projector-size", 64, 48, "--out", out)
    assert retrue(*sequence).status == 0
    assert retrue(*sequence).status == 0  # the same again
    before = {path: path.read_bytes() for path in out.iterdir()}
    for other in (("gray-code", "--step", 8), ("color-grid",)):
        run = retrue("pattern", *other, "--projector-size", 256, 192, "--out", out)
        run.require_complaint("pattern: holds pictures of something else, pattern_", "give another folder")
    assert {path: path.read_bytes() for path in out.iterdir()} == before
    (tmp_path / "photographs").mkdir()
    (tmp_path / "photographs" / "IMG_1.JPG").write_bytes(b"")
    run = retrue("pattern", "color-grid", "--projector-size", 256, 192, "--out", tmp_path / "photographs")
    run.require_complaint("photographs: holds pictures of something else, IMG_1.JPG: give")
    assert names(tmp_path / "photographs") == ["IMG_1.JPG"]
