"""Run many random trials on all cores; the seed alone decides what comes out, however many cores there are."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import TypeVar

import numpy as np

from retrue.geometry.arrays import FloatArray

C = TypeVar("C")
TRIALS_A_STREAM = 50  # trials that share one random stream

Trial = Callable[[C, np.random.Generator], FloatArray]
Progress = Callable[[int, int], None]


def run_trials(
    trial: Trial[C],
    cells: Sequence[C],
    trials: int,
    seed: int,
    *,
    workers: int | None = None,
    progress: Progress | None = None,
) -> list[FloatArray]:
    """For each cell the results of its trials, (trials, ...).

    Parameters
    ----------
    trial : a function of a module (processes must find it): one cell and its random numbers to an array.
    cells : what to vary.
    workers : processes; all cores if None, this process alone if 1.
    progress : called with the number of chunks done and in all.
    """
    chunks = -(-trials // TRIALS_A_STREAM)
    streams = np.random.SeedSequence(seed).spawn(len(cells) * chunks)
    jobs = [
        (trial, cell, min(TRIALS_A_STREAM, trials - TRIALS_A_STREAM * k), streams[index * chunks + k])
        for index, cell in enumerate(cells)
        for k in range(chunks)
    ]
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    workers = workers or cores
    done: list[FloatArray] = []

    def collect(result: FloatArray) -> None:
        done.append(result)
        if progress is not None:
            progress(len(done), len(jobs))

    if workers == 1:
        for job in jobs:
            collect(_run(job))
    else:
        with ProcessPoolExecutor(workers, get_context("spawn"), initializer=_start_worker) as pool:
            for result in pool.map(_run, jobs):
                collect(result)
    return [np.concatenate(done[k : k + chunks]) for k in range(0, len(done), chunks)]


def _run(job: tuple[Trial[C], C, int, np.random.SeedSequence]) -> FloatArray:
    trial, cell, count, stream = job
    rng = np.random.default_rng(stream)
    return np.array([trial(cell, rng) for _ in range(count)], dtype=np.float64)


def _start_worker() -> None:
    from retrue.experiments.peers import single_threaded

    single_threaded()
