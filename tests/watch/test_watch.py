"""The watch on simulated frames: it finds what moved, leaves alone what did not, and logs everything."""

from __future__ import annotations

import json
import shutil
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from retrue.files.history import read_history, roll_back
from retrue.files.rigs import read_rig, write_rig
from retrue.geometry.transform import rotation_angle
from retrue.recalibration.reasons import LensUnchecked, PoseUndetermined
from retrue.recalibration.recalibrate import recalibrate
from retrue.recalibration.result import Accepted, Evidence, Refused
from retrue.recalibration.streak import CreepOptions
from retrue.watch.events import EventLog
from retrue.watch.options import WatchOptions
from retrue.watch.state import read_state
from retrue.watch.watch import Watch

from .stream import RIG, STAGES, SimulatedSource, frame, seen_by, turned


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_rig(tmp_path / "rig.json", RIG)
    return tmp_path


def watching(folder: Path, stages=STAGES, **options) -> Watch:
    state = read_state(folder / "state.json", "simulated")
    events = EventLog(folder / "events.jsonl")
    return Watch(folder / "rig.json", stages, events, state, folder / "state.json", WatchOptions(**options))


def events(folder: Path, *kinds: str) -> list[dict]:
    lines = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
    return [line for line in lines if not kinds or line["event"] in kinds]


def degrees_off(folder: Path, truth) -> float:
    found = read_rig(folder / "rig.json").projector_from_camera
    return float(np.degrees(rotation_angle(found.R @ truth.projector_from_camera.R.T)))


def number_of(event: dict) -> int:
    return int(event["name"].removeprefix("frame "))


def test_jump_drift_dark_and_broken_frames(folder):
    source = SimulatedSource(
        70,
        jumps={10: (1.0, -0.7, 0.4), 26: (0.0, 2.0, 0.0)},
        drift=(38, 63, (0.3, 0.3, 0.0)),
        dark=7,
        broken=11,
    )
    watch = watching(folder)
    last = watch.run(source, threading.Event())
    watch.events.close()
    counts = watch.state.counts
    assert last["reason"] == "the source ended"
    assert counts.frames == 70
    assert counts.bad == sum(source.kind(n) == "broken" for n in range(70)) == len(events(folder, "bad frame"))
    assert counts.good + counts.drifted + counts.unknown == len(events(folder, "frame")) == 70 - counts.bad
    history = events(folder, "recalibrated")
    assert len(history) == counts.recalibrated == len(read_history(folder / "rig.json")) - 1
    newest = [max(int(name.removeprefix("frame ")) for name in event["frames"]) for event in history]
    for jump in source.jumps:
        assert any(jump + 2 <= number <= jump + 4 for number in newest), newest
    uncalled = [number for number in newest if number < 10 or 15 < number < 26 or 31 < number < 38]
    assert uncalled == []
    assert degrees_off(folder, source.rig_at(69)) < 0.15
    assert events(folder)[0]["event"] == "started"
    assert events(folder)[-1] == last


def test_a_rig_that_holds_is_left_alone(folder):
    before = (folder / "rig.json").read_bytes()
    watch = watching(folder)
    watch.run(SimulatedSource(40), threading.Event())
    watch.events.close()
    assert (folder / "rig.json").read_bytes() == before
    assert watch.state.counts.recalibrated == watch.state.counts.refused == 0


def test_frames_of_two_poses_are_not_mixed(folder):
    """The rig moves within the streak: what is solved must be one pose, soon after."""
    watch = watching(folder)
    one, two = turned(RIG, (1.0, 0, 0)), turned(RIG, (0, 2.5, 0))
    for number in range(2):
        watch.handle(frame(f"frame {number}", seen_by(one, number)))
    for number in range(2, 9):
        watch.handle(frame(f"frame {number}", seen_by(two, number)))
    watch.events.close()
    assert degrees_off(folder, two) < 0.1
    assert all(np.min(np.abs([1.0 - o, 2.5 - o])) < 0.1 for o in [degrees_off(folder, RIG)])


def test_what_is_refused_is_never_written(folder):
    before = (folder / "rig.json").read_bytes()
    stages = replace(STAGES, recalibrate=lambda rig, captures: Refused(PoseUndetermined("no plane"), Evidence(0)))
    watch = watching(folder, stages)
    for number in range(6):
        watch.handle(frame(f"frame {number}", seen_by(turned(RIG, (1, 0, 0)), number)))
    watch.events.close()
    assert (folder / "rig.json").read_bytes() == before
    assert [event["reason"] for event in events(folder, "refused")] == [str(PoseUndetermined("no plane"))] * 2


def test_a_pose_whose_lenses_nothing_checks_is_never_written_without_a_word(folder):
    before = (folder / "rig.json").read_bytes()
    watch = watching(folder, replace(STAGES, recalibrate=recalibrate))
    for number in range(3):
        watch.handle(frame(f"frame {number}", seen_by(turned(RIG, (1, 0, 0)), number)))
    watch.events.close()
    assert (folder / "rig.json").read_bytes() == before
    (event,) = events(folder, "refused")
    assert (event["kind"], event["verdict"], event["cause"]) == ("bump", "refused", "LensUnchecked")
    assert event["reason"] == str(LensUnchecked())


def test_a_rig_that_holds_is_kept(folder):
    before = (folder / "rig.json").read_bytes()
    stages = replace(STAGES, recalibrate=lambda rig, captures: Accepted(rig, "it holds", Evidence(0), unchanged=True))
    watch = watching(folder, stages)
    for number in range(3):
        watch.handle(frame(f"frame {number}", seen_by(turned(RIG, (1, 0, 0)), number)))
    watch.events.close()
    assert (folder / "rig.json").read_bytes() == before
    assert "still holds" in events(folder, "refused")[0]["reason"]


def test_an_answer_that_its_own_frames_contradict_is_never_written(folder):
    before = (folder / "rig.json").read_bytes()
    wrong = turned(RIG, (0, 5, 0))
    stages = replace(STAGES, recalibrate=lambda rig, captures: Accepted(wrong, "surely", Evidence(0)))
    watch = watching(folder, stages)
    for number in range(3):
        watch.handle(frame(f"frame {number}", seen_by(turned(RIG, (1, 0, 0)), number)))
    watch.events.close()
    assert (folder / "rig.json").read_bytes() == before
    assert "do not agree" in events(folder, "refused")[0]["reason"]


def test_a_disk_that_is_full_for_a_while(folder, monkeypatch):
    watch = watching(folder)
    moved = turned(RIG, (1, 0, 0))

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("retrue.watch.watch.write_in_place", full)
    for number in range(3):
        watch.handle(frame(f"frame {number}", seen_by(moved, number)))
    assert "No space left" in events(folder, "refused")[0]["reason"]
    monkeypatch.undo()
    for number in range(3, 6):
        watch.handle(frame(f"frame {number}", seen_by(moved, number)))
    watch.events.close()
    assert degrees_off(folder, moved) < 0.1


def test_a_frame_that_breaks_the_decoder_is_passed_over(folder):
    def broken(_):
        raise ZeroDivisionError("division\nby zero")

    watch = watching(folder, replace(STAGES, decode=broken))
    watch.handle(frame("frame 0", seen_by(RIG, 0)))
    watch.events.close()
    (event,) = events(folder, "bad frame")
    assert event["reason"] == "ZeroDivisionError: division by zero"
    assert watch.state.counts.bad == 1


def test_creep_below_what_a_frame_can_see_is_followed(folder):
    """The filter finds it over many frames; none of them had drifted by itself."""
    rate = 0.0016  # degrees a frame
    (folder / "warm.csv").write_text("08:00,21.5\n")
    watch = watching(folder)
    watch.temperature = folder / "warm.csv"
    watch.options = WatchOptions(creep=CreepOptions(creep_memory=10))
    for number in range(120):
        truth = turned(RIG, (rate * max(0, number - 15), 0, 0))
        watch.handle(frame(f"frame {number}", seen_by(truth, number, 200)))
        if watch.state.counts.recalibrated:
            break
    watch.events.close()
    (event,) = events(folder, "recalibrated")
    assert (event["kind"], event["verdict"], event["cause"]) == ("creep", "accepted", None)
    seen = events(folder, "frame")
    assert {item["verdict"] for item in seen} == {"good"}
    assert seen[-1]["creep"]["sigmas"] > 5
    assert seen[-1]["temperature"] == 21.5


def test_a_bump_within_a_streak_of_creep_is_told_as_one_and_found_as_soon(folder):
    watch = watching(folder, creep=CreepOptions(creep_memory=10, creep_share=1000.0))
    watch.run(SimulatedSource(56, jumps={49: (0.0, 1.5, 0.0)}, drift=(30, 64, (0.3, 0.0, 0.0))), threading.Event())
    watch.events.close()
    drifted = [number_of(event) for event in events(folder, "frame") if event["verdict"] == "drifted"]
    assert drifted[0] == 48  # of the creep
    assert [event["kind"] for event in events(folder, "recalibrated")] == ["bump"]
    assert events(folder, "recalibrated")[0]["frames"] == ["frame 49", "frame 50", "frame 51"]


def test_a_rollback_by_somebody_else_is_obeyed(folder):
    watch = watching(folder)
    moved = turned(RIG, (1, 0, 0))
    for number in range(4):
        watch.handle(frame(f"frame {number}", seen_by(moved, number)))
    roll_back(folder / "rig.json")
    watch.handle(frame("frame 4", seen_by(RIG, 4)))
    (folder / "rig.json").write_text("{")
    watch.handle(frame("frame 5", seen_by(RIG, 5)))
    watch.events.close()
    assert [event["verdict"] for event in events(folder, "frame")] == ["drifted"] * 3 + ["good"] * 3
    assert len(events(folder, "rig changed")) == len(events(folder, "rig unreadable")) == 1


def test_a_second_watch_goes_on_where_the_first_was(folder):
    first = watching(folder)
    stop = threading.Event()

    class Stopping(SimulatedSource):
        def frames(self, ended):
            for item in super().frames(ended):
                yield item
                if item.name == "frame 9":
                    stop.set()

    assert first.run(Stopping(30), stop)["reason"] == "stopped"
    first.events.close()
    second = watching(folder)
    second.run(SimulatedSource(30, first=second.state.position["next"]), threading.Event())
    second.events.close()
    assert [number_of(event) for event in events(folder, "frame")] == list(range(30))
    assert second.state.counts.frames == 30
    assert [event["resumed"] for event in events(folder, "started")] == [False, True]
    assert read_state(folder / "state.json", "simulated").counts == second.state.counts
    assert read_state(folder / "state.json", "another source").counts.frames == 0


def begun(folder: Path, first: int, end: int) -> Watch:
    """A watch of a rig that is bumped at frame 40, from one frame to another, as a process that is then killed."""
    watch = watching(folder)
    watch.run(SimulatedSource(end, jumps={40: (1.0, 0, 0)}, first=first), threading.Event())
    watch.events.close()
    return watch


@pytest.fixture(scope="module")
def first_frames(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("begun")
    write_rig(folder / "rig.json", RIG)
    begun(folder, 0, 41)
    return folder


@pytest.fixture
def bumped(first_frames, tmp_path) -> Path:
    """What a watch left that ended after the first frame of a bump, and takes its own copy of the rig for the same."""
    folder = shutil.copytree(first_frames, tmp_path / "bumped")
    state, rig = json.loads((folder / "state.json").read_text()), (folder / "rig.json").stat()
    state["memory"]["rig"] = [rig.st_ino, rig.st_size, rig.st_mtime_ns, rig.st_ctime_ns]
    (folder / "state.json").write_text(json.dumps(state))
    return folder


def test_a_bump_is_found_as_soon_when_the_watch_is_stopped_within_it(bumped):
    assert len(list((bumped / "drifted").iterdir())) == 1
    begun(bumped, 41, 42)
    assert events(bumped, "recalibrated") == []
    begun(bumped, 42, 43)
    (event,) = events(bumped, "recalibrated")
    assert event["frames"] == ["frame 40", "frame 41", "frame 42"]
    assert event["kind"] == "bump"
    assert not (bumped / "drifted").exists()


def test_the_filter_goes_on_after_a_stop(folder):
    begun(folder, 0, 35)
    begun(folder, 35, 40)
    creep = [event["creep"] for event in events(folder, "frame")]
    assert [number for number, found in enumerate(creep) if found is not None] == list(
        range(29, 40)
    )  # of thirty frames


def test_what_was_remembered_of_another_rig_is_forgotten(bumped):
    begun(bumped, 41, 42)
    write_rig(bumped / "rig.json", turned(RIG, (1.0, 0, 0)))
    begun(bumped, 42, 50)
    assert events(bumped, "recalibrated") == []
    assert not (bumped / "drifted").exists()


@pytest.mark.parametrize("spoilt", ["points", "creep", "streak"])
def test_memory_that_is_damaged_is_told_and_begins_anew(bumped, spoilt):
    begun(bumped, 41, 42)
    (bumped / "drifted/7.npz").write_bytes(b"left by a process that was killed")
    if spoilt == "points":
        (bumped / "drifted/42.npz").write_bytes(b"rubbish")
    else:
        state = json.loads((bumped / "state.json").read_text())
        state["memory"][spoilt] = {"last": [1, 2]} if spoilt == "creep" else ["rubbish"]
        (bumped / "state.json").write_text(json.dumps(state))
    begun(bumped, 42, 45)
    (event,) = events(bumped, "forgotten")
    assert "does not read" in event["reason"]
    assert events(bumped, "recalibrated")[0]["frames"] == ["frame 42", "frame 43", "frame 44"]
    assert not (bumped / "drifted").exists()


def test_a_damaged_history_is_told_once_and_closes_nothing(bumped):
    begun(bumped, 41, 43)
    path = bumped / "rig.json.history.jsonl"
    path.write_bytes(path.read_bytes().replace(b'"action": "recalibrated"', b'"action": "recalibrate?"'))
    watch = watching(bumped)
    watch.run(SimulatedSource(60, jumps={40: (1.0, 0, 0), 50: (0, 2.0, 0)}, first=43), threading.Event())
    watch.events.close()
    (event,) = events(bumped, "history damaged")
    assert event["lines"] == 1
    assert "rig.json.history.jsonl: line 2" in event["reason"]
    assert len(events(bumped, "recalibrated")) == 2


def test_a_cloud_per_frame_but_none_from_a_rig_that_drifted(folder):
    written: list[tuple[str, float]] = []

    def write_cloud(rig, points, name):
        off = np.degrees(rotation_angle(rig.projector_from_camera.R @ RIG.projector_from_camera.R.T))
        written.append((name, round(float(off), 1)))
        return Path(name)

    watch = watching(folder, replace(STAGES, write_cloud=write_cloud))
    for number in range(8):
        truth = turned(RIG, (1, 0, 0)) if number >= 2 else RIG
        watch.handle(frame(f"frame {number}", seen_by(truth, number)))
    watch.events.close()
    assert written == [(f"frame {number}", 1.0 if number >= 2 else 0.0) for number in range(8)]


def test_a_source_that_fails_ends_the_watch_and_says_so(folder):
    class Failing(SimulatedSource):
        def frames(self, stop):
            yield from super().frames(stop)
            raise RuntimeError("unplugged")

    watch = watching(folder)
    with pytest.raises(RuntimeError, match="unplugged"):
        watch.run(Failing(2), threading.Event())
    watch.events.close()
    assert events(folder)[-1]["reason"] == "failed"
    assert len(events(folder, "frame")) == 2


def test_a_torn_line_in_the_log_stays_alone(folder):
    (folder / "events.jsonl").write_text('{"event": "fra')
    watch = watching(folder)
    watch.handle(frame("frame 0", seen_by(RIG, 0)))
    watch.events.close()
    lines = (folder / "events.jsonl").read_text().splitlines()
    assert json.loads(lines[1])["event"] == "frame"
