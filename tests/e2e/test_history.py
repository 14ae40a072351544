"""In-place recalibration, and the way back, through the front door."""

import hashlib

import numpy as np
import pytest

from retrue import read_rig
from retrue.files.history import history_path, read_history
from retrue.geometry.transform import rotation_angle

from .conftest import TRUE, names


def in_place(retrue, files):
    run = retrue("recalibrate", files.before, files.points, "--in-place", "--lens", "fixed", "--json")
    assert run.status == 0
    return run.json


def test_in_place_writes_the_rig_and_keeps_the_old_one(retrue, files):
    old = read_rig(files.before)
    report = in_place(retrue, files)
    assert report["history_id"] == 2
    new = read_rig(files.before)
    assert np.degrees(rotation_angle(new.projector_from_camera.R @ TRUE.R.T)) < 0.1
    found, entry = read_history(files.before)
    assert np.array_equal(found.rig.projector_from_camera.R, old.projector_from_camera.R)
    assert entry.evidence["change"]["rotation_deg"] == pytest.approx(5, abs=0.1)
    digest = hashlib.sha256(files.points.read_bytes()).hexdigest()
    assert entry.captures == ({"name": "points.csv", "sha256": digest},)
    assert names(files.folder) == ["before.json", "before.json.history.jsonl", "points.csv", "rig.json"]


def test_a_refusal_never_overwrites(retrue, files):
    files.points.write_text("".join(files.points.read_text().splitlines(keepends=True)[:5]))
    before = files.before.read_bytes()
    assert retrue("recalibrate", files.before, files.points, "--in-place", "--lens", "fixed").status == 1
    assert files.before.read_bytes() == before
    assert names(files.folder) == ["before.json", "points.csv", "rig.json"]


def test_in_place_needs_a_word_where_nothing_checks_the_lenses(retrue, files):
    before = files.before.read_bytes()
    run = retrue("recalibrate", files.before, files.points, "--in-place", "--json")
    assert (run.status, run.json["verdict"], run.json["cause"]) == (1, "refused", "LensUnchecked")
    assert run.json["projector_from_camera"] is None
    assert "--lens fixed" in run.json["reason"]
    assert files.before.read_bytes() == before
    assert names(files.folder) == ["before.json", "points.csv", "rig.json"]


def test_a_rig_that_holds_is_left_alone(retrue, files):
    before = files.rig.read_bytes()
    run = retrue("recalibrate", files.rig, files.points, "--in-place")
    assert run.status == 0
    assert run.out.startswith("unchanged, if nobody touched the lenses: ")
    assert "nothing was written" in run.out
    assert files.rig.read_bytes() == before
    assert names(files.folder) == ["before.json", "points.csv", "rig.json"]
    new = files.folder / "new.json"
    assert retrue("recalibrate", files.rig, files.points, "--out", new, "--json").json["verdict"] == "unchanged"
    assert np.array_equal(read_rig(new).projector_from_camera.R, read_rig(files.rig).projector_from_camera.R)


@pytest.mark.parametrize("out", [[], ["--in-place", "--out", "new.json"]])
def test_one_of_out_and_in_place(retrue, files, out):
    run = retrue("recalibrate", files.before, files.points, *out)
    run.require_complaint("--out NEW.json", "--in-place")


def test_history_is_a_table_of_eighty_columns(retrue, files):
    in_place(retrue, files)
    assert retrue("rollback", files.before).status == 0
    run = retrue("history", files.before)
    lines = run.out.splitlines()
    assert max(map(len, lines)) <= 80
    assert [line[:1] for line in lines[1:4]] == [" ", " ", "*"]
    assert [line[27:44].strip() for line in lines[1:4]] == ["found", "recalibrated", "rolled back to 1"]
    report = retrue("history", files.before, "--json").json
    assert report["in_place"] == 3
    assert [entry["id"] for entry in report["entries"]] == [1, 2, 3]
    assert report["entries"][0]["change"] is None
    assert report["entries"][1]["change"]["rotation_deg"] == pytest.approx(5, abs=0.1)


def test_history_draws_the_drift(retrue, files):
    in_place(retrue, files)
    plot = files.folder / "drift.png"
    assert retrue("history", files.before, "--plot", plot).status == 0
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_history_where_there_is_none(retrue, files):
    retrue("history", files.before).require_complaint("before.json", "--in-place")


def test_rollback_to_an_entry_and_to_none(retrue, files):
    before = files.before.read_bytes()
    in_place(retrue, files)
    after = files.before.read_bytes()
    assert retrue("rollback", files.before, "1", "--json").json["restored"] == 1
    assert files.before.read_bytes() == before
    assert retrue("rollback", files.before, "2").status == 0
    assert files.before.read_bytes() == after
    retrue("rollback", files.before, "9").require_complaint("found 9", "1 to 4")
    retrue("rollback", files.rig).require_complaint("no earlier rig")


def test_diff_says_what_the_drift_does_at_the_working_distance(retrue, files):
    bare = retrue("diff", files.before, files.rig)
    assert "--working-distance" in bare.out
    report = retrue("diff", files.before, files.rig, "--working-distance", "2000", "--json").json
    assert report["rotation_deg"] == pytest.approx(5, abs=1e-6)
    assert report["displacement"] > 50
    in_place(retrue, files)
    told = retrue("diff", files.before, files.rig, "--json").json
    assert 1500 < told["working_distance"] < 2500
    assert told["displacement"] < 2
    retrue("diff", files.before, files.rig, "--working-distance", "-1").require_complaint("positive length")


def test_a_damaged_history_is_told_and_closes_nothing(retrue, files):
    in_place(retrue, files)
    history = history_path(files.before)
    history.write_bytes(history.read_bytes() + b"\0\0\n")
    run = retrue("history", files.before)
    assert run.status == 0
    assert "line 3" in run.err
    assert [line["place"] for line in retrue("history", files.before, "--json").json["damaged"]] == ["line 3"]
    rolled = retrue("rollback", files.before, "--json")
    assert rolled.json["restored"] == 1
    assert "line 3" in rolled.err


def test_only_the_last_entries(retrue, files):
    in_place(retrue, files)
    run = retrue("history", files.before, "--last", "1")
    assert "entries before 2 are not shown" in run.out
    assert [entry["id"] for entry in retrue("history", files.before, "--last", "1", "--json").json["entries"]] == [2]
    retrue("history", files.before, "--last", "0").require_complaint("--last")
