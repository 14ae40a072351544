"""`retrue capture`: from a setup to a folder that the other commands read."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import retrue
from retrue.cli.main import main
from retrue.devices.options import SimulatedOptions
from retrue.devices.simulated_rig import default_rig
from retrue.errors import FileError
from retrue.files.capture_folder import write_capture

SETUP = 'rig = "rig.json"\n[camera]\ndriver = "simulated"\nscene = "clutter"\n[projector]\ndriver = "simulated"\n'


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("rig")
    (folder / "setup.toml").write_text(SETUP)
    retrue.write_rig(folder / "rig.json", default_rig(SimulatedOptions()))
    retrue.write_pattern(folder / "grid.json", retrue.make_color_grid((1024, 768)))
    retrue.write_pattern(folder / "gray.json", retrue.GrayCode((1024, 768), step=16))
    return folder


def words(folder: Path, pattern: str, out: str, *more: str) -> list[str]:
    files = ["--pattern", str(folder / pattern), "--out", str(folder / out)]
    return ["capture", str(folder / "setup.toml"), *files, *more]


def test_a_grid_with_white_and_black_around_it(folder: Path, capsys: pytest.CaptureFixture[str]):
    assert main(words(folder, "grid.json", "wall", "--json")) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["pictures"] == 3
    assert {path.name for path in (folder / "wall").iterdir()} == {"grid.png", "white.png", "black.png"}
    white, black = (retrue.read_image(folder / "wall" / name).astype(float) for name in ("white.png", "black.png"))
    assert (white >= 250).mean() < 0.01
    assert np.percentile(white, 95) > 120
    assert np.percentile(black, 95) < 20
    assert main(["verify", str(folder / "rig.json"), str(folder / "wall"), "--pattern", str(folder / "grid.json")]) == 0
    assert capsys.readouterr().out.startswith("holds")


def test_a_sequence_in_its_order(folder: Path, capsys: pytest.CaptureFixture[str]):
    assert main(words(folder, "gray.json", "gray", "--quiet")) == 0
    pattern = retrue.read_pattern(folder / "gray.json")
    names = [f"{number:02d}.png" for number in range(len(pattern.render()))]
    assert sorted(path.name for path in (folder / "gray").iterdir()) == names
    points = retrue.read_capture(folder / "gray", pattern)
    assert len(points) > 10_000
    assert retrue.verify(retrue.read_rig(folder / "rig.json"), [points]).verdict == "good"


def test_what_is_there_already_is_never_written_over(folder: Path, capsys: pytest.CaptureFixture[str]):
    (folder / "mine").mkdir()
    (folder / "mine" / "notes.txt").write_text("mine")
    assert main(words(folder, "grid.json", "mine")) == 2
    assert "mine: is not empty: a capture is written into a folder of its own" in capsys.readouterr().err
    assert [path.name for path in (folder / "mine").iterdir()] == ["notes.txt"]


def test_a_pattern_for_another_projector_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]):
    retrue.write_pattern(folder / "other.json", retrue.GrayCode((800, 600)))
    assert main(words(folder, "other.json", "never")) == 2
    assert "is made for 800 x 600 pixels, but simulated projector has 1024 x 768" in capsys.readouterr().err
    assert not (folder / "never").exists()


def test_a_full_disk_is_waited_for(folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch):
    from retrue.files import capture_folder

    left = [2]

    def full(path: Path, image: np.ndarray) -> None:
        if left[0] > 0:
            left[0] -= 1
            raise FileError(path, "cannot be written: No space left on device")
        retrue.write_png(path, image)

    monkeypatch.setattr(capture_folder, "write_png", full)
    monkeypatch.setattr("retrue.cli.capture.PAUSE", 0.0)
    assert main(words(folder, "grid.json", "later")) == 0
    said = capsys.readouterr().err
    assert said.count("No space left on device; trying again") == 1
    assert len(list((folder / "later").iterdir())) == 3
    assert not list(folder.glob(".*.part"))


def test_a_capture_is_there_whole_or_not_at_all(tmp_path: Path):
    picture = np.zeros((4, 4), np.uint8)
    with pytest.raises(retrue.InputError):
        write_capture(tmp_path / "new", {"0": picture, "1": picture.astype(float)})
    assert list(tmp_path.iterdir()) == []
    write_capture(tmp_path / "new", {"0": picture, "1": picture})
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == ["0.png", "1.png"]


def test_a_grid_s_folder_must_hold_all_three_alike(tmp_path: Path):
    pattern = retrue.make_color_grid((1024, 768))
    picture = np.zeros((40, 60, 3), np.uint8)
    write_capture(tmp_path / "short", {"grid": picture, "white": picture})
    with pytest.raises(retrue.CaptureError, match=r"short: the pattern is a colour grid, .* black.png is missing"):
        retrue.read_capture(tmp_path / "short", pattern)
    write_capture(tmp_path / "odd", {"grid": picture, "white": picture[1:], "black": picture})
    with pytest.raises(retrue.CaptureError, match=r"white.png is not of the size and kind of grid.png"):
        retrue.read_capture(tmp_path / "odd", pattern)
