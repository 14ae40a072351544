"""Many captures: the rig is followed through time, nothing is done twice, and nothing that fails stops the rest."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from retrue import Accepted, Correspondences, Evidence, read_rig, reconstruct, write_cloud, write_points, write_rig
from retrue.batch.batch import Row, run_batch
from retrue.batch.job import read_jobs
from retrue.batch.ledger import opened_ledger
from retrue.batch.summary import counts, write_summary
from retrue.batch.tasks import Look
from retrue.errors import FileError
from retrue.recalibration.reasons import LensUnchecked
from tests.watch.stream import RIG, seen_by, turned

JOB = 'lens = "fixed"\nrig = "rig.json"\ncaptures = "captures/*"\nout = "out"\ndo = {do}\n'
ALL = '["verify", "recalibrate", "reconstruct"]'


@dataclass
class Serial:
    """Runs tasks one after the other, and remembers which; `die` ends the run as a kill would."""

    ran: list[Any] = field(default_factory=list)
    die: int = 10**9

    def run(self, work: Callable[[Any], dict[str, Any]], tasks: Iterable[Any]):
        for task in tasks:
            self.ran.append(task)
            if len(self.ran) > self.die:
                raise KeyboardInterrupt
            yield task, work(task)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A rig that is bumped at the sixth capture; the third is rubbish, the eighth is dark."""
    write_rig(tmp_path / "rig.json", RIG)
    (tmp_path / "captures").mkdir()
    for number in range(12):
        moved = turned(RIG, (1, 0, 0)) if number >= 5 else RIG
        write_points(tmp_path / f"captures/{number}.csv", seen_by(moved, number, 5 if number == 7 else 400))
    (tmp_path / "captures/2.csv").write_text("rubbish")
    (tmp_path / "captures/notes.txt").write_text("stray")
    return tmp_path


def run(folder: Path, do: str = ALL, runner: Serial | None = None, more: str = "") -> tuple[list[Row], list[Any]]:
    (folder / "job.toml").write_text(JOB.format(do=do) + more)
    runner = runner or Serial()
    (job,) = read_jobs(folder / "job.toml")
    rows, _ = run_batch(job, runner, lambda *_: None)
    write_summary(job.out, rows)
    return rows, runner.ran


def files_in(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*.ply")}


def test_the_rig_is_followed_and_each_cloud_made_with_the_one_that_held(folder):
    rows, _ = run(folder)
    assert [row.name for row in rows] == [f"{number}.csv" for number in range(12)]
    assert [row.rig == folder / "rig.json" for row in rows] == [True] * 5 + [False] * 7
    verdicts = [row.result.get("verdict") for row in rows]
    assert verdicts == ["good", "good", None, "good", "good", "good", "good", "unknown", *["good"] * 4]
    assert [row.name for row in rows if row.failed] == ["2.csv"]
    assert counts(rows) == {"captures": 12, "good": 10, "drifted": 0, "unknown": 1, "clouds": 11, "failed": 1}
    for row in (rows[0], rows[5], rows[11]):
        write_cloud(folder / "single.ply", reconstruct(read_rig(row.rig), seen(folder, row.name)))
        assert (folder / "single.ply").read_bytes() == (folder / f"out/clouds/{row.name}.ply").read_bytes()
    said = json.loads((folder / "out/verify/5.csv.json").read_text())
    assert said["verdict"] == "good"
    table = (folder / "out/summary.csv").read_text().splitlines()
    assert len(table) == 13
    assert table[3].startswith("2.csv,,")
    assert "camera_x" in table[3]


def seen(folder: Path, name: str) -> Correspondences:
    from retrue import read_points

    return read_points(folder / "captures" / name)


def test_what_is_done_is_not_done_again_and_what_changed_is(folder):
    first, ran = run(folder)
    assert len(ran) > 0
    again, ran = run(folder)
    assert ran == []
    assert again == first
    write_points(folder / "captures/9.csv", seen_by(turned(RIG, (1, 0, 0)), 99))
    (folder / "out/clouds/4.csv.ply").unlink()
    _, ran = run(folder)
    assert {task.name for task in ran if isinstance(task, Look)} == {"9.csv", "4.csv"}
    assert run(folder)[1] == []


def test_where_nothing_is_to_be_done_nothing_is_imported_to_do_it(folder):
    run(folder)
    code = "import sys\nfrom retrue.cli.main import main\nmain(sys.argv[1:])\n"
    code += "print(*sorted({'numpy', 'cv2', 'scipy'} & set(sys.modules)), len(sys.modules))"
    command = [sys.executable, "-c", code, "batch", str(folder / "job.toml"), "--json"]
    report, loaded = subprocess.run(command, stdout=subprocess.PIPE, check=True, text=True).stdout.splitlines()
    assert json.loads(report)["tasks"] == 0
    assert loaded.isdecimal()


@pytest.mark.parametrize("at", range(0, 4000, 161))
@pytest.mark.parametrize("kind", ["flipped", "cut out", "cut off"])
def test_a_damaged_byte_of_what_is_done_costs_its_own_line(folder, at, kind):
    path = folder / "results.jsonl"
    with opened_ledger(folder) as ledger:
        for number in range(12):
            ledger.write(f"{number}.csv", "context", [number, 0.5], [folder / f"{number}.ply"], {"points": number})
    content = path.read_bytes()
    at %= len(content)
    between = {"flipped": bytes([content[at] ^ 0x55])}.get(kind, b"")
    path.write_bytes(content[:at] + between + (b"" if kind == "cut off" else content[at + 1 :]))
    with opened_ledger(folder) as ledger:
        kept = {name: entry["result"] for (name, _), entry in ledger.known.items()}
        ledger.write("new.csv", "context", [1], [], {"points": 99})
    hit = content[at:].count(b"\n") if kind == "cut off" else 1
    assert len(kept) >= 12 - hit
    assert all(kept[name] == {"points": int(name.removesuffix(".csv"))} for name in kept)
    with opened_ledger(folder) as ledger:
        assert ledger.known["new.csv", "context"]["result"] == {"points": 99}
        assert len(ledger.known) == len(kept) + 1


def test_what_a_full_disk_kept_from_being_done_is_tried_again(folder):
    def full(path: Path, points: Correspondences) -> None:
        raise FileError(path, "cannot be written: No space left on device") from OSError(28, "No space left on device")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("retrue.batch.worker.keep_points", full)
        rows, _ = run(folder)
        assert "No space left" in rows[4].failed
    rows, ran = run(folder)
    assert {task.name for task in ran if isinstance(task, Look)} == {f"{number}.csv" for number in range(12)} - {
        "2.csv"
    }
    assert [row.name for row in rows if row.failed] == ["2.csv"]


@pytest.mark.parametrize("content", [b"", b"rubbish", None])
def test_decoded_points_that_are_damaged_are_decoded_again(folder, content):
    whole, _ = run(folder)
    for path in (folder / "out/points").iterdir():
        path.write_bytes(path.read_bytes()[:-40] if content is None else content)
    for path in (folder / "out/clouds").iterdir():
        path.unlink()
    assert run(folder)[0] == whole
    (folder / "rig.json").write_text((folder / "rig.json").read_text() + "\n")  # another file: all anew, and a new rig
    for path in (folder / "out/points").glob("[567].*"):
        path.write_bytes(b"rubbish")
    run(folder)
    assert [row.result for row in run(folder)[0]] == [row.result for row in whole]


@pytest.mark.parametrize("die", [1, 5, 13, 20, 24])
def test_it_goes_on_where_it_was_stopped(folder, die):
    whole, ran = run(folder)
    expected = files_in(folder / "out")
    (folder / "out").rename(folder / "whole")
    with pytest.raises(KeyboardInterrupt):
        run(folder, runner=Serial(die=die))
    ledger = folder / "out/results.jsonl"
    ledger.write_bytes(ledger.read_bytes() + b'{"id": 3, "name": "to')  # torn
    rows, rest = run(folder)
    assert len(rest) == len(ran) - die
    assert rows == whole
    assert files_in(folder / "out") == expected


def test_without_recalibration_every_capture_stands_alone(folder):
    rows, ran = run(folder, '["verify", "reconstruct"]')
    assert len(ran) == 12
    assert [row.result.get("verdict") for row in rows][4:7] == ["good", "drifted", "drifted"]
    assert all("points" in row.result for row in rows if not row.failed)
    only, _ = run(folder, '"reconstruct"')
    assert all("verdict" not in row.result for row in only)


def test_clouds_of_another_rig_do_not_stay(folder):
    run(folder, '"reconstruct"')
    before = files_in(folder / "out")
    write_rig(folder / "rig.json", turned(RIG, (0, 0.5, 0)))
    run(folder, '"reconstruct"')
    assert files_in(folder / "out") != before
    write_rig(folder / "rig.json", RIG)
    assert len(run(folder, '"reconstruct"')[1]) == 11  # the one that failed fails whatever the rig
    assert files_in(folder / "out") == before


def test_no_cloud_is_made_with_a_rig_that_does_not_hold(folder):
    for number in (10, 11):
        write_points(folder / f"captures/{number}.csv", seen_by(turned(RIG, (1 + number, 0, 0)), number))
    rows, _ = run(folder)
    assert [row.name for row in rows if "had moved" in row.failed] == ["10.csv", "11.csv"]
    assert not (folder / "out/clouds/11.csv.ply").exists()


def test_no_rig_is_made_whose_lenses_nothing_checks_without_a_word(folder):
    (folder / "job.toml").write_text(JOB.format(do=ALL).replace('lens = "fixed"\n', ""))
    (job,) = read_jobs(folder / "job.toml")
    rows, _ = run_batch(job, Serial(), lambda *_: None)
    assert not (folder / "out/rigs").exists()
    moved = [row.failed for row in rows if "had moved" in row.failed]
    assert len(moved) == 6
    assert str(LensUnchecked()) in moved[0]


def test_captures_that_together_hold_give_no_rig(folder, monkeypatch):
    monkeypatch.setattr(
        "retrue.batch.worker.recalibrate",
        lambda rig, captures, options: Accepted(rig, "it holds", Evidence(0), unchanged=True),
    )
    rows, _ = run(folder)
    assert not (folder / "out/rigs").exists()
    assert "still holds" in next(row.failed for row in rows if "had moved" in row.failed)


def test_limits_reach_the_methods(folder):
    rows, _ = run(folder, more="[limits.streak]\ndrifted_frames = 8\n")
    assert sum("had moved" in row.failed for row in rows) == 6


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("rig = 3", "captures"),
        ("[", "TOML"),
        ("job = 3", "[[job]]"),
        (JOB.format(do='["eat"]'), "do"),
        (JOB.format(do="[]"), "do"),
        (JOB.format(do="[3]"), "do"),
        (JOB.format(do='"verify"') + 'order = "size"', "order"),
        (JOB.format(do='"verify"') + "colour = 3", "colour"),
        (JOB.format(do='"verify"').replace("fixed", "glued"), "lens"),
        (JOB.format(do='"verify"') + "[limits.verify]\nnonsense = 3", "limits.verify"),
        (JOB.format(do='"verify"') + "[limits.streak]\ndrifted_frames = 0", "limits.streak"),
        (JOB.format(do='"verify"') + "[limits]\nverify = 3", "limits"),
        (JOB.format(do='"verify"').replace("captures/*", "none/*"), "captures"),
        ("[[job]]\n" + JOB.format(do='"verify"') + "[[job]]\n" + JOB.format(do='"verify"'), "out"),
    ],
)
def test_a_job_that_makes_no_sense_is_named(folder, text, said):
    path = folder / "job.toml"
    path.write_text(text)
    with pytest.raises(FileError, match=r"job\.toml") as caught:
        read_jobs(path)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_captures_come_by_number_or_by_time(folder):
    (folder / "captures/10.csv").touch()
    (folder / "job.toml").write_text(JOB.format(do='"verify"'))
    (job,) = read_jobs(folder / "job.toml")
    assert job.names[-2:] == ("10.csv", "11.csv")
    (folder / "job.toml").write_text(JOB.format(do='"verify"') + 'order = "time"')
    (job,) = read_jobs(folder / "job.toml")
    assert job.names[-1] == "10.csv"


def test_captures_in_an_object_store_give_what_those_on_the_disk_give(folder):
    fsspec = pytest.importorskip("fsspec")
    store = fsspec.filesystem("memory")
    store.put(str(folder / "captures"), "/bucket/captures", recursive=True)
    expected = [(row.name, row.failed, row.result) for row in run(folder)[0]]
    clouds = {path.name: path.read_bytes() for path in (folder / "out/clouds").iterdir()}
    where = JOB.replace('"captures/*"', '"memory://bucket/captures/*"').replace('"out"', '"stored"').format(do=ALL)
    (folder / "job.toml").write_text(where)
    for again in (False, True):
        (job,) = read_jobs(folder / "job.toml")
        runner = Serial()
        stored, _ = run_batch(job, runner, lambda *_: None)
        assert (runner.ran == []) == again
        assert [(row.name, row.failed, row.result) for row in stored] == expected
    assert {path.name: path.read_bytes() for path in (folder / "stored/clouds").iterdir()} == clouds
    store.rm("/bucket", recursive=True)
    with pytest.raises(FileError, match="captures: expected pictures"):
        read_jobs(folder / "job.toml")


@pytest.mark.parametrize("key", ["rig", "out"])
def test_only_captures_may_lie_in_a_store(folder, key):
    (folder / "job.toml").write_text(JOB.format(do='"verify"').replace(f'{key} = "', f'{key} = "memory://'))
    with pytest.raises(FileError, match=f"{key}: expected a path on this disk"):
        read_jobs(folder / "job.toml")
