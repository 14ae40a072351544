"""The jobs of many watches on processes that they share; each asks for one thing at a time, so that all get theirs."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import ParamSpec, TypeVar

from retrue.correspondences import Correspondences
from retrue.errors import InputError
from retrue.patterns.pattern import Pattern
from retrue.processes import process_pool
from retrue.recalibration.options import VerifyOptions
from retrue.rig import Rig
from retrue.watch.frame import Frame
from retrue.watch.stages import Stages, cloud_written, decoded, verified

P = ParamSpec("P")
T = TypeVar("T")


class WorkPool:
    """Calls functions in processes. What one of them died with is called once more, by itself."""

    def __init__(self, workers: int) -> None:
        self._workers = workers
        self._lock = threading.Lock()
        self._pool: ProcessPoolExecutor | None = None

    def __enter__(self) -> WorkPool:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        with self._lock:
            if self._pool is not None:
                self._pool.shutdown(wait=False, cancel_futures=True)

    def call(self, function: Callable[P, T], *given: P.args, **named: P.kwargs) -> T:
        """What the function returns, or raises; `InputError` where the process died with it twice."""
        with self._lock:
            pool = self._pool = self._pool or process_pool(self._workers)
        try:
            return pool.submit(function, *given, **named).result()
        except BrokenProcessPool:
            with self._lock:
                if self._pool is pool:
                    self._pool = None
        with process_pool(1) as alone:
            try:
                return alone.submit(function, *given, **named).result()
            except BrokenProcessPool as error:
                raise InputError("the process that worked on it died: killed, or out of memory") from error


def pooled_stages(pattern: Pattern | None, clouds: Path | None, options: VerifyOptions, pool: WorkPool) -> Stages:
    """The jobs of the package, as `real_stages` has them, on a pool."""
    from retrue.recalibration.recalibrate import recalibrate

    def decode(frame: Frame) -> Correspondences:
        here = frame.content is None or isinstance(frame.content, Correspondences)
        return decoded(pattern, frame) if here else pool.call(decoded, pattern, frame)

    def write_cloud(rig: Rig, points: Correspondences, name: str) -> Path:
        assert clouds is not None
        return pool.call(cloud_written, clouds, rig, points, name)

    return Stages(
        decode,
        partial(pool.call, partial(verified, options=options)),
        partial(pool.call, partial(recalibrate, options=options.estimate)),
        None if clouds is None else write_cloud,
    )
