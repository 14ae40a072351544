"""A batch beside single commands: the same files, what it costs on top, kills, and doing nothing.

python benchmarks/batch.py [--captures 2000] [--workers 2]

Captures are simulated points of a rig that is bumped twice. Dask is measured by batch_dask.py.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "watch"))

from stream import RIG, seen_by, turned

from retrue import write_points, write_rig
from retrue.batch.runners import Pool
from retrue.batch.tasks import Look
from retrue.batch.worker import look
from retrue.cli.main import main as retrue_main

COMMAND = [sys.executable, "-c", "import sys; from retrue.cli.main import main; sys.exit(main())", "batch"]
POINTS = 400  # of a capture
ALONE = 200  # captures that are looked at without a pool, to know what that takes
IN_FLIGHT = 4  # tasks for each worker


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--captures", type=int, default=2000)
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        made(folder, asked.captures)
        good = same_files(folder, asked.captures, asked.workers)
        good &= kills(folder, asked.captures, asked.workers)
        good &= nothing_to_do(folder)
        overhead(folder, asked.captures, asked.workers)
    return int(not good)


def made(folder: Path, count: int) -> None:
    write_rig(folder / "rig.json", RIG)
    (folder / "captures").mkdir()
    for number in range(count):
        moves = (number >= count // 3) + (number >= 2 * count // 3)
        write_points(folder / f"captures/{number:06}.csv", seen_by(turned(RIG, (moves, 0, 0)), number, POINTS))
    job = 'rig = "rig.json"\ncaptures = "captures/*.csv"\ndo = ["verify", "recalibrate", "reconstruct"]\n'
    job += 'out = "out"\nlens = "fixed"\n'
    (folder / "job.toml").write_text(job)


def batch(folder: Path, workers: int) -> dict[str, Any]:
    done = subprocess.run(
        [*COMMAND, str(folder / "job.toml"), "--workers", str(workers), "--json"], stdout=subprocess.PIPE, check=False
    )
    return json.loads(done.stdout)


def same_files(folder: Path, count: int, workers: int) -> bool:
    """All clouds beside those of `retrue reconstruct`, in another order."""
    start = time.perf_counter()
    report = batch(folder, workers)
    seconds = time.perf_counter() - start
    rows = [line.split(",") for line in (folder / "out/summary.csv").read_text().splitlines()[1:]]
    random.Random(0).shuffle(rows)
    differ = 0
    for row in rows:
        one = folder / "one.ply"
        retrue_main(["reconstruct", row[8], str(folder / "captures" / row[0]), "--out", str(one), "--quiet"])
        differ += one.read_bytes() != (folder / f"out/clouds/{row[0]}.ply").read_bytes()
    rigs = sorted({row[8] for row in rows})
    print(f"{count} captures of {POINTS} points on {workers} workers: {seconds:.0f} s")
    print(f"  {report['clouds']} clouds, {differ} not those of single commands")
    print(f"  {len(rigs)} rigs, {report['failed']} failed, {report['drifted']} drifted")
    return differ == 0 and report["clouds"] == count and len(rigs) == 3


def kills(folder: Path, count: int, workers: int) -> bool:
    """A worker, then the parent, killed in the middle, again and again."""
    (folder / "out").rename(folder / "whole")
    ledger = folder / "out/results.jsonl"
    rng = random.Random(0)
    stops = 0
    for share in (0.1, 0.3, 0.5, 0.7, 0.9):
        command = [*COMMAND, str(folder / "job.toml"), "--workers", str(workers), "--quiet"]
        with subprocess.Popen(command) as process:
            while process.poll() is None and (not ledger.exists() or lines(ledger) < share * 2 * count):
                time.sleep(0.02)
                if rng.random() < 0.002 and (found := children(process.pid)):
                    with contextlib.suppress(ProcessLookupError):
                        os.kill(rng.choice(found), signal.SIGKILL)
                    stops += 1
            process.kill()
        stops += 1
    batch(folder, workers)
    whole, again = (clouds(folder / out) for out in ("whole", "out"))
    differ = sum(whole[name] != again.get(name) for name in whole)
    extra = lines(ledger) - lines(folder / "whole/results.jsonl")
    print(f"{stops} kills of workers and parents: {differ} clouds differ, {extra} results twice")
    return whole == again and extra <= stops * workers * IN_FLIGHT


def clouds(out: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in (out / "clouds").iterdir()}


def lines(path: Path) -> int:
    return path.read_bytes().count(b"\n")


def children(pid: int) -> list[int]:
    """Processes that a process started, but for what multiprocessing counts with."""
    found = [int(word) for task in Path(f"/proc/{pid}/task").glob("*/children") for word in task.read_text().split()]
    return [child for child in found if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()]


def nothing_to_do(folder: Path) -> bool:
    start = time.perf_counter()
    report = batch(folder, 1)
    seconds = time.perf_counter() - start
    print(
        f"nothing to do: {report['seconds']:.2f} s, {seconds:.2f} s with the start of Python; {report['tasks']} tasks"
    )
    return report["tasks"] == 0 and report["seconds"] < 1


def overhead(folder: Path, count: int, workers: int) -> None:
    """The same function on the same captures, without a pool; then with it, without the batch around it."""
    tasks = [
        Look(path.name, path, None, folder / "rig.json", {}, True, None, folder / "loose" / f"{path.name}.ply")
        for path in sorted((folder / "captures").iterdir())[:count]
    ]
    look(tasks[0])
    start = time.perf_counter()
    for task in tasks[:ALONE]:
        look(task)
    alone = (time.perf_counter() - start) / len(tasks[:ALONE])
    with Pool(workers) as pool:
        list(pool.run(look, tasks[: 4 * workers]))  # its processes have started
        start = time.perf_counter()
        list(pool.run(look, tasks))
        seconds = (time.perf_counter() - start) * workers / len(tasks)
    print(
        f"a capture takes {1000 * alone:.1f} ms alone, {1000 * seconds:.1f} ms of a worker in the pool (cores shared)"
    )
    with Pool(workers) as pool:
        list(pool.run(slept, [0.0] * 4 * workers))
        start = time.perf_counter()
        list(pool.run(slept, [0.02] * 1000))
        each = (time.perf_counter() - start) * workers / 1000 - 0.02
    print(f"on top of a task that sleeps 20 ms: {1000 * each:.2f} ms")


def slept(seconds: float) -> dict[str, Any]:
    time.sleep(seconds)
    return {}


if __name__ == "__main__":
    sys.exit(main())
