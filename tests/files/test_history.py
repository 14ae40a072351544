"""The history of a rig: nothing is lost, whoever writes at once and whenever somebody is killed."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from retrue.errors import FileError, InputError
from retrue.files.append_log import opened_log, read_log
from retrue.files.file_lock import locked
from retrue.files.history import (
    capture_record,
    entry_in_place,
    history_path,
    known_working_distance,
    read_history,
    roll_back,
    write_in_place,
)
from retrue.files.rigs import read_rig, write_rig
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.recalibration.result import Accepted, Evidence
from retrue.rig import Rig

from . import writers

CAMERA = Camera((1280, 960), [[1500, 0, 640], [0, 1500, 480], [0, 0, 1]])


def rig(turn: float) -> Rig:
    return Rig(CAMERA, CAMERA, RigidTransform.from_rotation_vector([0, turn, 0], [-300.0, 0, 0]), "mm", {"turn": turn})


def accepted(turn: float) -> Accepted:
    return Accepted(rig(turn), "because", Evidence(100, rms_px=0.1))


def turns(path: Path) -> list[float]:
    return [entry.rig.evidence["turn"] for entry in read_history(path)]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    write_rig(tmp_path / "rig.json", rig(0.0))
    return tmp_path / "rig.json"


def test_a_rig_that_nobody_touched_has_no_history(path):
    assert read_history(path) == []
    assert not history_path(path).exists()


def test_both_rigs_are_kept_with_what_they_rest_on(path):
    capture = capture_record(path)
    entry = write_in_place(path, accepted(0.1), [capture])
    found, new = read_history(path)
    assert (found.id, found.action, found.captures) == (1, "found", ())
    assert (new.id, new.action, new.captures) == (2, "recalibrated", (capture,))
    assert entry.id == new.id
    assert new.evidence["reason"] == "because"
    assert new.evidence["rms_px"] == 0.1
    assert new.time >= found.time
    assert turns(path) == [0.0, 0.1]
    assert read_rig(path).evidence == {"turn": 0.1}
    assert np.array_equal(new.rig.projector_from_camera.R, rig(0.1).projector_from_camera.R)


def test_a_rig_edited_by_hand_is_kept_too(path):
    write_in_place(path, accepted(0.1))
    write_rig(path, rig(0.15))
    assert entry_in_place(read_history(path), read_rig(path)) is None
    write_in_place(path, accepted(0.2))
    assert turns(path) == [0.0, 0.1, 0.15, 0.2]
    assert [entry.action for entry in read_history(path)] == ["found", "recalibrated", "found", "recalibrated"]


def test_rollback_goes_back_step_by_step_and_is_an_entry_itself(path):
    for turn in (0.1, 0.2, 0.3):
        write_in_place(path, accepted(turn))
    assert roll_back(path).restored == 3
    assert roll_back(path).restored == 2
    assert read_rig(path).evidence == {"turn": 0.1}
    assert roll_back(path, 4).restored == 4
    assert read_rig(path).evidence == {"turn": 0.3}
    assert turns(path) == [0.0, 0.1, 0.2, 0.3, 0.2, 0.1, 0.3]
    assert roll_back(path).restored == 3
    roll_back(path, 1)
    before = history_path(path).read_bytes()
    with pytest.raises(InputError, match="no earlier rig"):
        roll_back(path)
    with pytest.raises(InputError, match=r"1 to 9\), found 99"):
        roll_back(path, 99)
    assert history_path(path).read_bytes() == before


def test_rollback_mends_a_damaged_rig(path):
    write_in_place(path, accepted(0.1))
    path.write_text("{")
    assert roll_back(path).restored == 2
    assert read_rig(path).evidence == {"turn": 0.1}


def test_rollback_where_there_is_no_history_leaves_none(path):
    with pytest.raises(InputError, match="no earlier rig"):
        roll_back(path)
    assert [entry.name for entry in path.parent.iterdir()] == ["rig.json"]


@pytest.mark.parametrize("torn", [b"{", b'{"id": 3, "time": "20', b"\0" * 100, b"\xff\xfe"])
def test_a_torn_last_line_is_passed_over_and_repaired(path, torn):
    write_in_place(path, accepted(0.1))
    log = history_path(path)
    log.write_bytes(log.read_bytes() + torn)
    assert turns(path) == [0.0, 0.1]
    write_in_place(path, accepted(0.2))
    assert turns(path) == [0.0, 0.1, 0.2]
    assert torn not in log.read_bytes().splitlines()


def test_a_last_line_that_lacks_only_its_end_is_kept(path):
    write_in_place(path, accepted(0.1))
    log = history_path(path)
    log.write_bytes(log.read_bytes()[:-1])
    assert turns(path) == [0.0, 0.1]
    write_in_place(path, accepted(0.2))
    assert turns(path) == [0.0, 0.1, 0.2]


def test_a_damaged_line_in_the_middle_is_named_and_nothing_is_written(path):
    write_in_place(path, accepted(0.1))
    log = history_path(path)
    log.write_bytes(b"{}\n" + log.read_bytes())
    for action in (lambda: read_history(path), lambda: write_in_place(path, accepted(0.2))):
        with pytest.raises(FileError, match=r"history\.jsonl: line 1: expected an entry"):
            action()
    assert read_rig(path).evidence == {"turn": 0.1}


@pytest.mark.parametrize(
    "edit",
    [
        {"id": True},
        {"id": 5},
        {"time": "yesterday"},
        {"time": "2025-01-01T00:00:00"},
        {"action": "eaten"},
        {"rig": []},
        {"rig": {}},
        {"captures": [3]},
        {"evidence": None},
        {"restored": "1"},
    ],
    ids=str,
)
def test_a_line_that_is_no_entry_is_named(path, edit):
    write_in_place(path, accepted(0.1))
    log = history_path(path)
    first, second = log.read_text().splitlines()
    log.write_text(json.dumps(json.loads(first) | edit) + "\n" + second + "\n")
    with pytest.raises(FileError, match=r"history\.jsonl: line [12]: "):
        read_history(path)


def test_a_full_disk_changes_nothing(path):
    """The kernel itself refuses: no file may grow beyond the limit in the process that tries."""
    write_in_place(path, accepted(0.1))
    before = {entry.name: entry.read_bytes() for entry in path.parent.iterdir()}
    size = history_path(path).stat().st_size
    for limit in (size, size + 100):
        with writers.start("full_disk", path, limit) as process:
            said, _ = process.communicate()
        assert process.returncode == 3
        assert "cannot be written: File too large" in said
        assert {entry.name: entry.read_bytes() for entry in path.parent.iterdir()} == before


def test_a_rig_that_cannot_be_replaced_leaves_no_entry(path, monkeypatch):
    write_in_place(path, accepted(0.1))
    before = history_path(path).read_bytes()

    def refuse(self: Path, target: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "replace", refuse)
    with pytest.raises(FileError, match="Permission denied"):
        write_in_place(path, accepted(0.2))
    assert history_path(path).read_bytes() == before
    assert sorted(entry.name for entry in path.parent.iterdir()) == ["rig.json", "rig.json.history.jsonl"]
    assert read_rig(path).evidence == {"turn": 0.1}


def test_a_read_only_rig_is_left_alone(path, monkeypatch):
    monkeypatch.setattr("os.access", lambda *_: False)
    with pytest.raises(FileError, match="read-only"):
        write_in_place(path, accepted(0.1))
    assert [entry.name for entry in path.parent.iterdir()] == ["rig.json"]


def test_evidence_that_is_no_json_changes_nothing(path):
    bad = replace(accepted(0.1), evidence=Evidence(1, rms_px=float("nan")))
    with pytest.raises(InputError, match="evidence"):
        write_in_place(path, bad)
    assert [entry.name for entry in path.parent.iterdir()] == ["rig.json"]


def test_processes_at_once_lose_no_entry(path):
    processes = [writers.start("write_many", path, start, 10) for start in (100, 200, 300)]
    for process in processes:
        with process:
            process.communicate()
        assert process.returncode == 0
    expected = {0.0} | {float(start + k) for start in (100, 200, 300) for k in range(10)}
    assert set(turns(path)) == expected
    assert len(turns(path)) == len(expected)
    assert entry_in_place(read_history(path), read_rig(path)) is not None


def test_kills_at_random_moments_lose_nothing(path):
    survey = writers.kill_at_random(path, kills=8, seed=0)
    assert survey.unreadable == 0
    assert survey.lost == 0
    assert survey.written >= 8


def test_a_lock_that_stays_taken_is_an_error_not_a_hang(path):
    log = history_path(path)
    with (
        opened_log(log),
        log.open("rb") as again,
        pytest.raises(FileError, match="in use"),
        locked(log, again.fileno(), patience=0.05),
    ):
        pass


def test_a_link_shares_the_history_and_stays_a_link(path):
    link = path.with_name("link.json")
    link.symlink_to(path)
    write_in_place(link, accepted(0.1))
    assert link.is_symlink()
    assert turns(path) == turns(link) == [0.0, 0.1]


def test_a_log_that_is_no_file_or_too_large_is_refused(path):
    log = history_path(path)
    log.mkdir()
    with pytest.raises(FileError):
        read_log(log)
    log.rmdir()
    with log.open("wb") as stream:
        stream.truncate(2**40)  # sparse
    with pytest.raises(FileError, match="at most"):
        write_in_place(path, accepted(0.1))


def test_the_working_distance_is_remembered(path):
    evidence = Evidence(1, working_distance=1500.0)
    assert known_working_distance(path, rig(0.0)) is None
    write_in_place(path, Accepted(rig(0.1), "", evidence))
    assert known_working_distance(path, read_rig(path)) == 1500.0


def test_a_capture_is_recorded_as_sha256sum_gives_it(tmp_path):
    folder = tmp_path / "capture"
    folder.mkdir()
    for name in ("img10.png", "img9.png"):
        (folder / name).write_bytes(name.encode())
    (folder / "notes.txt").write_text("stray")
    digest = hashlib.sha256(b"img9.png").hexdigest()
    assert capture_record(folder / "img9.png") == {"name": "img9.png", "sha256": digest}
    lines = f"{digest}  img9.png\n{hashlib.sha256(b'img10.png').hexdigest()}  img10.png\n"
    assert capture_record(folder)["sha256"] == hashlib.sha256(lines.encode()).hexdigest()
