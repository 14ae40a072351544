"""Jobs timed in turn in one process, so that whatever else the machine does hits all alike."""

from __future__ import annotations

import platform
import statistics
import time
from collections.abc import Callable, Mapping
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

Job = Callable[[], object]


def print_machine() -> None:
    """The processor and the versions that the figures hold for."""
    optional = [name for name in ("poselib", "pycolmap") if find_spec(name) is not None]
    packages = ["numpy", "scipy", "opencv-python-headless", *optional]
    print(f"{_processor()}, Python {platform.python_version()}")
    print(", ".join(f"{name} {version(name)}" for name in packages))


def compare(title: str, jobs: Mapping[str, Job], rounds: int, repeats: int = 1, parts: int = 1) -> None:
    """Medians over the rounds: of the time, and of its ratio to the first job's; `parts` answers come of one call."""
    for job in jobs.values():
        job()
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(rounds):
        for name, job in jobs.items():
            start = time.perf_counter()
            for _ in range(repeats):
                job()
            times[name].append((time.perf_counter() - start) / repeats / parts)
    ours = next(iter(times.values()))
    print(f"\n{title}, median of {rounds}")
    for name, values in times.items():
        ratio = statistics.median(other / own for other, own in zip(values, ours, strict=True))
        print(f"  {name:38s} {_shown(statistics.median(values)):>12s} {ratio:9.2f}")


def _shown(seconds: float) -> str:
    return f"{1e6 * seconds:.2f} us" if seconds < 1e-3 else f"{1e3 * seconds:.2f} ms"


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()
