"""Whole processes: what a command costs from its start to its end, imports included."""

from __future__ import annotations

import compileall
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from speed_rows import Row, rows

import retrue

RETRUE = [sys.executable, "-c", "import sys; from retrue.cli.main import main; sys.exit(main())"]  # as its script does
READING = "import sys, cv2, numpy, scipy.linalg; cv2.imread(sys.argv[1])"


@dataclass(frozen=True)
class Cost:
    """Seconds of one process, of processors and by the clock; or a ratio of each, None where nothing is asked."""

    processor: float
    clock: float | None


def process_rows(renders: Path, scratch: Path, rounds: int) -> Iterator[Row]:
    picture, rig, pattern = renders / "wall_0.png", renders / "wall_0.rig.json", renders / "pattern.json"
    libraries, nothing = "Python: import NumPy, OpenCV, scipy.linalg, read the PNG", "Python, nothing"
    yield from processes(
        "`retrue recalibrate rig.json wall_0.png`",
        command("recalibrate", rig, picture, "--pattern", pattern, "--out", scratch / "new.json"),
        libraries,
        [sys.executable, "-c", READING, str(picture)],
        rounds,
        goal=Cost(1.8, 1.8),
    )
    empty = [sys.executable, "-c", "pass"]
    yield from processes("`retrue --help`", command("--help"), nothing, empty, rounds, before=Cost(25.0, 25.4))
    importing = [sys.executable, "-c", "import retrue"]
    yield from processes("`import retrue`", importing, nothing, empty, rounds, before=Cost(2.2, 2.4))
    yield from first_runs(command("decode", picture, "--pattern", pattern, "--out", scratch / "p.csv"), scratch, rounds)


def command(*words: str | Path) -> list[str]:
    return [*RETRUE, *map(str, words)]


def processes(
    what: str,
    ours: Sequence[str],
    peer: str,
    theirs: Sequence[str],
    rounds: int,
    goal: Cost | None = None,
    before: Cost | None = None,
) -> Iterator[Row]:
    """A row of processor time and one of the clock, after one run of each that fills the disk's cache."""
    for job in (ours, theirs):
        run(job)
    yield from cost_rows(what, peer, [(run(ours), run(theirs)) for _ in range(rounds)], goal, before)


def first_runs(job: Sequence[str], scratch: Path, rounds: int) -> Iterator[Row]:
    """The first run of a copy of the package that has never run, beside its second: nothing may be left to compile."""
    installed = scratch / "installed" / "retrue"
    shutil.copytree(Path(retrue.__file__).parent, installed, ignore=shutil.ignore_patterns("__pycache__"))
    compileall.compile_dir(installed, quiet=1)  # as installers do
    turns: list[tuple[Cost, Cost]] = []
    for turn in range(rounds):
        copy = scratch / f"copy{turn}"
        shutil.copytree(installed, copy / "retrue")
        home = {"HOME": str(copy), "XDG_CACHE_HOME": str(copy / "cache"), "PYTHONPATH": _first_on_path(copy)}
        turns.append((run(job, home), run(job, home)))
        shutil.rmtree(copy)
    goal = Cost(processor=1.1, clock=None)
    yield from cost_rows("`retrue decode wall_0.png`, first run", "its second run", turns, goal)


def cost_rows(
    what: str, peer: str, turns: Sequence[tuple[Cost, Cost]], goal: Cost | None = None, before: Cost | None = None
) -> Iterator[Row]:
    """Of our cost and that of the peer, in each turn."""
    for kind, title in (("processor", "processor time"), ("clock", "clock")):
        ours, theirs = zip(*((getattr(own, kind), getattr(other, kind)) for own, other in turns), strict=True)
        limits = ({peer: ratio} if (ratio := getattr(cost, kind, None)) else {} for cost in (goal, before))
        yield from rows(f"{what}, {title}", ours, {peer: theirs}, *limits)


def run(job: Sequence[str], environment: Mapping[str, str] | None = None) -> Cost:
    """What one process costs; it must succeed. Bytecode is kept, as everywhere but where somebody forbids it."""
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    start = time.perf_counter()
    process = subprocess.Popen(
        job, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env={**kept, **(environment or {})}
    )
    _, status, usage = os.wait4(process.pid, 0)
    clock = time.perf_counter() - start
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise SystemExit(f"exit status {process.returncode}: {' '.join(job)}")
    return Cost(usage.ru_utime + usage.ru_stime, clock)


def _first_on_path(folder: Path) -> str:
    return os.pathsep.join(filter(None, [str(folder), os.environ.get("PYTHONPATH")]))
