"""Pools outlive their workers, and workers do not outlive their parent."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from retrue.batch.runners import DIED, Dask, Pool
from retrue.errors import InputError

from .work import fragile

ROOT = Path(__file__).parents[2]


def test_a_pool_runs_all_and_outlives_a_worker_that_dies(tmp_path):
    tasks = [
        (str(tmp_path / f"{number}"), "die once" if number == 3 else "die" if number == 5 else "")
        for number in range(9)
    ]
    tasks[7] = (tasks[7][0], "raise")
    with Pool(2) as pool:
        results = dict(pool.run(fragile, tasks))
    assert set(results) == set(tasks)
    assert results[tasks[5]] == {"lost": DIED}
    assert results[tasks[7]] == {"lost": "ZeroDivisionError: because"}
    assert sum("lost" in result for result in results.values()) == 2


def test_a_pool_whose_workers_all_die_gives_up(tmp_path):
    with Pool(1) as pool, pytest.raises(InputError, match="died one after the other"):
        list(pool.run(fragile, [(str(tmp_path / f"{number}"), "die") for number in range(99)]))


def test_no_worker_outlives_a_parent_that_is_killed(tmp_path):
    code = "from retrue.batch.runners import Pool\nfrom tests.batch.work import pids\nfrom sys import argv\n"
    code += "if __name__ == '__main__':\n    for _ in Pool(2).run(pids, [argv[1]] * 99): pass\n"
    script = tmp_path / "parent.py"
    script.write_text(code)
    with subprocess.Popen(
        [sys.executable, str(script), str(tmp_path / "pids")], env=os.environ | {"PYTHONPATH": f"{ROOT}:{ROOT / 'src'}"}
    ) as parent:
        workers = wait_for_pids(tmp_path / "pids")
        parent.send_signal(signal.SIGKILL)
    end = time.monotonic() + 30
    while any(Path(f"/proc/{pid}/cmdline").exists() and is_running(pid) for pid in workers):
        assert time.monotonic() < end
        time.sleep(0.02)


def wait_for_pids(path: Path) -> set[int]:
    end = time.monotonic() + 60
    while time.monotonic() < end:
        if path.exists() and len(found := set(map(int, path.read_text().split()))) == 2:
            return found
        time.sleep(0.02)
    raise AssertionError("no workers")


def is_running(pid: int) -> bool:
    try:
        return ") Z " not in Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False


def test_dask_runs_the_same(tmp_path):
    pytest.importorskip("distributed")
    tasks = [(str(tmp_path / f"{number}"), "raise" if number == 3 else "") for number in range(6)]
    with Dask(None, 1) as dask:
        results = dict(dask.run(fragile, tasks))
    assert results[tasks[3]] == {"lost": "ZeroDivisionError: because"}
    assert sum(result == {} for result in results.values()) == 5


class Future:
    """Of `Cluster`; what it was to say is there at once."""

    def __init__(self, status: str, result: dict[str, Any]) -> None:
        self.status, self.result = status, result

    def add_done_callback(self, tell: Callable[[Future], None]) -> None:
        tell(self)


class Cluster:
    """Dask's client, without workers at first; its scheduler dies under the second batch, and later once more."""

    status = "running"

    def __init__(self) -> None:
        self.batches: list[list[int]] = []
        self.asked = self.gathered = 0

    def nthreads(self) -> dict[str, int]:
        self.asked += 1
        if self.asked == 1:
            raise OSError("no scheduler")
        return {"one": 1, "two": 1}

    def map(self, work: Callable[[int], dict[str, Any]], tasks: list[int], pure: bool) -> list[Future]:
        assert not pure
        self.batches.append(tasks)
        status = "cancelled" if len(self.batches) == 2 else "finished"
        return [Future(status, work(task)) for task in tasks]

    def gather(self, futures: list[Future]) -> list[dict[str, Any]]:
        self.gathered += 1
        if self.gathered == 4:
            raise OSError("connection lost")
        return [future.result for future in futures]


def test_what_went_with_a_scheduler_is_handed_in_again():
    dask = Dask.__new__(Dask)
    dask._client = cluster = Cluster()
    found = list(dask.run(lambda task: {"task": task}, range(30)))
    assert sorted(task for task, _ in found) == list(range(30))
    assert all(result == {"task": task} for task, result in found)
    handed_in = [task for batch in cluster.batches for task in batch]
    assert 0 < len(handed_in) - 30 <= 16  # only what was in flight, twice
