"""Jobs timed in turn, so that whatever else the machine does hits all alike, and the rows that come of it."""

from __future__ import annotations

import os
import platform
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

Job = Callable[[], object]
HEAD = ("what", "retrue", "beside it", "takes", "ratio", "goal")
PEERS = {"OpenCV": "opencv-python-headless", "PoseLib": "poselib", "pycolmap": "pycolmap"}


@dataclass(frozen=True)
class Row:
    """One job of ours beside one of somebody else.

    Attributes
    ----------
    ratio : median over the turns of our time over theirs.
    goal : the largest ratio that we want; None where there is none.
    before : the ratio that must not grow, as it was when kernels were still compiled at run time.
    """

    what: str
    retrue_s: float
    peer: str
    peer_s: float
    ratio: float
    goal: float | None = None
    before: float | None = None

    def cells(self) -> tuple[str, ...]:
        goal = ""
        if self.goal is not None:
            goal = f"at most {self.goal:.3g}{'' if self.ratio <= self.goal else ': **missed**'}"
        elif self.before is not None:
            goal = f"before: {self.before:.3g}"
        return self.what, _shown(self.retrue_s), self.peer, _shown(self.peer_s), f"{self.ratio:.3g}", goal


def compare(
    what: str,
    ours: Job,
    peers: Mapping[str, Job],
    rounds: int,
    *,
    repeats: int = 1,
    parts: int = 1,
    goals: Mapping[str, float] | None = None,
    before: Mapping[str, float] | None = None,
    clock: Callable[[], float] = time.perf_counter,
) -> list[Row]:
    """A row for each peer, by that clock, after one call of each; `parts` answers come of one call."""
    jobs = {"retrue": ours, **peers}
    for job in jobs.values():
        job()
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(rounds):
        for name, job in jobs.items():
            start = clock()
            for _ in range(repeats):
                job()
            times[name].append((clock() - start) / repeats / parts)
    own = times.pop("retrue")
    return rows(what, own, times, goals or {}, before or {})


def rows(
    what: str,
    ours: Sequence[float],
    peers: Mapping[str, Sequence[float]],
    goals: Mapping[str, float],
    before: Mapping[str, float],
) -> list[Row]:
    """From seconds in each turn."""
    return [
        Row(
            what,
            statistics.median(ours),
            peer,
            statistics.median(theirs),
            statistics.median(own / other for own, other in zip(ours, theirs, strict=True)),
            goals.get(peer),
            before.get(peer),
        )
        for peer, theirs in peers.items()
    ]


def table(all_rows: Sequence[Row]) -> str:
    """Markdown; what a row shares with the one above is not said again."""
    lines = [HEAD, ("---",) * len(HEAD)]
    above = None
    for row in all_rows:
        cells = row.cells()
        same = above is not None and (row.what, row.retrue_s) == (above.what, above.retrue_s)
        lines.append(("", "", *cells[2:]) if same else cells)
        above = row
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


def machine(rounds: int) -> str:
    """What the figures hold for."""
    packages = {"NumPy": "numpy", "SciPy": "scipy", **PEERS}
    versions = [f"{name} {version(package)}" for name, package in packages.items() if has(name)]
    return (
        f"{date.today().isoformat()}: {_processor()}, {os.cpu_count()} cores, {platform.system()}, Python"
        f" {platform.python_version()}, {', '.join(versions)}."
        f" {rounds} turns; fewer of what is long, more of what is short.\n"
    )


def has(name: str) -> bool:
    """Whether a package is installed, by the name that it goes by here."""
    return name == "OpenCV" or find_spec(name.lower()) is not None


def peer(name: str, job: str) -> str:
    """How a row calls the job of a peer: with its version."""
    return f"{name} {version(PEERS[name])} {job}"


def _shown(seconds: float) -> str:
    value, unit = (1e6 * seconds, "us") if seconds < 1e-3 else (1e3 * seconds, "ms")
    return f"{value:.0f} {unit}" if value >= 100 else f"{value:.3g} {unit}"


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()
