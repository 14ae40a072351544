"""`retrue batch` through the front door."""

from __future__ import annotations

import pytest

from retrue import write_points

from .conftest import names, wall_and_box


@pytest.fixture
def job(files):
    """Three captures of a rig that had been bumped before the first."""
    (files.folder / "captures").mkdir()
    for number in range(3):
        write_points(files.folder / f"captures/{number}.csv", wall_and_box(seed=number))
    path = files.folder / "job.toml"
    path.write_text(
        'rig = "before.json"\ncaptures = "captures/*.csv"\ndo = ["recalibrate", "reconstruct"]\n'
        'out = "out"\nlens = "fixed"\n'
    )
    return path


def test_captures_become_clouds_and_a_page(retrue, files, job):
    page = files.folder / "page.html"
    run = retrue("batch", job, "--workers", "1", "--report", page)
    assert run.status == 0
    assert "3 captures, 3 good, 3 clouds" in run.out
    assert names(files.folder / "out/clouds") == ["0.csv.ply", "1.csv.ply", "2.csv.ply"]
    assert "<h1" in page.read_text()
    (rig,) = (files.folder / "out/rigs").iterdir()
    assert retrue("reconstruct", rig, files.folder / "captures/1.csv", "--out", files.folder / "one.ply").status == 0
    assert (files.folder / "one.ply").read_bytes() == (files.folder / "out/clouds/1.csv.ply").read_bytes()
    again = retrue("batch", job, "--json").json
    assert (again["tasks"], again["clouds"], again["jobs"][0]["captures"]) == (0, 3, 3)


def test_what_fails_is_told_and_stops_nothing(retrue, files, job):
    (files.folder / "captures/8.csv").write_text("rubbish")
    (files.folder / "captures/9.csv").write_text("rubbish")
    run = retrue("batch", job, "--workers", "1")
    assert run.status == 1
    assert "8.csv: expected a CSV" in run.err
    assert "2 failed" in run.out


def test_what_cannot_be_done(retrue, files, job):
    retrue("batch", files.folder / "none.toml").require_complaint("none.toml")
    retrue("batch", job, "--workers", "0").require_complaint("--workers")
    job.write_text(job.read_text().replace("before.json", "none.json"))
    retrue("batch", job, "--workers", "1").require_complaint("none.json")
    job.write_text(job.read_text() + 'pattern = "rig.json"\n')
    retrue("batch", job, "--workers", "1").require_complaint("json")


def test_what_was_measured_before_anybody_knew_is_made_again(retrue, files, job):
    retrue("rescan", job, "--workers", "1").require_complaint("no history")
    assert retrue("recalibrate", files.before, files.points, "--in-place", "--lens", "fixed").status == 0
    listed = retrue("rescan", job, "--workers", "1", "--list")
    assert listed.status == 1
    assert "3 of 3 captures" in listed.out
    assert max(map(len, listed.out.splitlines()[1:])) <= 80
    report = retrue("rescan", job, "--workers", "1", "--json").json
    assert [item["fits"] for item in report["jobs"][0]["stale"]] == [2, 2, 2]
    assert names(files.folder / "out/clouds") == ["0.csv.ply", "1.csv.ply", "2.csv.ply"]
    assert retrue("rescan", job, "--since", "2999-01-01", "--workers", "1").status == 0
    retrue("rescan", job, "--since", "soon").require_complaint("--since", "2026-11-24")
