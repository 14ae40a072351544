"""A rig that turns out to have moved before: which clouds are wrong, by how much, and made again."""

from __future__ import annotations

import os
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from retrue import Accepted, Evidence, read_points, reconstruct, write_cloud, write_in_place, write_points, write_rig
from retrue.batch.job import read_jobs
from retrue.batch.rescan import Stale, rescan
from retrue.errors import InputError
from retrue.rig_difference import rig_difference
from tests.watch.stream import RIG, seen_by, turned

from .test_batch import Serial

MOVED = turned(RIG, (1, 0, 0))
NOW = datetime.now(UTC)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Ten captures an hour apart, the last an hour ago; the rig moved at the fifth, and was recalibrated just now."""
    write_rig(tmp_path / "rig.json", RIG)
    (tmp_path / "captures").mkdir()
    for number in range(10):
        path = tmp_path / f"captures/{number}.csv"
        write_points(path, seen_by(RIG if number < 5 else MOVED, number, 5 if number == 7 else 400))
        taken(path, 10 - number)
    (tmp_path / "job.toml").write_text('rig = "rig.json"\ncaptures = "captures/*.csv"\ndo = "verify"\nout = "out"\n')
    return tmp_path


def taken(path: Path, hours_ago: float) -> None:
    time = (NOW - timedelta(hours=hours_ago)).timestamp()
    os.utime(path, (time, time))


def found(folder: Path, since: datetime | None = None, clouds: bool = True) -> list[Stale]:
    (job,) = read_jobs(folder / "job.toml")
    return rescan(job, since, Serial(), lambda *_: None, clouds=clouds)[0]


def test_what_was_taken_after_the_rig_moved_is_made_again(folder):
    write_in_place(folder / "rig.json", Accepted(MOVED, "found", Evidence(1)))
    stale = found(folder)
    assert [item.name for item in stale] == [f"{number}.csv" for number in range(5, 10)]
    assert [item.inferred for item in stale] == [False, False, True, False, False]
    assert {(item.made_with, item.fits) for item in stale} == {(1, 2)}
    expected = rig_difference(MOVED, RIG, 1.6).displacement
    assert all(item.off == pytest.approx(expected, rel=0.3) for item in stale)
    for item in stale:
        write_cloud(folder / "one.ply", reconstruct(MOVED, read_points(folder / "captures" / item.name)))
        assert item.cloud.read_bytes() == (folder / "one.ply").read_bytes()
    table = (folder / "out/rescan.csv").read_text().splitlines()
    assert len(table) == 6
    assert [item.name for item in found(folder, NOW - timedelta(hours=2.5))] == ["8.csv", "9.csv"]


def test_a_list_makes_no_cloud(folder):
    write_in_place(folder / "rig.json", Accepted(MOVED, "found", Evidence(1)))
    assert all(item.cloud is None and item.off > 0 for item in found(folder, clouds=False))
    assert not (folder / "out/clouds").exists()


def test_a_capture_that_no_rig_fits_is_told(folder):
    write_points(folder / "captures/9.csv", seen_by(turned(RIG, (0, 3, 0)), 9))
    taken(folder / "captures/9.csv", 1)
    write_in_place(folder / "rig.json", Accepted(MOVED, "found", Evidence(1)))
    last = found(folder)[-1]
    assert (last.name, last.fits, last.cloud) == ("9.csv", None, None)
    assert "no later one fits" in last.failed


def test_captures_since_the_new_rig_are_measured_with_it(folder):
    write_in_place(folder / "rig.json", Accepted(MOVED, "found", Evidence(1)))
    write_points(folder / "captures/new.csv", seen_by(MOVED, 99))
    taken(folder / "captures/new.csv", -1)
    assert "new.csv" not in [item.name for item in found(folder)]


def test_a_rig_without_a_history_is_told(folder):
    with pytest.raises(InputError, match="no history"):
        found(folder)
