"""`retrue watch` through the front door: a folder, a video, signals, metrics."""

import json
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path

import cv2
import numpy as np
import pytest

from retrue import Rig, read_rig, write_points, write_rig
from retrue.files.history import read_history
from retrue.geometry.transform import rotation_angle
from tests.watch.stream import quick_table, quick_words

from .conftest import CAMERA, PROJECTOR, TRUE, names, wall_and_box

DEMO = Path(__file__).parents[2] / "src" / "retrue" / "demo_data"
TRUSTING = "--lens", "fixed"
QUICK = quick_words()


@pytest.fixture
def stream(files):
    """A folder with four captures of the rig as it is, and one file that is broken."""
    folder = files.folder / "stream"
    folder.mkdir()
    for number in range(4):
        write_points(folder / f"{number}.csv", wall_and_box(seed=number))
    (folder / "broken.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    return folder


def lines(text):
    return [json.loads(line) for line in text.splitlines()]


def test_a_folder_is_watched_and_the_rig_put_right(retrue, files, stream):
    out = files.folder / "out"
    run = retrue("watch", files.before, stream, "--out", out, "--clouds", "--json", *TRUSTING, *QUICK)
    assert run.status == 0
    told = lines(run.out)
    assert told == lines((out / "events.jsonl").read_text())
    assert [event["event"] for event in told] == [
        "started", "frame", "frame", "frame", "recalibrated", "frame", "bad frame", "stopped",
    ]  # fmt: skip
    assert [event["verdict"] for event in told if event["event"] == "frame"] == ["drifted"] * 3 + ["good"]
    new = read_rig(files.before)
    assert np.degrees(rotation_angle(new.projector_from_camera.R @ TRUE.R.T)) < 0.1
    entry = read_history(files.before)[-1]
    assert sorted(capture["name"] for capture in entry.captures) == ["0.csv", "1.csv", "2.csv"]
    assert names(out / "clouds") == ["0.csv.ply", "1.csv.ply", "2.csv.ply", "3.csv.ply"]
    again = retrue("watch", files.before, stream, "--out", out, *QUICK)
    assert again.status == 0
    assert "5 frames" in again.out


def test_a_video_of_the_demo_scene(retrue, tmp_path):
    picture = cv2.imread(str(DEMO / "scene.jpg"))
    height, width = picture.shape[:2]
    writer = cv2.VideoWriter(
        str(tmp_path / "clip.avi"), cv2.CAP_OPENCV_MJPEG, cv2.VideoWriter.fourcc(*"MJPG"), 25, (width, height)
    )
    writer.set(cv2.VIDEOWRITER_PROP_QUALITY, 100)
    for factor in (0.0, 1.0, 1.0):
        writer.write((picture * factor).astype(np.uint8))
    writer.release()
    (tmp_path / "rig.json").write_bytes((DEMO / "rig_before.json").read_bytes())
    run = retrue(
        "watch", tmp_path / "rig.json", tmp_path / "clip.avi", "--pattern", DEMO / "pattern.json",
        "--out", tmp_path / "out", "--drifted-frames", "2", "--json", *TRUSTING,
    )  # fmt: skip
    assert run.status == 0
    assert lines(run.out)[-1]["recalibrated"] == 1
    truth, found = read_rig(DEMO / "rig_true.json"), read_rig(tmp_path / "rig.json")
    turn = found.projector_from_camera.R @ truth.projector_from_camera.R.T
    assert np.degrees(rotation_angle(turn)) < 0.05


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_it_cleanly(files, stream, number):
    out = files.folder / "out"
    command = [sys.executable, "-c", "import sys; from retrue.cli.main import main; sys.exit(main())"]
    command += ["watch", str(files.rig), str(stream), "--out", str(out), "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert json.loads(process.stdout.readline())["event"] == "started"
        second = subprocess.run(command, capture_output=True, text=True, check=False)
        process.send_signal(number)
        rest, complaints = process.communicate(timeout=30)
    assert second.returncode == 2
    assert "in use by another process" in second.stderr
    assert (process.returncode, complaints) == (0, "")
    assert lines(rest)[-1]["reason"] == "stopped"
    assert json.loads((out / "state.json").read_text())["format"] == "retrue-watch"


def test_nobody_who_reads_its_events_is_no_fault(files, stream):
    command = [sys.executable, "-c", "import sys; from retrue.cli.main import main; sys.exit(main())"]
    command += ["watch", str(files.rig), str(stream), "--out", str(files.folder / "out"), "--json", *QUICK]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        process.stdout.close()
        complaints = process.stderr.read()
    assert (process.returncode, complaints) == (0, "")


def test_metrics_count_what_the_events_say():
    pytest.importorskip("prometheus_client")
    from retrue.watch.metrics import Metrics

    drift = {"rotation_deg": 0.5, "translation_deg": 0.25, "length": 0.0}
    with Metrics(0) as metrics:
        for verdict in ("good", "drifted", "drifted"):
            metrics.observe(
                {"event": "frame", "verdict": verdict, "epipolar_rms_px": 0.125, "drift": drift, "drift_sigmas": 2.0,
                 "seconds": {"decode": 0.5}}
            )  # fmt: skip
        metrics.observe({"event": "bad frame", "seconds": {}})
        metrics.observe({"event": "dropped", "count": 7})
        metrics.observe({"event": "recalibrated", "seconds": {"recalibrate": 1.5}})
        metrics.observe({"event": "started"})
        with urllib.request.urlopen(f"http://127.0.0.1:{metrics.port}/metrics") as answer:
            served = dict(line.rsplit(" ", 1) for line in answer.read().decode().splitlines() if line[0] != "#")
    assert served['retrue_frames_total{rig="",verdict="drifted"}'] == "2.0"
    assert served['retrue_frames_total{rig="",verdict="bad"}'] == "1.0"
    assert served['retrue_dropped_frames_total{rig=""}'] == "7.0"
    assert served['retrue_recalibrations_total{answer="recalibrated",rig=""}'] == "1.0"
    assert served['retrue_stage_seconds_sum{rig="",stage="decode"}'] == "1.5"
    assert served['retrue_epipolar_rms_px{rig=""}'] == "0.125"
    assert served['retrue_drift_rotation_deg{rig=""}'] == "0.5"


def test_what_cannot_be_watched(retrue, files, stream):
    out = files.folder / "out"
    watch = ["watch", files.rig]
    retrue(*watch, files.folder / "none.avi", "--out", out).require_complaint("--pattern")
    grid = ["--pattern", DEMO / "pattern.json", "--out", out]
    retrue(*watch, files.folder / "none.avi", *grid).require_complaint("none.avi", "a folder, a video")
    retrue(*watch, files.rig, *grid).require_complaint("expected a video")
    retrue(*watch, DEMO / "scene.jpg", *grid).require_complaint("one picture is no stream")
    retrue(*watch, "file:///etc/passwd", *grid).require_complaint("a folder, a video")
    assert retrue("pattern", "gray-code", "--projector-size", "64", "48", "--out", files.folder / "gray").status == 0
    retrue(*watch, stream, "--pattern", files.folder / "gray/pattern.json", "--out", out).require_complaint(
        "a Gray code"
    )
    sequence = files.folder / "sequence.json"
    head = {"format": "retrue-pattern", "version": 1, "kind": "sequence", "projector_size": [64, 48]}
    sequence.write_text(json.dumps({**head, "layout": "sltk"}))
    retrue(*watch, stream, "--pattern", sequence, "--out", out).require_complaint("found a sequence")
    retrue(*watch, stream, "--out", files.points).require_complaint("points.csv")
    retrue(*watch, stream, "--out", out, "--drifted-frames", "0").require_complaint("drifted")
    (out / "state.json").write_text("{}")
    retrue(*watch, stream, "--out", out).require_complaint("state.json")


def test_a_rig_that_holds_is_not_touched(retrue, files, stream):
    write_rig(files.rig, Rig(CAMERA, PROJECTOR, TRUE, "mm"))
    before = files.rig.read_bytes()
    run = retrue("watch", files.rig, stream, "--out", files.folder / "out", "--json", *QUICK)
    assert [event["verdict"] for event in lines(run.out) if event["event"] == "frame"] == ["good"] * 4
    assert files.rig.read_bytes() == before


def test_a_fleet_is_watched(retrue, files, stream):
    rig = '[[rig]]\nrig = "before.json"\nsource = "stream"\nclouds = true\n'
    fleet = files.folder / "fleet.toml"
    fleet.write_text('workers = 1\nport = 0\nlens = "fixed"\n' + quick_table() + rig)
    out = files.folder / "out"
    run = retrue("watch", fleet, "--out", out, "--json")
    assert run.status == 0
    assert "http://127.0.0.1:" in run.err
    *told, summary = lines(run.out)
    assert {event["rig"] for event in told} == {"before"}
    assert summary["rigs"]["before"]["recalibrated"] == 1
    assert names(out / "before" / "clouds") == ["0.csv.ply", "1.csv.ply", "2.csv.ply", "3.csv.ply"]
    retrue("watch", fleet, stream, "--out", out).require_complaint("fleet.toml", "command line")
    retrue("watch", fleet, "--lens", "fixed", "--out", out).require_complaint("fleet.toml", "command line")
    retrue("watch", files.rig, "--out", out).require_complaint("SOURCE")
