"""How the command line feels: what it says, where, and how much."""

import io
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import pytest

from retrue.cli.commands import EXAMPLES, command_kind
from retrue.cli.parsing import parse
from retrue.cli.terminal import GREEN, Terminal, colored, time_left
from retrue.errors import FileError

DEMO = Path(__file__).parents[2] / "src" / "retrue" / "demo_data"


class Screen(io.StringIO):
    """A terminal."""

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_command_has_an_example_that_parses(retrue, name):
    shown = retrue(name, "--help").out
    for example in EXAMPLES[name]:
        assert example in shown
        assert max(map(len, example.splitlines())) <= 78
        program, *words = shlex.split(example.replace("\\\n", "").partition(" > ")[0])
        assert program == "retrue"
        assert isinstance(parse(words), command_kind(name))


@pytest.mark.parametrize("name", EXAMPLES)
def test_help_tables_fit_80_columns(retrue, name, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    boxes = [line for line in retrue(name, "--help").out.splitlines() if line[:1] in "╭│╰"]
    assert boxes
    assert max(map(len, boxes)) <= 80
    assert all(any(option in line for line in boxes) for option in ("--json", "--quiet", "--verbose"))


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (["recalibrat", "rig.json"], "did you mean recalibrate?"),
        (["verfy"], "did you mean verify?"),
        (["xyzzy"], "retrue --help lists them"),
        ([], "retrue demo"),
        (["calibrate", "a"], "missing --board KIND:SIZE:LENGTH, --out PATH; retrue calibrate --help"),
        (["verify"], "missing RIG; "),
        (["verify", "rig.json", "a.csv", "--patern", "p.json"], "did you mean --pattern?"),
        (["recalibrate", "rig.json", "a.csv", "--max-point=7"], "did you mean --max-points?"),
        (["verify", "rig.json", "a.csv", "--xyzzy"], "retrue verify --help lists all"),
    ],
)
def test_a_slip_is_answered_with_what_was_meant(retrue, words, hint):
    retrue(*words).require_complaint(hint)


def test_quiet_says_nothing_and_the_status_tells(retrue, files):
    good, drifted = (retrue("verify", rig, files.points, "--quiet") for rig in (files.rig, files.before))
    assert (good.status, good.out, good.err) == (0, "", "")
    assert (drifted.status, drifted.out, drifted.err) == (1, "", "")
    assert retrue("verify", files.rig, files.points, "--quiet", "--json").json["verdict"] == "good"
    retrue("verify", "gone.json", files.points, "--quiet").require_complaint("gone.json")


def test_verbose_says_when(retrue, files):
    run = retrue("verify", files.rig, files.points, "--verbose")
    (line,) = run.err.splitlines()
    assert line.startswith("[")
    assert line.endswith(" s] " + f"{files.points}: 600 correspondences")


def test_color_only_on_a_terminal_that_wants_it(monkeypatch):
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    assert colored("good", GREEN, Screen()) == "\x1b[1;32mgood\x1b[0m"
    assert colored("good", GREEN, io.StringIO()) == "good"
    monkeypatch.setenv("NO_COLOR", "1")
    assert colored("good", GREEN, Screen()) == "good"
    monkeypatch.delenv("NO_COLOR")
    monkeypatch.setenv("TERM", "dumb")
    assert colored("good", GREEN, Screen()) == "good"


def test_no_color_holds_for_help_too(retrue, monkeypatch):
    class ColorfulOut(Screen):
        encoding = "utf-8"

    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    screen = ColorfulOut()
    monkeypatch.setattr("sys.stdout", screen)
    with pytest.raises(SystemExit):
        parse(["verify", "--help"])
    assert "usage: retrue verify" in screen.getvalue()
    assert "\x1b[" not in screen.getvalue()


def test_progress_tells_the_time_left_on_a_terminal_only(monkeypatch):
    for stream, shown in ((Screen(), True), (io.StringIO(), False)):
        monkeypatch.setattr("sys.stderr", stream)
        terminal = Terminal()
        monkeypatch.setattr("retrue.cli.terminal.time.perf_counter", iter([0.0, 30.0, 60.0]).__next__)
        show = terminal.progress("reading")
        show(1, 3)
        monkeypatch.undo()
        assert ("reading: 1 of 3, about 60 s left" in stream.getvalue()) == shown
    assert time_left(1.0, 3, 4) == ""


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_is_a_script_of_that_shell(retrue, shell):
    script = retrue("completion", shell).out
    assert "recalibrate" in script
    assert "--pattern" in script or "pattern" in script
    if shutil.which(shell):
        done = subprocess.run([shell, "-n"], input=script, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, "")


def test_experiment_tables_fit_80_columns(retrue, tmp_path):
    run = retrue("experiment", "noise", "--trials", 2, "--workers", 1, "--out", tmp_path)
    assert run.status == 0
    assert max(map(len, run.out.splitlines()[:-5])) <= 80


def test_a_fault_of_our_own_is_one_line_and_a_report(retrue, files, monkeypatch, tmp_path):
    def fails(*_: object) -> None:
        raise ZeroDivisionError("nobody foresaw it")

    monkeypatch.setattr("retrue.recalibration.verify.verify", fails)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    run = retrue("verify", files.rig, files.points)
    assert (run.status, run.out) == (70, "")
    (complaint,) = [line for line in run.err.splitlines() if line.startswith("retrue: ")]
    assert "ZeroDivisionError: nobody foresaw it" in complaint
    report = Path(complaint.split("send us ")[1])
    assert "Traceback" in report.read_text(encoding="utf-8")
    assert set(retrue("verify", files.rig, files.points, "--json").json) == {"error"}


def test_a_name_that_the_terminal_cannot_print_fails_nothing(files):
    folder = files.folder / "\u56fe\u7247"
    folder.mkdir()
    for path in (files.before, files.points):
        path.rename(folder / path.name)
    script = "import sys; from retrue.cli.main import main; sys.exit(main(sys.argv[1:]))"
    words = ["recalibrate", str(folder / "before.json"), str(folder / "points.csv"), "--in-place", "--lens", "fixed"]
    environment = {**os.environ, "PYTHONIOENCODING": "cp1252"}
    done = subprocess.run([sys.executable, "-c", script, *words], capture_output=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    assert rb"\u56fe\u7247" in done.stdout
    assert b"Traceback" not in done.stderr


@pytest.mark.parametrize(("share", "status"), [(1.0, 0), (0.5, 2)])
def test_opencv_adds_nothing_to_what_is_said_of_a_picture(tmp_path, share, status):
    """Of a TIFF of four channels it warns that no tag tells of the fourth; of one that is cut it writes five lines."""
    picture = cv2.imread(str(DEMO / "scene.jpg"))
    _, content = cv2.imencode(".tif", cv2.cvtColor(picture, cv2.COLOR_BGR2BGRA), [cv2.IMWRITE_TIFF_COMPRESSION, 1])
    path = tmp_path / "scene.tif"
    path.write_bytes(content[: int(share * len(content))].tobytes())
    words = ["decode", path, "--pattern", DEMO / "pattern.json", "--out", tmp_path / "points.csv", "--quiet"]
    script = "import sys; from retrue.cli.main import main; sys.exit(main(sys.argv[1:]))"
    done = subprocess.run([sys.executable, "-c", script, *words], capture_output=True, text=True, check=False)
    assert done.returncode == status
    assert len(done.stderr.splitlines()) == (status != 0)


def test_a_page_that_fails_changes_no_verdict(retrue, files, monkeypatch):
    def full(*_: object) -> None:
        raise FileError(files.folder / "page.html", "cannot be written: no space left on device")

    monkeypatch.setattr("retrue.pages.write_page", full)
    new, page = files.folder / "new.json", files.folder / "page.html"
    run = retrue("recalibrate", files.before, files.points, "--out", new, "--report", page)
    assert run.status == 0
    assert new.exists()
    assert run.out.endswith("page.html: no report\n")
    assert "no space left" in run.err
