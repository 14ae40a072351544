"""A batch on Dask: beside the pool, on 64 sleeping workers, and with its scheduler and its workers killed.

python benchmarks/batch_dask.py [--captures 200] [--workers 2] [--many 64] [--seconds 1]

Captures are simulated points. Schedulers and workers are processes of their own, killed by SIGKILL. Needs retrue[dask].
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from socket import socket
from typing import Any

from batch import children, clouds, made, slept
from distributed import Client, LocalCluster

from retrue.batch.runners import AHEAD, Dask, Pool
from retrue.batch.tasks import Look, Renew, work

HERE = Path(__file__).parent
TASKS = 20  # of each sleeping worker
SHARES = (0.2, 0.5, 0.8)  # of all tasks, after which something is killed
DONE = "RETRUE_BENCHMARK_DONE"  # names the file to which workers write what they have done


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--captures", type=int, default=200)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--many", type=int, default=64)
    parser.add_argument("--seconds", type=float, default=1.0, help="that a task sleeps")
    asked = parser.parse_args()
    beside_the_pool(asked.workers)
    many_workers(asked.many, asked.seconds)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        made(folder, asked.captures)
        return int(not kills(folder, asked.captures, asked.workers))


def beside_the_pool(workers: int) -> None:
    """Tasks as long as a capture takes, on the pool and on Dask in turn."""
    took: dict[str, float] = {"pool": 0.0, "Dask": 0.0}
    for _ in range(3):
        for name, runner in (("pool", Pool(workers)), ("Dask", Dask(None, workers))):
            with runner:
                list(runner.run(slept, [0.0] * 4 * workers))
                start = time.perf_counter()
                list(runner.run(slept, [0.25] * 20 * workers))
                took[name] += time.perf_counter() - start
    ratio = took["Dask"] / took["pool"]
    print(f"{60 * workers} tasks of 0.25 s: pool {took['pool']:.2f} s, Dask {took['Dask']:.2f} s: {ratio:.2f}")


def many_workers(many: int, seconds: float) -> None:
    """Tasks that sleep, handed in as a batch does, and by Dask's own `map` all at once, which is what Dask can do."""
    with LocalCluster(n_workers=many, threads_per_worker=1, processes=False, dashboard_address=":0") as cluster:
        with Dask(cluster.scheduler_address, 1) as runner:
            list(runner.run(slept, [0.0] * many))
            ours = efficiency(lambda: list(runner.run(slept, [seconds] * TASKS * many)), seconds)
        with Client(cluster) as client:
            own = efficiency(lambda: client.gather(client.map(slept, [seconds] * TASKS * many, pure=False)), seconds)
    print(f"{TASKS * many} tasks that sleep {seconds:g} s on {many} workers of Dask, all in one process:")
    for name, (used, cores) in (("handed in as by a batch", ours), ("by Dask's own map", own)):
        print(f"  {name}: efficiency {used:.2f}, {cores:.2f} cores")


def efficiency(run: Any, seconds: float) -> tuple[float, float]:
    """Share of the time in which the workers worked; cores that Dask took for that."""
    start, processor = time.perf_counter(), time.process_time()
    run()
    took = time.perf_counter() - start
    return TASKS * seconds / took, (time.process_time() - processor) / took


def kills(folder: Path, count: int, workers: int) -> bool:
    """The scheduler or a worker killed in the middle: it comes back, or the batch is run again."""
    os.environ[DONE] = str(folder / "done")
    batch(folder, None, workers).wait()
    whole = clouds(folder / "out")
    good = True
    for what in ("worker", "scheduler that comes back", "scheduler that stays away"):
        (folder / "out").rename(folder / f"before {what}")
        (folder / "done").unlink()
        good &= killed(folder, what, count, workers, whole)
    return good


def killed(folder: Path, what: str, count: int, workers: int, whole: dict[str, bytes]) -> bool:
    port, runs, stops, status = free_port(), 0, 0, 2
    shares = [share * 2 * count for share in SHARES]
    with cluster(port, workers) as processes:
        while status == 2:
            runs += 1
            with batch(folder, port, workers) as process:
                while process.poll() is None:
                    time.sleep(0.05)
                    if shares and done(folder).total() >= shares[0]:
                        shares.pop(0)
                        stops += 1
                        if what == "worker":
                            os.kill(children(processes[1].pid)[0], 9)
                        else:
                            for dead in processes:
                                dead.kill()
                                dead.wait()
                        if what == "scheduler that comes back":
                            processes[:] = started(port, workers)
                status = process.returncode
            if status == 2:
                processes[:] = started(port, workers)
    found, ran = clouds(folder / "out"), done(folder)
    lost, twice = sum(found.get(name) != content for name, content in whole.items()), ran.total() - len(ran)
    print(f"{stops} kills of a {what}: {runs} runs, {lost} clouds lost or others, {twice} of {ran.total()} done twice")
    return not lost and twice <= stops * workers * (1 + AHEAD) and status == 0


@contextmanager
def cluster(port: int, workers: int) -> Generator[list[subprocess.Popen[bytes]]]:
    processes = started(port, workers)
    try:
        yield processes
    finally:
        for process in processes:
            process.terminate()
            process.wait()


def started(port: int, workers: int) -> list[subprocess.Popen[bytes]]:
    """A scheduler, and workers with the nanny that starts them again."""
    scheduler = ["dask_scheduler", "--port", str(port), "--no-dashboard"]
    worker = ["dask_worker", f"tcp://127.0.0.1:{port}", "--nworkers", str(workers), "--nthreads", "1", "--no-dashboard"]
    return [
        subprocess.Popen(
            [sys.executable, "-m", f"distributed.cli.{name}", *rest], stderr=subprocess.DEVNULL, env=environment()
        )
        for name, *rest in (scheduler, worker)
    ]


def batch(folder: Path, port: int | None, workers: int) -> subprocess.Popen[bytes]:
    where = ["--workers", str(workers)] if port is None else ["--scheduler", f"tcp://127.0.0.1:{port}"]
    command = [sys.executable, str(Path(__file__)), "batch", str(folder / "job.toml"), *where, "--quiet"]
    return subprocess.Popen(command, env=environment())


def environment() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": os.pathsep.join([str(HERE), *filter(None, sys.path)])}


def free_port() -> int:
    with socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def done(folder: Path) -> Counter[str]:
    path = folder / "done"
    return Counter(path.read_text().splitlines() if path.exists() else [])


def counted(task: Look | Renew) -> dict[str, Any]:
    """What a worker does, and a line that says so."""
    result = work(task)
    with Path(os.environ[DONE]).open("a") as stream:
        stream.write(f"{task!r}\n")
    return result


def counted_batch() -> int:
    """`retrue batch`, its tasks counted; their function is one of a module that workers can import."""
    import batch_dask

    import retrue.batch.batch
    from retrue.cli.main import main as retrue_main

    retrue.batch.batch.work = batch_dask.counted
    return retrue_main(sys.argv[1:])


if __name__ == "__main__":
    sys.exit(counted_batch() if sys.argv[1:2] == ["batch"] else main())
