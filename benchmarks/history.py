"""The history of a rig at a million entries, under damage, and under kills.

python benchmarks/history.py [--entries 1000000] [--damages 2000] [--kills 1000]

Prints what an append, and reading the last entries, takes at the millionth entry beside a first one; what a damaged
byte costs; and what is lost when two processes that write are killed at random moments. 0 takes a part out.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "files"))

from writers import kill_at_random, write

from retrue.files.append_log import FULL_LOG, opened_log, parts_folder
from retrue.files.history import history_path, read_history, roll_back
from retrue.files.log_lines import line_of
from retrue.files.log_parts import write_part

APPENDS = 300
ROUND_OF = (
    "1 kB written and synced, no history",
    "append to the new one",
    "append to the long one",
    "rig and history of the new one written in place",
    "rig and history of the long one written in place",
)
ROUND = 50  # kills on one history


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--entries", type=int, default=1_000_000)
    parser.add_argument("--damages", type=int, default=2000)
    parser.add_argument("--kills", type=int, default=1000)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        good = not asked.entries or length(folder, asked.entries)
        good &= not asked.damages or damages(folder, asked.damages)
        good &= not asked.kills or kills(asked.kills)
    return int(not good)


def length(folder: Path, entries: int) -> bool:
    """Appends to a long history in turn with appends to a new one."""
    (folder / "long").mkdir()
    (folder / "new").mkdir()
    long, new = folder / "long" / "rig.json", folder / "new" / "rig.json"
    for path in (long, new):
        write(path, 0.0)
    start = time.perf_counter()
    fill(long, entries)
    size = sum(file.stat().st_size for file in parts_folder(history_path(long)).iterdir()) / 2**20
    print(f"{entries} entries in {time.perf_counter() - start:.0f} s, {size:.0f} MB", flush=True)
    rounds = [[1000 * seconds for seconds in one_round(folder, new, long)] for _ in range(APPENDS)]
    medians, tails = np.median(rounds, axis=0), np.percentile(rounds, 99, axis=0)
    for name, median, tail in zip(ROUND_OF, medians, tails, strict=True):
        print(f"  {name}: median {median:.2f} ms, 99 % {tail:.2f} ms")
    for path in (new, long):
        start = time.perf_counter()
        last = read_history(path, 20)
        seconds = time.perf_counter() - start
        print(f"  the last 20 of the {path.parent.name} one: {1000 * seconds:.1f} ms; the last is {last[-1].id}")
    start = time.perf_counter()
    restored = roll_back(long, entries // 2).restored
    print(f"  rolled back to {restored}: {1000 * (time.perf_counter() - start):.0f} ms")
    return medians[2] < 5 and medians[2] <= 2 * medians[1] and restored == entries // 2


def one_round(folder: Path, new: Path, long: Path) -> list[float]:
    """Seconds of each of `ROUND_OF`, one after the other, so that whatever else the disk does hits all alike."""
    times = [time.perf_counter()]
    with (folder / "bare").open("ab", buffering=0) as stream:
        stream.write(bytes(1000))
        os.fsync(stream.fileno())
    times.append(time.perf_counter())
    for path in (new, long):
        with opened_log(history_path(path)) as log, log.appended([dict(log.recent[0].document) | {"id": log.next_id}]):
            pass
        times.append(time.perf_counter())
    for path in (new, long):
        write(path, times[-1])
        times.append(time.perf_counter())
    return np.diff(times).tolist()


def fill(path: Path, entries: int) -> None:
    """Parts as appends would have left them, without waiting for the disk a million times."""
    log = history_path(path)
    *_, text = log.read_text().splitlines()
    log.unlink()
    document = json.loads(text)
    del document["crc32"]
    rng = np.random.default_rng(0)
    lines: list[bytes] = []
    size = 0
    for number in range(1, entries + 1):
        document |= {"id": number}
        document["rig"]["projector_from_camera"]["t"] = rng.normal(0, 300, 3).tolist()
        document["rig"]["camera"]["K"][0][0] = 1500 + float(rng.normal())
        line = line_of(document)
        lines.append(line.removesuffix(b"\n"))
        size += len(line)
        if size >= FULL_LOG:
            write_part(parts_folder(log), number + 1 - len(lines), number, lines)
            lines, size = [], 0
    log.write_bytes(b"".join(line + b"\n" for line in lines))


def damages(folder: Path, count: int) -> bool:
    """Single bytes flipped, zeroed, cut out, and all cut off from one on; in the file and in a part."""
    rng = np.random.default_rng(1)
    path = folder / "damaged.json"
    for number in range(12):
        write(path, float(number))
    log = history_path(path)
    lines = log.read_bytes().splitlines()
    write_part(parts_folder(log), 1, 6, lines[:6])
    log.write_bytes(b"".join(line + b"\n" for line in lines[6:]))
    (part,) = parts_folder(log).iterdir()
    expected = {entry.id: entry for entry in read_history(path)}
    rig = path.read_bytes()
    failed = lost = wrong = 0
    for _ in range(count):
        file = (log, part)[rng.integers(2)]
        content = file.read_bytes()
        at, kind = int(rng.integers(len(content))), rng.integers(4)
        between = {0: bytes([content[at] ^ int(rng.integers(1, 256))]), 1: b"\0"}.get(int(kind), b"")
        file.write_bytes(content[:at] + between + (b"" if kind == 3 else content[at + 1 :]))
        before = {log: log.read_bytes(), part: part.read_bytes()}
        try:
            found = {entry.id: entry for entry in read_history(path)}
            write(path, 100.0)
            new = read_history(path)[-1]
        except Exception as error:
            print(f"  {file.name} at {at}: {error}")
            failed += 1
        else:
            cut = 1 if kind < 3 else entries_from(file, content, at)
            lost += len(found) < len(expected) - cut
            wrong += any(found[number] != expected[number] for number in found) or new.rig.evidence["turn"] != 100.0
            wrong += new.id <= max(found)
        before[file] = content
        for changed, old in before.items():
            changed.write_bytes(old)
        path.write_bytes(rig)
    print(f"{count} damages: {failed} not read or not written on, {lost} lost more than was hit, {wrong} wrong")
    return not failed + lost + wrong


def entries_from(file: Path, content: bytes, at: int) -> int:
    """How many entries are hit when all from that byte on is cut off."""
    return content[at:].count(b"\n" if file.suffix == ".jsonl" else b"\x1f\x8b\x08") + (file.suffix != ".jsonl")


def kills(count: int) -> bool:
    """Two processes that write one rig, killed again and again."""
    written = unreadable = lost = 0
    for start in range(0, count, ROUND):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "rig.json"
            write(path, 0.0)
            survey = kill_at_random(path, min(ROUND, count - start), seed=start)
        written, unreadable, lost = written + survey.written, unreadable + survey.unreadable, lost + survey.lost
    print(f"{count} kills, {written} entries reported as written: {unreadable} rigs unreadable, {lost} entries lost")
    return not unreadable + lost


if __name__ == "__main__":
    sys.exit(main())
