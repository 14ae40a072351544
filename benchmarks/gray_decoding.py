"""Decoding a Gray-code folder against the time that OpenCV takes to read its files, side by side.

python benchmarks/gray_decoding.py CAPTURE [CAPTURE ...] --pattern pattern.json [--rounds 15]
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import cv2

from retrue.files.captures import read_capture
from retrue.files.images import read_folder
from retrue.files.patterns import read_pattern


def milliseconds(job: Callable[[], object]) -> float:
    start = time.perf_counter()
    job()
    return 1000 * (time.perf_counter() - start)


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("captures", nargs="+", type=Path)
    arguments.add_argument("--pattern", required=True, type=Path)
    arguments.add_argument("--rounds", type=int, default=15)
    options = arguments.parse_args()
    pattern = read_pattern(options.pattern)
    for capture in options.captures:
        paths = [str(path) for path in read_folder(capture)[1]]
        jobs: dict[str, Callable[[], object]] = {
            "retrue, files to points": lambda capture=capture: read_capture(capture, pattern),
            "  of which reading": lambda capture=capture: read_folder(capture),
            "cv2.imread": lambda paths=paths: [cv2.imread(path) for path in paths],
            "cv2.imread, grey": lambda paths=paths: [cv2.imread(path, cv2.IMREAD_GRAYSCALE) for path in paths],
        }
        for job in jobs.values():
            job()
        times: dict[str, list[float]] = {name: [] for name in jobs}
        for _ in range(options.rounds):  # in turn, so that whatever else the machine does hits all alike
            for name, job in jobs.items():
                times[name].append(milliseconds(job))
        ours = statistics.median(times["retrue, files to points"])
        print(f"{capture}: {len(paths)} pictures, median of {options.rounds}")
        for name, values in times.items():
            median = statistics.median(values)
            print(f"  {name:26s} {median:7.1f} ms   retrue takes {ours / median:4.2f} of it")


if __name__ == "__main__":
    main()
