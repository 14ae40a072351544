"""Who runs tasks: a pool of processes on this machine, or Dask on many. Both hand in what is done as it is done."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from itertools import islice
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import Any, Protocol, TypeVar

from retrue.errors import InputError
from retrue.processes import process_pool

T = TypeVar("T")
Work = Callable[[T], dict[str, Any]]
AHEAD = 3  # tasks that wait for each worker: as many as it takes to keep it busy
MOST_DEATHS = 8  # of workers in a row, with nothing done in between
PAUSE = 1.0  # seconds between two looks at whether the scheduler still lives
DIED = "its process died: killed, or out of memory"


class Runner(Protocol):
    """Takes tasks as room is free, and yields each with its result, in the order in which they end.

    A result under the key `lost` is the reason why there is none, and another run may have more luck.
    """

    def run(self, work: Work[T], tasks: Iterable[T]) -> Iterator[tuple[T, dict[str, Any]]]:
        """All of them."""
        ...


class Pool:
    """Processes of this machine. Tasks that one of them died with are run again, each by itself, and once."""

    def __init__(self, workers: int) -> None:
        self._workers = workers
        self._pool: ProcessPoolExecutor | None = None

    def __enter__(self) -> Pool:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)

    def run(self, work: Work[T], tasks: Iterable[T]) -> Iterator[tuple[T, dict[str, Any]]]:
        """As `Runner` says."""
        waiting = iter(tasks)
        suspects: deque[T] = deque()
        flying: dict[Future[dict[str, Any]], T] = {}
        ended, deaths = False, 0
        while True:
            alone = bool(suspects)
            while not ended and not alone and len(flying) < self._workers * (1 + AHEAD):
                task = next(waiting, None)
                if task is None:
                    ended = True
                else:
                    flying[self._submit(work, task)] = task
            if alone and not flying:
                flying[self._submit(work, suspects[0])] = suspects[0]
            if not flying:
                return
            done, _ = wait(flying, return_when=FIRST_COMPLETED)
            broken: list[T] = []
            for future in done:
                task = flying.pop(future)
                try:
                    result = future.result()
                except BrokenProcessPool:
                    broken.append(task)
                    continue
                except Exception as error:
                    result = lost(error)
                deaths = 0
                if alone:
                    suspects.popleft()
                yield task, result
            if broken:
                self._pool = None
                if alone:
                    deaths += 1
                    if deaths > MOST_DEATHS:
                        raise InputError(f"workers: {deaths} processes died one after the other, and none lived")
                    yield suspects.popleft(), {"lost": DIED}
                else:
                    suspects.extend([*broken, *flying.values()])
                    flying.clear()

    def _submit(self, work: Work[T], task: T) -> Future[dict[str, Any]]:
        for _ in range(2):
            if self._pool is None:
                self._pool = process_pool(self._workers)
            try:
                return self._pool.submit(work, task)
            except BrokenProcessPool:  # a worker was killed while it was idle
                self._pool = None
        raise InputError("workers: every process that was started died at once")


class Dask:
    """Workers of Dask: those of a scheduler, or processes of this machine where no address is given."""

    def __init__(self, scheduler: str | None, workers: int) -> None:
        try:
            from distributed import Client, LocalCluster
        except ImportError as error:
            raise InputError("Dask: expected distributed, found none; pip install '.[dask]'") from error
        try:
            self._cluster: Any = None
            if scheduler is None:
                self._cluster = LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=":0")
            self._client: Any = Client(scheduler or self._cluster)
        except (OSError, ValueError) as error:
            raise InputError(f"scheduler: expected the address of a Dask scheduler, found none: {error}") from error

    def __enter__(self) -> Dask:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self._client.close()
        if self._cluster is not None:
            self._cluster.close()

    def run(self, work: Work[T], tasks: Iterable[T]) -> Iterator[tuple[T, dict[str, Any]]]:
        """As `Runner` says; Dask itself runs again what a worker that died was doing.

        A scheduler that died may come back within the half minute in which Dask looks for it, and is then given again
        what was in flight. Else an `InputError` says so; what was done until then has been handed in. Tasks go out and
        results come in by the batch: one at a time they cost a client more than 64 workers leave it.
        """
        waiting, again = iter(tasks), list[T]()
        flying: dict[Any, T] = {}
        ended: SimpleQueue[Any] = SimpleQueue()
        workers = 0
        while True:
            if len(flying) <= workers * AHEAD:
                workers = self._workers() or workers or 1
                batch = [*again, *islice(waiting, max(0, workers * (1 + AHEAD) - len(flying) - len(again)))]
                again.clear()
                futures: list[Any] = self._client.map(work, batch, pure=False) if batch else []
                for task, future in zip(batch, futures, strict=True):
                    flying[future] = task
                    future.add_done_callback(ended.put)
            if not flying:
                return
            futures = self._ended(ended)
            results = self._results(futures)
            for future in futures:
                task = flying.pop(future)
                if future in results:
                    yield task, results[future]
                else:  # it went with the scheduler
                    again.append(task)

    def _workers(self) -> int:
        """Threads of all workers that are there by now; 0 where there is none, or nobody says."""
        self._await_scheduler()
        with suppress(OSError):
            return sum(self._client.nthreads().values())
        return 0

    def _ended(self, ended: SimpleQueue[Any]) -> list[Any]:
        """Futures that ended, at least one."""
        futures: list[Any] = []
        while not futures:
            with suppress(Empty):
                futures.append(ended.get(timeout=PAUSE))
                while True:
                    futures.append(ended.get_nowait())
            self._await_scheduler()
        return futures

    def _results(self, futures: Sequence[Any]) -> dict[Any, dict[str, Any]]:
        """Of those that ended by themselves; of all others there is none, as of all where the scheduler dies now."""
        finished = [future for future in futures if future.status == "finished"]
        results = {future: lost(future.exception()) for future in futures if future.status == "error"}
        with suppress(OSError, CancelledError):
            results |= zip(finished, self._client.gather(finished), strict=True)
        return results

    def _await_scheduler(self) -> None:
        while self._client.status != "running":
            if self._client.status == "closed":
                raise InputError("scheduler: it died; what is done is kept: start it, and run the batch again")
            time.sleep(PAUSE)


def lost(error: object) -> dict[str, Any]:
    """A result that says why there is none."""
    return {"lost": " ".join(f"{type(error).__name__}: {error}".split())}
