"""The page of speed is what its command writes, and the command's jobs answer."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture
def speed(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))  # its parts find each other as a script's do
    return import_module("speed")


def test_every_row_of_points_has_a_ratio(speed: ModuleType) -> None:
    found = list(speed.point_rows(1, speed.QUICK))
    assert len({row.what for row in found}) == 9
    assert all(0 < row.ratio < float("inf") for row in found)
    assert {line.count("|") for line in speed.table(found).splitlines()} == {7}


def test_a_ratio_is_the_median_of_those_of_the_turns(speed: ModuleType) -> None:
    (row,) = import_module("speed_rows").rows("job", [1.0, 2.0, 30.0], {"peer": [2.0, 1.0, 20.0]}, {}, {})
    assert (row.retrue_s, row.peer_s, row.ratio) == (2.0, 2.0, 1.5)


def test_writing_replaces_what_was_measured_and_no_more(speed: ModuleType) -> None:
    page = (ROOT / "docs" / "speed.md").read_text(encoding="utf-8")
    once = speed.with_measured(page, "new figures\n")
    assert once.startswith(page[: page.index("<!-- measured -->")])
    assert once.endswith(page[page.index("<!-- end of what was measured -->") :])
    assert once.count("new figures") == 1
    assert speed.with_measured(once, "new figures\n") == once


def test_a_goal_that_is_missed_says_so(speed: ModuleType) -> None:
    met, missed, unknown = (
        speed.Row("job", 1, "peer", 1, ratio, 2.0).cells()[-1] for ratio in (2.0, 2.1, float("nan"))
    )
    assert met == "at most 2"
    assert missed == unknown == "at most 2: **missed**"
