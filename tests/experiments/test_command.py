"""`retrue experiment` writes what it prints, twice the same for the same seed."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from retrue.cli.main import main


def run(folder: Path, *arguments: str) -> int:
    return main(["experiment", *arguments, "--workers", "1", "--out", str(folder)])


def test_table_and_figure_are_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folders = tmp_path / "first", tmp_path / "second"
    for folder in folders:
        assert run(folder, "noise", "--trials", "2", "--seed", "5", "--json") == 0
        report = json.loads(capsys.readouterr().out)
        assert sorted(Path(path).name for path in report["files"]) == ["noise.csv", "noise.png", "noise.svg"]
    for name in ("noise.csv", "noise.svg"):
        first, second = ((folder / name).read_bytes() for folder in folders)
        assert first == second
    assert (folders[0] / "noise.csv").read_text().startswith("noise_px,method,rotation_mean")


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["real"], "--rig"),
        (["noise", "--trials", "0"], "at least 1"),
        (["other"], "other"),
        (["noise", "--ours-only"], "--ours-only"),
        (["light", "wall.csv"], "--rig"),
        (["noise", "wall.csv"], "no captures"),
    ],
)
def test_what_it_cannot_run_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], reason: str
) -> None:
    assert run(tmp_path, *arguments) == 2
    error = capsys.readouterr().err
    assert reason in error
    assert error.count("\n") == 1
