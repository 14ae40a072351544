"""The history of a rig: nothing is lost, whoever writes at once and whenever somebody is killed."""

from __future__ import annotations

import gzip
import hashlib
import json
import os
import re
import zlib
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from retrue.errors import FileError, InputError
from retrue.files.append_log import newest_first, opened_log, parts_folder
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
from retrue.files.history_entry import History
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
    assert read_history(path) == History()
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
def test_a_torn_last_line_is_told_and_written_on_behind(path, torn):
    write_in_place(path, accepted(0.1))
    log = history_path(path)
    log.write_bytes(log.read_bytes() + torn)
    assert turns(path) == [0.0, 0.1]
    entry = write_in_place(path, accepted(0.2))
    assert turns(path) == [0.0, 0.1, 0.2]
    (damaged,) = read_history(path).damaged
    assert (damaged.path, damaged.place) == (log, "line 3")
    assert entry.id == 4  # the torn line may have been entry 3


def test_a_last_line_that_lacks_only_its_end_is_kept(path):
    write_in_place(path, accepted(0.1))
    log = history_path(path)
    log.write_bytes(log.read_bytes()[:-1])
    assert turns(path) == [0.0, 0.1]
    write_in_place(path, accepted(0.2))
    assert turns(path) == [0.0, 0.1, 0.2]
    assert read_history(path).damaged == ()


def test_a_damaged_line_in_the_middle_closes_nothing(path):
    for turn in (0.1, 0.2):
        write_in_place(path, accepted(turn))
    log = history_path(path)
    first, second, third = log.read_bytes().splitlines()
    log.write_bytes(b"\n".join([b"{}", first, second.replace(b'"mm"', b'"in"'), third, b""]))
    history = read_history(path)
    assert turns(path) == [0.0, 0.2]
    assert [line.place for line in history.damaged] == ["line 1", "line 3"]
    assert "expected an entry" in history.damaged[0].problem
    assert "checksum" in history.damaged[1].problem
    assert roll_back(path).restored == 1
    assert write_in_place(path, accepted(0.3)).id == 5


@pytest.mark.parametrize("damage", ["flipped", "zeroed", "cut", "cut off"])
def test_any_damaged_byte_costs_its_own_line_and_no_other(path, damage):
    """Old parts included: two entries lie in a part, two in the file."""
    rng = np.random.default_rng(0)
    with small_parts():
        for turn in (0.1, 0.2, 0.3):
            write_in_place(path, accepted(turn))
    files = [history_path(path), *sorted(parts_folder(history_path(path)).iterdir())]
    whole = {file: file.read_bytes() for file in files}
    for file, content in whole.items():
        places = entries_in(file, content)
        for at in rng.integers(0, len(content), 60):
            file.write_bytes(damaged(content, int(at), damage, rng))
            end = len(content) if damage == "cut off" else int(at) + 1
            hit = {turn for turn, (begin, until) in places.items() if begin < end and at < until}
            found = turns(path)
            assert set(found) >= {0.0, 0.1, 0.2, 0.3} - hit, (file.name, at)
            assert sorted(found) == found
            assert len(set(found)) == len(found)
            file.write_bytes(content)
    for file, content in whole.items():
        file.write_bytes(damaged(content, len(content) // 2, damage, rng))
    entry = write_in_place(path, accepted(0.4))
    assert read_history(path)[-1].id == entry.id
    assert roll_back(path).restored < entry.id


def entries_in(file: Path, content: bytes) -> dict[float, tuple[int, int]]:
    """Where the bytes of each entry lie, ends of line left out."""
    if file.suffix == ".gz":
        starts = [found.start() for found in re.finditer(b"\x1f\x8b\x08", content)] + [len(content)]
        pieces = [(begin, end, zlib.decompress(content[begin:end], 31)) for begin, end in pairwise(starts)]
    else:
        pieces = [(found.start(), found.end(), found[0]) for found in re.finditer(b"[^\n]+", content)]
    return {json.loads(text)["rig"]["evidence"]["turn"]: (begin, end) for begin, end, text in pieces}


def damaged(content: bytes, at: int, damage: str, rng: np.random.Generator) -> bytes:
    """One byte of it, or all from there on."""
    flipped = bytes([content[at] ^ int(rng.integers(1, 256))])
    return {
        "flipped": content[:at] + flipped + content[at + 1 :],
        "zeroed": content[:at] + b"\0" + content[at + 1 :],
        "cut": content[:at] + content[at + 1 :],
        "cut off": content[:at],
    }[damage]


@contextmanager
def small_parts() -> Generator[None]:
    """The file becomes a part after every second write."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("retrue.files.append_log.FULL_LOG", 1500)
        yield


def test_old_entries_move_into_compressed_parts_that_people_can_read(path):
    with small_parts():
        for number in range(1, 8):
            write_in_place(path, accepted(float(number)))
        assert turns(path) == [float(number) for number in range(8)]
        parts = sorted(parts_folder(history_path(path)).iterdir())
        assert parts[0].name == "000000001-000000003.jsonl.gz"
        text = gzip.decompress(parts[0].read_bytes()).decode()
        assert [json.loads(line)["id"] for line in text.splitlines()] == [1, 2, 3]
        assert [entry.id for entry in read_history(path, 3)] == [6, 7, 8]
        assert roll_back(path, 2).restored == 2
        assert read_rig(path).evidence == {"turn": 1.0}
        with pytest.raises(InputError, match="no earlier rig"):
            [roll_back(path) for _ in range(2)]


def test_a_history_that_is_lost_but_for_its_parts_goes_on_counting(path):
    with small_parts():
        for number in range(1, 4):
            write_in_place(path, accepted(float(number)))
        last = read_history(path)[-1].id
        history_path(path).unlink()
        assert write_in_place(path, accepted(9.0)).id > last - 2
        ids = [entry.id for entry in read_history(path)]
        assert ids == sorted(set(ids))


def test_a_kill_between_part_and_file_shows_no_entry_twice(path):
    for turn in (1.0, 2.0):
        write_in_place(path, accepted(turn))
    log = history_path(path)
    content = log.read_bytes()
    with small_parts():
        write_in_place(path, accepted(3.0))
        log.write_bytes(content)  # as it was before the file was emptied
        assert turns(path) == [0.0, 1.0, 2.0]
        write_in_place(path, accepted(4.0))
        assert turns(path) == [0.0, 1.0, 2.0, 3.0, 4.0]  # 3 stands in the rig file
        assert len(list(parts_folder(log).iterdir())) == 1


def test_lines_without_a_checksum_are_read(path):
    write_in_place(path, accepted(0.1))
    log = history_path(path)
    lines = [json.loads(line) for line in log.read_text().splitlines()]
    log.write_text("".join(json.dumps({key: line[key] for key in line if key != "crc32"}) + "\n" for line in lines))
    write_in_place(path, accepted(0.2))
    assert turns(path) == [0.0, 0.1, 0.2]


@pytest.mark.parametrize(
    "edit",
    [
        {"id": True},
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
def test_a_line_that_is_no_entry_is_told(path, edit):
    write_in_place(path, accepted(0.1))
    log = history_path(path)
    first, second = log.read_text().splitlines()
    document = json.loads(first) | edit
    del document["crc32"]
    log.write_text(json.dumps(document) + "\n" + second + "\n")
    history = read_history(path)
    assert [line.place for line in history.damaged] == ["line 1"]
    assert turns(path) == [0.1]


def test_a_pipe_is_refused_and_not_waited_for(path):
    os.mkfifo(history_path(path))
    for action in (lambda: read_history(path), lambda: write_in_place(path, accepted(0.1)), lambda: roll_back(path)):
        with pytest.raises(FileError, match="expected a file"):
            action()
    history_path(path).unlink()
    os.mkfifo(path.with_name("pipe.json"))
    with pytest.raises(FileError, match="expected a file"):
        write_in_place(path.with_name("pipe.json"), accepted(0.1))


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
        list(newest_first(log))
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
