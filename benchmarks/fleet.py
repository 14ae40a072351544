"""A fleet of simulated rigs in one process: bumps, creep, broken files, a source that hangs; stopped and started again.

python benchmarks/fleet.py [--rigs 50] [--frames 20000] [--workers 2] [--stops 5]

Frames are tables of points that lie in a folder a rig. The command runs as users run it; SIGTERM comes at random, and
then it is started again. Prints what was found of what, events lost or twice, memory, and what a frame takes beside
reading and verifying alone: by the clock, and of the processors, which other work on the machine disturbs less.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "watch"))

from stream import RIG, seen_by, turned

from retrue import read_points, verify, write_points, write_rig

COMMAND = [sys.executable, "-c", "import sys; from retrue.cli.main import main; sys.exit(main())", "watch"]
WITHIN = 5  # frames in which a bump must be found
FLAT = 0.05  # growth of memory
SHARE = 0.9  # of the throughput of reading and verifying alone
WARM = 0.2  # share of the time after which memory must be flat
LIMITS = "[limits]\npoll_seconds = 0.5\nsettle_seconds = 0.2\npatience_seconds = 1.0\nidle_seconds = 8.0\n"
ALONE = 200  # frames that are verified without a fleet
KINDS = ("holds", "bumped", "creeps", "bumped")


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--rigs", type=int, default=50)
    parser.add_argument("--frames", type=int, default=20_000, help="of all rigs together")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--stops", type=int, default=5)
    asked = parser.parse_args()
    each = asked.frames // asked.rigs
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        bumps = made(folder, asked.rigs, each, asked.workers)
        took, apart = run(folder, asked.stops, asked.workers)
        good = survey(folder, asked.rigs, each, bumps)
        good &= memory_is_flat(took.megabytes)
        return int(not (good and is_quick(asked.rigs * each, took, apart)))


def made(folder: Path, rigs: int, each: int, workers: int) -> dict[int, int]:
    """Rigs and frames; the frame at which each bumped rig is bumped."""
    rng = random.Random(0)
    bumps: dict[int, int] = {}
    tables = f'workers = {workers}\nport = 0\nlens = "fixed"\n{LIMITS}'
    for rig in range(rigs):
        write_rig(folder / f"{rig:02}.json", RIG)
        source = folder / f"frames {rig:02}"
        source.mkdir()
        kind = KINDS[rig % len(KINDS)]
        if kind == "bumped":
            bumps[rig] = rng.randrange(each // 4, 3 * each // 4)
        tables += f'[[rig]]\nrig = "{rig:02}.json"\nsource = "{source.name}"\n'
        for number in range(each):
            creep = 0.5 * max(0.0, number / each - 0.3) if kind == "creeps" else 0.0
            bump = 0.8 if number >= bumps.get(rig, each) else 0.0
            path = source / f"{number:05}.csv"
            if number % 97 == 50:
                path.write_text("rubbish")
            else:
                write_points(path, seen_by(turned(RIG, (creep, bump, 0)), 100_000 * rig + number, 200))
    os.mkfifo(folder / "hangs")  # nobody writes into it
    write_rig(folder / "hangs.json", RIG)
    tables += '[[rig]]\nrig = "hangs.json"\nsource = "hangs"\n'
    (folder / "fleet.toml").write_text(tables)
    return bumps


@dataclass(slots=True)
class Took:
    """Of some frames: by the clock, of all processors together, and memory of the process once a second."""

    seconds: float = 0.0
    processor_seconds: float = 0.0
    megabytes: list[float] = field(default_factory=list)


def verified(path: Path) -> float:
    """What one frame alone takes of a processor."""
    start = time.process_time()
    verify(RIG, [read_points(path)])
    return time.process_time() - start


def alone(folder: Path, workers: int) -> Took:
    """A frame that is read and verified, on as many processes, and nothing else."""
    paths = sorted((folder / "frames 00").iterdir())
    paths = [path for path in paths if path.stat().st_size > 100][:ALONE]
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        list(pool.map(verified, paths[: 4 * workers]))
        start = time.perf_counter()
        processor = list(pool.map(verified, paths, chunksize=4))
        return Took((time.perf_counter() - start) / len(paths), sum(processor) / len(paths))


def run(folder: Path, stops: int, workers: int) -> tuple[Took, Took]:
    """The fleet until nothing comes any more, memory of its longest run; and a frame alone, before and after each.

    The machine is not as quick all the time: what was measured beside a run counts as long as that took.
    """
    rng = random.Random(1)
    took, apart, before = Took(), Took(), alone(folder, workers)
    for stop in range(stops + 1):
        start = time.perf_counter()
        command = [*COMMAND, str(folder / "fleet.toml"), "--out", str(folder / "out"), "--quiet"]
        with subprocess.Popen(command) as process:
            until = time.perf_counter() + rng.uniform(15, 45) if stop < stops else float("inf")
            session: list[float] = []
            ended: tuple[int, int, Any] = (0, 0, None)
            while not ended[0] and time.perf_counter() < until and not all_done(folder):
                time.sleep(1.0)
                session.append(resident(process.pid))
                ended = os.wait4(process.pid, os.WNOHANG)
            if not ended[0]:
                process.send_signal(signal.SIGTERM)
                ended = os.wait4(process.pid, 0)
            _, status, usage = ended  # of its workers too
            process.returncode = os.waitstatus_to_exitcode(status)
        lasted = time.perf_counter() - start
        took.seconds += lasted
        took.processor_seconds += usage.ru_utime + usage.ru_stime
        after = alone(folder, workers)
        apart.seconds += lasted * (before.seconds + after.seconds) / 2
        apart.processor_seconds += lasted * (before.processor_seconds + after.processor_seconds) / 2
        before = after
        if len(session) > len(took.megabytes):
            took.megabytes = session
        if process.returncode != 0:
            print(f"the fleet ended with {process.returncode}")
    return took, Took(apart.seconds / took.seconds, apart.processor_seconds / took.seconds)


def all_done(folder: Path) -> bool:
    """Whether every file was handled: each state knows of as many frames as lie there."""
    for source in folder.glob("frames *"):
        state = folder / "out" / source.name.removeprefix("frames ") / "state.json"
        if not state.exists() or json.loads(state.read_text())["counts"]["frames"] < len(list(source.iterdir())):
            return False
    return True


def resident(pid: int) -> float:
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * 4096 / 2**20
    except (OSError, IndexError):
        return 0.0


def survey(folder: Path, rigs: int, each: int, bumps: dict[int, int]) -> bool:
    """What the events say, beside what was done to the rigs."""
    lost = twice = 0
    took: list[int] = []
    false: list[str] = []
    kinds: Counter[str] = Counter()
    for rig in range(rigs):
        lines = (folder / f"out/{rig:02}/events.jsonl").read_text().splitlines()
        events = [json.loads(line) for line in lines]
        names = Counter(event["name"] for event in events if event["event"] in ("frame", "bad frame"))
        lost += each - len(names)
        twice += sum(count - 1 for count in names.values())
        at = 0
        found: list[tuple[int, str]] = []
        for event in events:
            if event["event"] == "frame":
                at = max(at, int(event["name"].removesuffix(".csv")))
            if event["event"] == "recalibrated":
                found.append((at, event["kind"]))
        bump = bumps.get(rig)
        for number, kind in found:
            kinds[f"{KINDS[rig % len(KINDS)]}: {kind}"] += 1
            creeping = KINDS[rig % len(KINDS)] == "creeps" and number > 0.3 * each
            if not creeping and (bump is None or not bump <= number <= bump + 2 * WITHIN):
                false.append(f"rig {rig} at {number} ({kind})")
        if bump is not None:
            took.append(min((number - bump + 1 for number, _ in found if number >= bump), default=each))
    print(f"{rigs} rigs and one whose source hangs, {rigs * each} frames")
    print(
        f"bumps found within {max(took, default=0)} frames (median {np.median(took):.0f}); recalibrations {dict(kinds)}"
    )
    print(f"  not called for: {false or 'none'}")
    print(f"events of {lost} frames lost, {twice} twice")
    return max(took, default=0) <= WITHIN and not false and lost == twice == 0


def memory_is_flat(megabytes: list[float]) -> bool:
    warm = megabytes[int(WARM * len(megabytes)) :] or [0.0]
    growth = warm[-1] / max(warm[0], 1e-9) - 1
    print(f"memory {warm[0]:.0f} MB, at the end {warm[-1]:.0f} MB ({growth:+.1%}), over {len(megabytes)} s")
    return growth < FLAT


def is_quick(frames: int, took: Took, apart: Took) -> bool:
    seconds, processor = took.seconds / frames, took.processor_seconds / frames
    print("a frame alone, and in the fleet with its starts, stops and recalibrations:")
    for what, alone, together in (
        ("by the clock", apart.seconds, seconds),
        ("of a processor", apart.processor_seconds, processor),
    ):
        print(f"  ms {what}: {1000 * alone:.1f}, {1000 * together:.1f}: {alone / together:.2f}")
    return apart.processor_seconds / processor >= SHARE


if __name__ == "__main__":
    sys.exit(main())
