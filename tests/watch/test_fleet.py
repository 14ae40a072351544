"""Many rigs in one process: each is looked after, none disturbs another, and somebody is told."""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
import urllib.request
from datetime import UTC, datetime, timedelta
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from retrue import read_rig, write_points, write_rig
from retrue.errors import FileError, InputError
from retrue.geometry.transform import rotation_angle
from retrue.watch.alarms import Alarms
from retrue.watch.fleet import summary, watch_fleet
from retrue.watch.fleet_file import Alarm, read_fleet
from retrue.watch.rig_status import REMEMBERED, LastFrames, RigStatus, read_fleet_status
from retrue.watch.status import Status, status_page
from retrue.watch.work_pool import WorkPool

from .stream import RIG, quick_table, seen_by, turned

MOVED = turned(RIG, (1, 0, 0))
QUICK = quick_table(idle_seconds=0.3)


@pytest.fixture(scope="module")
def pool():
    with WorkPool(1) as pool:
        yield pool


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Three rigs: one holds, one is bumped after its third frame, and of one the file is broken."""
    for name in ("holds", "bumped", "broken"):
        write_rig(tmp_path / f"{name}.json", RIG)
        (tmp_path / name).mkdir()
        for number in range(7):
            moved = MOVED if name == "bumped" and number >= 3 else RIG
            write_points(tmp_path / name / f"{number}.csv", seen_by(moved, number))
            time.sleep(0.002)  # so that they come in this order
    (tmp_path / "broken.json").write_text("{")
    rigs = "".join(f'[[rig]]\nrig = "{name}.json"\nsource = "{name}"\n' for name in ("holds", "bumped", "broken"))
    (tmp_path / "fleet.toml").write_text('lens = "fixed"\n' + QUICK + rigs)
    return tmp_path


def events(folder: Path, rig: str, name: str = "") -> list[dict[str, Any]]:
    lines = (folder / "out" / rig / "events.jsonl").read_text().splitlines()
    return [event for line in lines if (event := json.loads(line))["event"] == name or not name]


def test_each_rig_is_looked_after_and_a_broken_one_disturbs_no_other(folder, pool):
    heard: list[tuple[str, str]] = []
    stop = threading.Event()

    def listen(event, rig):
        heard.append((rig, event["event"]))
        if sum(name == "stopped" for _, name in heard) == 2:
            stop.set()  # else the broken one would be tried for ever

    fleet = read_fleet(folder / "fleet.toml")
    found = summary(watch_fleet(fleet.rigs, folder / "out", pool, [listen], stop))
    assert found["rigs"]["holds"]["good"] == 7
    assert found["rigs"]["bumped"]["recalibrated"] == 1
    assert (found["frames"], found["recalibrated"]) == (14, 1)
    turn = read_rig(folder / "bumped.json").projector_from_camera.R @ MOVED.projector_from_camera.R.T
    assert np.degrees(rotation_angle(turn)) < 0.1
    assert [event["kind"] for event in events(folder, "bumped", "recalibrated")] == ["bump"]
    assert "JSON" in events(folder, "broken", "failed")[0]["reason"]
    assert ("holds", "frame") in heard


def test_a_fleet_goes_on_where_it_was(folder, pool):
    fleet = read_fleet(folder / "fleet.toml")
    for _ in range(2):
        watch_fleet(fleet.rigs[:2], folder / "out", pool, [], threading.Event())
    for rig in ("holds", "bumped"):
        assert [event["name"] for event in events(folder, rig, "frame")] == [f"{number}.csv" for number in range(7)]
    known = read_fleet_status(folder / "out")
    assert [known[rig]["frames"] for rig in ("holds", "bumped")] == [7, 7]
    assert [known[rig]["recalibrated"] for rig in ("holds", "bumped")] == [0, 1]
    off = [millimetres for _, millimetres in known["bumped"]["drift_mm"]]
    assert max(off[:3]) < 1 < 5 < min(off[3:6])
    assert [kind for _, kind in known["bumped"]["changes"]] == ["bump"]


RUBBISH_EVENTS = [
    "", "{", "[]", "3", "\0", "[" * 5000, '{"time": 3, "event": "frame"}', '{"time": "noon", "event": "refused"}',
    '{"time": "noon", "event": "frame", "verdict": "good", "reason": "", "drift": {"displacement": "far"}}',
    '{"time": "2026-11-27T08:00:00+00:00", "event": "frame", "verdict": 7, "reason": null, "drift": 5}',
    '{"time": "2026-11-27T08:00:00+00:00", "event": "frame", "verdict": "<b>", "reason": [], "drift": null}',
    '{"time": "noon", "event": "recalibrated", "kind": "bump"}',
    '{"time": "2026-11-27T08:00:00+00:00", "event": "frame", "verdict": "", "reason": "", "drift": null, '
    '"temperature": "hot"}',
    '{"time": "2026-11-27T08:00:00+00:00", "event": "frame", "verdict": "", "reason": "", "drift": null, '
    '"temperature": NaN}',
]  # fmt: skip


@pytest.mark.parametrize("state", ["", "[]", '{"format": "retrue-watch", "counts": {"frames": -1}}'])
def test_a_log_that_was_written_by_hand_does_not_close_the_page(tmp_path, state):
    good = {**FRAME, "time": "2026-11-27T08:00:01+00:00", "unit": "mm", "drift": {"displacement": 2.5}}
    (tmp_path / "cell").mkdir()
    (tmp_path / "cell" / "events.jsonl").write_text("\n".join([*RUBBISH_EVENTS, json.dumps(good), '{"time": "20']))
    (tmp_path / "cell" / "state.json").write_text(state)
    known = read_fleet_status(tmp_path)
    assert known["cell"]["drift_mm"][-1][1] == 2.5
    assert "&lt;holds&gt;" in status_page(known)
    assert known["cell"]["temperature"] == 21.5
    assert known["cell"]["changes"] == []
    json.dumps(known, allow_nan=False)


def test_a_process_that_dies_costs_nothing(folder, pool):
    assert pool.call(os.getpid) != os.getpid()
    os.kill(pool.call(os.getpid), signal.SIGKILL)
    assert pool.call(max, 2, 3) == 3
    with pytest.raises(InputError, match="died"):
        pool.call(os._exit, 1)
    assert pool.call(max, 2, 3) == 3
    with pytest.raises(ZeroDivisionError):
        pool.call(divmod, 1, 0)


FRAME = {
    "event": "frame", "verdict": "good", "reason": "<holds>", "epipolar_rms_px": 0.1, "drift_sigmas": 1.0,
    "creep": None, "temperature": 21.5, "seconds": {},
}  # fmt: skip


@pytest.mark.parametrize("frames", [0, 3, REMEMBERED, REMEMBERED + 7])
def test_the_last_frames_are_drawn_oldest_first(frames):
    drawn = LastFrames()
    begin = datetime(2026, 11, 27, 8, tzinfo=UTC)
    times = [(begin + timedelta(seconds=number)).isoformat(timespec="milliseconds") for number in range(frames)]
    for number, at in enumerate(times):
        drawn.append(at, None if number % 2 else float(number), 20.0 + number)
    drift, warmth = drawn.curves()
    kept = range(frames)[-REMEMBERED:]
    assert drift == [[times[number], None if number % 2 else float(number)] for number in kept]
    assert warmth == [[times[number], 20.0 + number] for number in kept]


def test_the_status_is_served_in_millimetres():
    pytest.importorskip("prometheus_client")
    from retrue.watch.metrics import Metrics

    metrics = Metrics()
    units = {"cell <1>": "m", "cell 2": "furlong"}
    with Status({name: RigStatus() for name in units}, 0, metrics) as status:
        for name, unit in units.items():
            for second in range(3):
                drift = {"rotation_deg": 0.5, "translation_deg": 0.25, "displacement": 0.001 * second}
                event = {**FRAME, "time": f"2026-11-27T08:00:0{second}+00:00", "drift": drift, "unit": unit}
                status.observe(event, name)
                metrics.observe(event, name)
        status.observe({"event": "failed", "reason": "unplugged", "time": "2026-11-27T08:00:05+00:00"}, "cell 2")
        served = {
            path: urllib.request.urlopen(f"http://127.0.0.1:{status.port}{path}").read().decode()
            for path in ("/", "/status.json", "/metrics")
        }
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(f"http://127.0.0.1:{status.port}/etc/passwd")
    document = json.loads(served["/status.json"])
    assert [off for _, off in document["cell <1>"]["drift_mm"]] == [0.0, 1.0, 2.0]
    assert [off for _, off in document["cell 2"]["drift_mm"]] == [None] * 3
    assert (document["cell 2"]["state"], document["cell 2"]["reason"]) == ("failed", "unplugged")
    assert 'retrue_frames_total{rig="cell <1>",verdict="good"} 3.0' in served["/metrics"]
    assert "cell &lt;1&gt;" in served["/"]
    assert "<holds>" not in served["/"]
    assert "21.5 degrees" in served["/"]
    assert served["/"] == status_page(document)


def test_alarms_reach_a_webhook_and_a_command(tmp_path):
    posted: list[dict[str, Any]] = []

    class Hook(BaseHTTPRequestHandler):
        def do_POST(self):
            posted.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(500 if len(posted) == 1 else 200)
            self.end_headers()

        def log_message(self, *_):
            pass

    server = HTTPServer(("127.0.0.1", 0), Hook)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    write = f"import sys; open({str(tmp_path / 'told')!r}, 'a').write(sys.stdin.read() + '\\n')"
    alarm = Alarm(f"http://127.0.0.1:{server.server_port}/", (sys.executable, "-c", write))
    with Alarms(alarm) as alarms:
        for name in ("frame", "recalibrated", "refused"):
            alarms.observe({"event": name}, "cell")
    server.shutdown()
    server.server_close()
    assert [event["event"] for event in posted] == ["recalibrated", "refused"]
    assert [json.loads(line)["rig"] for line in (tmp_path / "told").read_text().splitlines()] == ["cell", "cell"]
    assert alarms.failed == 1  # the hook that answered 500
    with Alarms(Alarm(None, ("/no/such/command",))) as alarms:
        alarms.observe({"event": "failed"}, "cell")
    assert alarms.failed == 1


RIG_TABLE = '[[rig]]\nrig = "a.json"\nsource = "a"\n'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[", "TOML"),
        ("workers = 2", "[[rig]]"),
        ("rig = [3]", "[[rig]]"),
        (RIG_TABLE + RIG_TABLE, "twice"),
        (RIG_TABLE + 'colour = "red"', "colour"),
        (RIG_TABLE + 'name = "../a"', "name"),
        (RIG_TABLE + "clouds = 3", "clouds"),
        (RIG_TABLE + "limits = {drifted_frames = 0}", "drifted_frames"),
        (RIG_TABLE + "limits = {nonsense = 0}", "nonsense"),
        (RIG_TABLE + "limits = {creep_memory = 0}", "creep_memory"),
        ('[[rig]]\nrig = "a.json"', "source"),
        (RIG_TABLE + 'lens = "glued"', "lens"),
        ("workers = 0\n" + RIG_TABLE, "workers"),
        ("port = 99999\n" + RIG_TABLE, "port"),
        ("alarm = 3\n" + RIG_TABLE, "alarm"),
        ('alarm = {webhook = "file:///etc"}\n' + RIG_TABLE, "webhook"),
        ('alarm = {command = "rm"}\n' + RIG_TABLE, "command"),
    ],
)
def test_a_fleet_that_makes_no_sense_is_named(tmp_path, text, said):
    (tmp_path / "fleet.toml").write_text(text)
    with pytest.raises(FileError, match=r"fleet\.toml") as caught:
        read_fleet(tmp_path / "fleet.toml")
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_limits_of_a_rig_stand_over_those_of_the_fleet(tmp_path):
    shared = 'lens = "fixed"\n[limits]\nqueue = 7\ncreep_memory = 9\n'
    other = '[[rig]]\nrig = "b.json"\nsource = "b"\nlens = "may-have-changed"\n'
    text = shared + RIG_TABLE + "limits = {queue = 8}\n" + other
    (tmp_path / "fleet.toml").write_text(text)
    rig, other = read_fleet(tmp_path / "fleet.toml").rigs
    assert (rig.limits.queue, rig.limits.creep.creep_memory) == (8, 9)
    assert (rig.judgement.estimate.lens, other.judgement.estimate.lens) == ("fixed", "may-have-changed")
    assert (rig.name, rig.source) == ("a", str(tmp_path / "a"))
