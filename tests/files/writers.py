"""Processes that write a rig in place, to be killed, to run out of disk, or to write at once.

Run as `python writers.py NAME PATH ARGUMENT...`.
"""

from __future__ import annotations

import subprocess
import sys
import time
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import numpy as np

from retrue.errors import FileError
from retrue.files.history import read_history, write_in_place
from retrue.files.rigs import read_rig
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.recalibration.result import Accepted, Evidence
from retrue.rig import Rig

CAMERA = Camera((1280, 960), [[1500, 0, 640], [0, 1500, 480], [0, 0, 1]])


def start(name: str, path: Path, *arguments: float) -> subprocess.Popen[str]:
    """One of the functions below in a process of its own."""
    command = [sys.executable, __file__, name, str(path), *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def write(path: Path, turn: float) -> None:
    pose = RigidTransform.from_rotation_vector([0, turn / 1000, 0], [-300.0, 0, 0])
    write_in_place(path, Accepted(Rig(CAMERA, CAMERA, pose, "mm", {"turn": turn}), "because", Evidence(1)))


def write_many(path: Path, first: float, number: float) -> None:
    for k in range(int(number)):
        write(path, first + k)


def write_until_killed(path: Path, first: float) -> None:
    """Says each number as soon as it is written."""
    for k in count():
        write(path, first + k)
        print(first + k, flush=True)


def full_disk(path: Path, limit: float) -> None:
    import resource

    resource.setrlimit(resource.RLIMIT_FSIZE, (int(limit), int(limit)))
    try:
        write(path, 1.0)
    except FileError as error:
        print(error)
        sys.exit(3)


@dataclass(frozen=True)
class Survey:
    """What kills left: rigs that did not read, entries that had been reported as written and are gone."""

    written: int
    unreadable: int
    lost: int


def kill_at_random(path: Path, kills: int, seed: int) -> Survey:
    """Kill one of two processes that write, again and again; what they had reported must be there.

    The other one writes on all the while: it must neither wait for who was killed, nor lose what it wrote itself.
    """
    rng = np.random.default_rng(seed)
    said: set[float] = set()
    unreadable = 0
    with start("write_until_killed", path, 0.5) as other:
        for kill in range(kills):
            with start("write_until_killed", path, 1e6 * (kill + 1)) as process:
                assert process.stdout is not None
                said.add(float(process.stdout.readline()))
                time.sleep(rng.uniform(0, 0.05))
                process.kill()
                rest, _ = process.communicate()
            said |= {float(line) for line in rest.split("\n")[:-1]}
            try:
                read_rig(path)
                unreadable += not read_history(path, 10)
            except FileError:
                unreadable += 1
        other.kill()
        rest, _ = other.communicate()
        said |= {float(line) for line in rest.split("\n")[:-1]}
    kept = {entry.rig.evidence["turn"] for entry in read_history(path)}
    return Survey(len(said), unreadable, len(said - kept))


if __name__ == "__main__":
    globals()[sys.argv[1]](Path(sys.argv[2]), *map(float, sys.argv[3:]))
