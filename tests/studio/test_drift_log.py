"""What a watch saw lasts, whatever becomes of its file's last line."""

from __future__ import annotations

from pathlib import Path

import pytest

from retrue.errors import FileError
from retrue.studio.drawings import drift_plot
from retrue.studio.drift_log import REMEMBERED, DriftLog, Reading


def test_readings_and_the_switch_are_read_back(tmp_path: Path):
    log = DriftLog(tmp_path / "watch.jsonl")
    assert (log.on, list(log.readings)) == (False, [])
    readings = [Reading(1.0, "good", 0.1, 0.05), Reading(2.0, "unknown", None, None)]
    log.switch(True)
    for reading in readings:
        log.add(reading)
    again = DriftLog(tmp_path / "watch.jsonl")
    assert (again.on, list(again.readings)) == (True, readings)


def test_lines_that_are_torn_or_rubbish_are_passed_over_and_closed(tmp_path: Path):
    path = tmp_path / "watch.jsonl"
    good = '{"at": 1.0, "verdict": "good", "drift": 0.5, "sigma": null}'
    rubbish = [
        "[]",
        "3",
        '{"at": NaN, "verdict": "good", "drift": 1, "sigma": 1}',
        '{"at": 1}',
        "\x00",
        '{"verdict": "x"}',
    ]
    path.write_text("\n".join([*rubbish, good, good[:20]]))
    log = DriftLog(path)
    assert list(log.readings) == [Reading(1.0, "good", 0.5, None)]
    log.add(Reading(2.0, "drifted", 3.0, 1.0))
    assert list(DriftLog(path).readings) == [Reading(1.0, "good", 0.5, None), Reading(2.0, "drifted", 3.0, 1.0)]


def test_a_file_of_any_length_is_read_from_its_end(tmp_path: Path):
    log = DriftLog(tmp_path / "watch.jsonl")
    line = '{"at": %d.0, "verdict": "good", "drift": 0.5, "sigma": 0.1}\n'
    (tmp_path / "watch.jsonl").write_text("".join(line % number for number in range(20_000)))
    log = DriftLog(tmp_path / "watch.jsonl")
    assert [reading.at for reading in log.readings] == list(range(20_000 - REMEMBERED, 20_000))


def test_a_folder_in_its_place_is_named(tmp_path: Path):
    (tmp_path / "watch.jsonl").mkdir()
    with pytest.raises(FileError, match=r"watch\.jsonl: cannot be read"):
        DriftLog(tmp_path / "watch.jsonl")


def test_the_plot_holds_every_reading_and_nothing_that_is_not_finite():
    readings = [Reading(1e9 + 5 * k, "good", 0.01 * k, 0.1) for k in range(10)]
    plot = drift_plot(
        [*readings, Reading(1e9 + 60, "unknown", None, None), Reading(1e9 + 65, "drifted", 4.0, 0.1)], "mm"
    )
    assert plot.count("<circle") == 12
    assert "4.51 mm" in plot
    for few in ([], [Reading(1e9, "good", 0.0, 0.0)], [Reading(1e9, "unknown", None, None)]):
        assert "nan" not in drift_plot(few, "mm")
