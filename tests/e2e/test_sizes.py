"""Pictures, patterns and points of another size: one line, exit status 2, nothing written."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from retrue import Rig, make_color_grid, write_pattern, write_points, write_rig

from .conftest import CAMERA, DATA, PROJECTOR, TRUE, names, wall_and_box

JOBS = ("recalibrate", "verify", "reconstruct")
TOLD = {"camera_size": (1280, 960), "projector_size": (1024, 768)}


def command_on(files, job, *arguments):
    return [job, files.before, *arguments, *([] if job == "verify" else ["--out", files.folder / "out.ply"])]


def refused(retrue, files, job, *arguments):
    """What the command was handed, and what it said; it wrote nothing."""
    before = names(files.folder)
    run = retrue(*command_on(files, job, *arguments))
    assert names(files.folder) == before
    return run


@pytest.fixture(scope="module")
def pattern(tmp_path_factory):
    path = tmp_path_factory.mktemp("grid") / "pattern.json"
    write_pattern(path, make_color_grid((1024, 768), 20, 26, seed=2))
    return path


@pytest.mark.parametrize("job", JOBS)
@pytest.mark.parametrize(
    ("size", "like"),
    [
        ((640, 480), "binned by 2"),
        ((960, 1280), "turned by a quarter"),
        ((1280, 720), "cropped"),
        ((700, 2000), "of an"),
    ],
)
def test_a_picture_of_another_size(retrue, files, pattern, job, size, like):
    picture = files.folder / "wall.png"
    cv2.imwrite(str(picture), np.zeros((size[1], size[0], 3), np.uint8))
    run = refused(retrue, files, job, picture, "--pattern", pattern)
    run.require_complaint("wall.png: ", f"{size[0]} x {size[1]}", "1280 x 960", f": {like}")


@pytest.mark.parametrize("job", JOBS)
def test_a_folder_of_pictures_of_another_size(retrue, files, job):
    retrue("pattern", "gray-code", "--projector-size", "1024", "768", "--out", files.folder / "gray")
    (files.folder / "gray" / "pattern.json").rename(files.folder / "gray.json")
    run = refused(retrue, files, job, files.folder / "gray", "--pattern", files.folder / "gray.json")
    run.require_complaint("gray: ", "1024 x 768", "cropped, so that the principal point moved")


@pytest.mark.parametrize("job", JOBS)
def test_a_pattern_for_another_projector(retrue, files, pattern, job):
    write_rig(files.before, Rig(CAMERA, replace(PROJECTOR, size=(1280, 800)), TRUE))
    run = refused(retrue, files, job, files.points, "--pattern", pattern)
    run.require_complaint("pattern.json: the pattern is for a projector of 1024 x 768, the rig's is 1280 x 800")


@pytest.mark.parametrize("job", JOBS)
@pytest.mark.parametrize(
    ("name", "size", "said"),
    [
        ("camera_size", (2560, 1920), "no longer binned by 2"),
        ("projector_size", (1280, 800), "pattern for another projector"),
    ],
)
def test_points_that_tell_another_size(retrue, files, job, name, size, said):
    write_points(files.points, replace(wall_and_box(), **(TOLD | {name: size})))
    refused(retrue, files, job, files.points).require_complaint("points.csv: ", said)


def test_points_that_tell_the_rigs_own_sizes(retrue, files):
    write_points(files.points, replace(wall_and_box(), **TOLD))
    run = retrue("reconstruct", files.rig, files.points, "--out", files.folder / "out.ply")
    assert run.status == 0, run


@pytest.mark.parametrize("job", JOBS)
def test_points_that_tell_nothing_and_lie_outside(retrue, files, job):
    points = wall_and_box()
    write_points(files.points, replace(points, camera_px=2 * points.camera_px))
    run = refused(retrue, files, job, files.points)
    run.require_complaint("points.csv: ", "lie beyond the last pixel of the rig's picture, 1280 x 960, and none before")


def test_boards_of_two_sizes(retrue, files, pattern):
    for name, height in (("a", 960), ("b", 480)):
        (files.folder / name).mkdir()
        for shown in ("white", "grid"):
            cv2.imwrite(str(files.folder / name / f"{shown}.png"), np.zeros((height, 4 * height // 3), np.uint8))
    before = names(files.folder)
    poses = files.folder / "a", files.folder / "b"
    run = retrue(
        "calibrate", *poses, "--pattern", pattern, "--board", "chessboard:7x9:75mm", "--out", files.folder / "new.json"
    )
    run.require_complaint("b: expected pictures of 1280 x 960", "found 640 x 480: binned by 2; one calibration")
    assert names(files.folder) == before


def test_a_watch_passes_over_frames_of_another_size(retrue, files):
    frames = files.folder / "frames"
    frames.mkdir()
    write_points(frames / "0.csv", replace(wall_and_box(seed=0), **TOLD))
    write_points(frames / "1.csv", replace(wall_and_box(seed=1), **(TOLD | {"camera_size": (640, 480)})))
    points = wall_and_box(seed=2)
    write_points(frames / "2.csv", replace(points, camera_px=2 * points.camera_px))
    rig, out = files.rig.read_bytes(), files.folder / "out"
    limits = [
        "--poll-seconds",
        "0.01",
        "--settle-seconds",
        "0.02",
        "--patience-seconds",
        "0.05",
        "--idle-seconds",
        "0.1",
    ]
    assert retrue("watch", files.rig, frames, "--out", out, *limits).status == 0
    events = [json.loads(line) for line in (out / "events.jsonl").read_text().splitlines()]
    told = {event["name"]: event["reason"] for event in events if event["event"] == "bad frame"}
    assert told.keys() == {"1.csv", "2.csv"}
    assert "binned by 2" in told["1.csv"]
    assert "of a picture of another size" in told["2.csv"]
    assert files.rig.read_bytes() == rig


def test_a_watch_does_not_start_with_a_pattern_for_another_projector(retrue, files, pattern):
    write_rig(files.before, Rig(CAMERA, replace(PROJECTOR, size=(1280, 800)), TRUE))
    run = retrue("watch", files.before, files.folder, "--pattern", pattern, "--out", files.folder / "out")
    run.require_complaint("pattern.json: the pattern is for a projector of 1024 x 768, the rig's is 1280 x 800")


@pytest.mark.parametrize("job", JOBS)
@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("binned-capture", ("capture.jpg: ", "640 x 480", "1280 x 960", "binned by 2")),
        ("pattern-of-another-size", ("the pattern is for a projector of 1024 x 768, the rig's is 1280 x 800",)),
    ],
)
def test_what_was_met_in_the_wild(retrue, tmp_path, job, fault, said):
    folder = DATA / "faults" / fault
    if not folder.is_dir():
        pytest.skip(f"{folder} is not there")
    out = [] if job == "verify" else ["--out", tmp_path / "out.ply"]
    run = retrue(job, folder / "rig.json", folder / "capture.jpg", "--pattern", folder / "pattern.json", *out)
    run.require_complaint(*said)
    assert names(tmp_path) == []
