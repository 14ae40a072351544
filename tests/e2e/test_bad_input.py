"""Bad input: one line that names the file, exit status 2, no traceback, nothing half-written."""

import json
import shutil

import numpy as np
import pytest

from retrue import Correspondences, write_points

from .conftest import CAMERA, PROJECTOR, TRUE, names

HEADER = "camera_x,camera_y,projector_x,projector_y\n"


def edited(path, edit):
    """The rig file with one thing changed."""
    document = json.loads(path.read_text())
    edit(document)
    path.write_text(json.dumps(document))


def command_on(files, command, rig=None, capture=None, pattern=None, out="out.json"):
    arguments = [command, rig or files.before, capture or files.points]
    arguments += [] if pattern is None else ["--pattern", pattern]
    return arguments + ([] if command == "verify" else ["--out", files.folder / out])


RIG_EDITS = {
    "no camera": lambda rig: rig.pop("camera"),
    "no K": lambda rig: rig["projector"].pop("K"),
    "no pose": lambda rig: rig.pop("projector_from_camera"),
    "2x2 K": lambda rig: rig["camera"].update(K=[[1500, 0], [0, 1500]]),
    "NaN in K": lambda rig: rig["camera"]["K"][0].__setitem__(0, float("nan")),
    "infinity in t": lambda rig: rig["projector_from_camera"].update(t=[float("inf"), 0, 0]),
    "singular K": lambda rig: rig["camera"].update(K=[[0, 0, 640], [0, 1500, 480], [0, 0, 1]]),
    "text for K": lambda rig: rig["camera"].update(K="no"),
    "no rotation": lambda rig: rig["projector_from_camera"].update(R=[[1, 0, 0], [0, 2, 0], [0, 0, 1]]),
    "mirror": lambda rig: rig["projector_from_camera"].update(R=[[-1, 0, 0], [0, 1, 0], [0, 0, 1]]),
    "zero rotation": lambda rig: rig["projector_from_camera"].update(R=[[0] * 3] * 3),
    "size of zero": lambda rig: rig["camera"].update(size=[0, 0]),
    "three coefficients": lambda rig: rig["camera"].update(distortion=[0, 0, 0]),
    "other version": lambda rig: rig.update(version=99),
}


@pytest.mark.parametrize("command", ["recalibrate", "verify", "reconstruct"])
@pytest.mark.parametrize("edit", RIG_EDITS)
def test_a_bad_rig(retrue, files, command, edit):
    edited(files.before, RIG_EDITS[edit])
    retrue(*command_on(files, command)).require_complaint("before.json")
    assert names(files.folder) == ["before.json", "points.csv", "rig.json"]


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"null", b"\xff\xfe\x00", b"hello"])
def test_a_rig_that_is_none(retrue, files, content):
    files.before.write_bytes(content)
    retrue(*command_on(files, "recalibrate")).require_complaint("before.json")


@pytest.mark.parametrize("command", ["recalibrate", "verify", "reconstruct"])
def test_files_that_are_not_there(retrue, files, command):
    retrue(*command_on(files, command, rig=files.folder / "no.json")).require_complaint("no.json")
    retrue(*command_on(files, command, capture=files.folder / "no")).require_complaint("no")
    retrue(*command_on(files, command, capture=files.folder / "no.csv")).require_complaint("no.csv")


def test_a_folder_where_a_file_belongs(retrue, files):
    retrue(*command_on(files, "recalibrate", rig=files.folder)).require_complaint(files.folder.name)


@pytest.fixture
def pattern(retrue, files):
    """A small Gray code, its pictures beside it."""
    assert retrue("pattern", "gray-code", "--projector-size", 64, 48, "--out", files.folder / "gray").status == 0
    return (files.folder / "gray" / "pattern.json").rename(files.folder / "pattern.json")


def test_captures_that_are_none(retrue, files, pattern):
    empty = files.folder / "empty"
    empty.mkdir()
    retrue(*command_on(files, "recalibrate", capture=empty, pattern=pattern)).require_complaint("empty")
    text = files.folder / "text.png"
    text.write_text("no picture")
    retrue(*command_on(files, "recalibrate", capture=text, pattern=pattern)).require_complaint("text.png")
    assert "out.json" not in names(files.folder)


def test_a_capture_needs_its_pattern(retrue, files, pattern):
    gray = files.folder / "gray"
    retrue(*command_on(files, "recalibrate", capture=gray)).require_complaint("gray", "--pattern")
    retrue("decode", gray, "--out", files.folder / "out.csv").require_complaint("gray", "--pattern")


def test_a_picture_missing(retrue, files, pattern):
    gray = files.folder / "gray"
    sorted(gray.iterdir())[5].unlink()
    retrue("decode", gray, "--pattern", pattern, "--out", files.folder / "out.csv").require_complaint("gray")
    assert "out.csv" not in names(files.folder)


def test_a_picture_that_is_none_among_others(retrue, files, pattern):
    gray = files.folder / "gray"
    broken = sorted(gray.iterdir())[5]
    broken.write_bytes(broken.read_bytes()[:60])
    retrue("decode", gray, "--pattern", pattern, "--out", files.folder / "out.csv").require_complaint(broken.name)


def test_black_frames(retrue, files, pattern):
    gray = files.folder / "gray"
    pictures = sorted(gray.iterdir())
    for picture in pictures[:-1]:
        shutil.copyfile(pictures[-1], picture)
    retrue("decode", gray, "--pattern", pattern, "--out", files.folder / "out.csv").require_complaint("gray")


@pytest.mark.parametrize(
    "edit",
    [
        {"kind": "stripes"},
        {"projector_size": [0, 48]},
        {"projector_size": "large"},
        {"order": "any"},
        {"version": 99},
    ],
)
def test_a_bad_pattern(retrue, files, pattern, edit):
    edited(pattern, lambda document: document.update(edit))
    run = retrue("decode", files.folder / "gray", "--pattern", pattern, "--out", files.folder / "out.csv")
    run.require_complaint("pattern.json")


def test_a_projector_that_the_codes_exceed(retrue, files, board):
    small = files.folder / "small.json"
    small.write_text((board / "pattern.json").read_text())
    edited(small, lambda document: document.update(projector_size=[800, 768]))
    out = files.folder / "out.csv"
    retrue("decode", board / "capture_0", "--pattern", small, "--out", out).require_complaint("capture_0")


@pytest.mark.parametrize(
    ("rows", "parts"),
    [
        ("1,2,3\n", ["points.csv", "line 2"]),
        ("1,2,3,4\n1,2,nan,4\n", ["points.csv", "line 3", "nan"]),
        ("1,2,3,x\n", ["points.csv", "line 2", "'x'"]),
    ],
)
@pytest.mark.parametrize("command", ["recalibrate", "verify", "reconstruct"])
def test_a_bad_csv(retrue, files, command, rows, parts):
    files.points.write_text(HEADER + rows)
    retrue(*command_on(files, command)).require_complaint(*parts)


def degenerate(kind):
    rng = np.random.default_rng(0)
    pixels = rng.uniform(100, 700, (200, 2))
    if kind == "no points":
        pixels = pixels[:0]
    if kind == "three points":
        pixels = pixels[:3]
    if kind == "collinear":
        pixels[:, 1] = 0.5 * pixels[:, 0] + 20
    if kind == "one place":
        pixels[:] = pixels[0]
    return Correspondences(pixels, 0.8 * pixels + 30)


@pytest.mark.parametrize("kind", ["no points", "three points", "collinear", "one place"])
@pytest.mark.parametrize("command", ["recalibrate", "verify"])
def test_points_that_determine_nothing(retrue, files, command, kind):
    """Either the input is bad (2) or the answer is refused (1): never accepted, never good, never a traceback."""
    write_points(files.points, degenerate(kind))
    run = retrue(*command_on(files, command), "--json")
    assert run.status in (1, 2)
    assert "Traceback" not in run.err
    if run.status == 1:
        assert run.json["verdict"] in ("refused", "unknown")
        assert len(run.json["reason"].splitlines()) == 1
    else:
        assert len([line for line in run.err.splitlines() if line.startswith("retrue: ")]) == 1
        assert run.json == {"error": run.err.splitlines()[-1].removeprefix("retrue: ")}
    assert names(files.folder) == ["before.json", "points.csv", "rig.json"]


def test_a_scene_without_a_plane_is_not_accepted_blindly(retrue, files):
    """Points of a cloud: there is no plane to start from; whatever the answer, a wrong pose is never accepted."""
    rng = np.random.default_rng(0)
    points = rng.uniform([-500, -400, 1500], [500, 400, 3500], (300, 3))
    write_points(files.points, Correspondences(CAMERA.project(points), PROJECTOR.project(TRUE.apply(points))))
    run = retrue(*command_on(files, "recalibrate"), "--json")
    assert run.status in (0, 1)
    if run.status == 0:
        assert np.abs(np.array(run.json["projector_from_camera"]["R"]) - TRUE.R).max() < 1e-3


@pytest.mark.parametrize("command", ["recalibrate", "reconstruct"])
def test_an_output_that_cannot_be_written(retrue, files, command):
    for out in ("points.csv/out.json", "no/such/folder/out.json", "."):
        retrue(*command_on(files, command, out=out)).require_complaint("out.json" if out != "." else files.folder.name)
    assert names(files.folder) == ["before.json", "points.csv", "rig.json"]


def test_a_mesh_that_cannot_be_written_leaves_no_cloud(retrue, files):
    run = retrue(*command_on(files, "reconstruct"), "--mesh", files.points / "mesh.ply")
    run.require_complaint("mesh.ply")
    assert names(files.folder) == ["before.json", "points.csv", "rig.json"]


@pytest.mark.parametrize("command", [["pattern", "gray-code", "--projector-size", "8", "8"], ["demo"]])
def test_a_folder_that_cannot_be_made(retrue, files, command):
    retrue(*command, "--out", files.points / "folder").require_complaint("points.csv")


@pytest.mark.parametrize("size", [["0", "768"], ["-5", "10"], ["1024", "99999999"]])
@pytest.mark.parametrize("kind", ["gray-code", "color-grid", "line-grid"])
def test_a_projector_size_that_is_none(retrue, tmp_path, kind, size):
    retrue("pattern", kind, "--projector-size", *size, "--out", tmp_path / "out").require_complaint()


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["frobnicate"],
        ["recalibrate"],
        ["recalibrate", "rig.json", "--out", "new.json"],
        ["recalibrate", "rig.json", "points.csv"],
        ["recalibrate", "rig.json", "points.csv", "--out", "new.json", "--known-distance", "1,2", "3", "4"],
        ["recalibrate", "rig.json", "points.csv", "--out", "new.json", "--known-distance", "1,2", "3,4"],
        ["recalibrate", "rig.json", "points.csv", "--out", "new.json", "--max-points", "many"],
        ["verify", "rig.json", "points.csv", "--frob"],
        ["pattern", "stripes", "--projector-size", "1024", "768", "--out", "out"],
        ["pattern", "gray-code", "--projector-size", "1024", "--out", "out"],
    ],
    ids=" ".join,
)
def test_bad_usage(retrue, tmp_path, monkeypatch, arguments):
    monkeypatch.chdir(tmp_path)
    retrue(*arguments).require_complaint()
    assert names(tmp_path) == []


@pytest.mark.parametrize(
    "words",
    [
        "decode points.csv --out points.csv",
        "recalibrate before.json points.csv --out points.csv",
        "recalibrate before.json points.csv --out new.json --report ../{0}/new.json",
        "reconstruct rig.json points.csv --out a.ply --mesh a.ply",
        "verify rig.json points.csv --report rig.json",
        "scale rig.json points.csv --known points:40mm --click 500 400 800 420 --out points.csv",
        "merge rig.json points.csv --out points.csv",
    ],
)
def test_no_answer_replaces_what_it_is_made_of_or_another(retrue, files, words, monkeypatch):
    monkeypatch.chdir(files.folder)
    kept = {path.name: path.read_bytes() for path in files.folder.iterdir()}
    retrue(*words.format(files.folder.name).split()).require_complaint("expected a file of its own to write")
    assert {path.name: path.read_bytes() for path in files.folder.iterdir()} == kept


@pytest.mark.parametrize("job", ["recalibrate", "verify"])
def test_a_capture_that_is_handed_in_twice_is_named(files, retrue, job):
    copy = files.folder / "copy.csv"
    copy.write_bytes(files.points.read_bytes())
    out = ["--out", files.folder / "new.json"] if job == "recalibrate" else []
    run = retrue(job, files.before, files.points, copy, *out)
    run.require_complaint("copy.csv: holds the same points as ", "points.csv", "hand in each capture once")
    retrue(job, files.before, files.points, files.points, *out).require_complaint("holds the same points as")
    assert not (files.folder / "new.json").exists()
