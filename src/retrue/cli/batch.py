"""`retrue batch`."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import Positional, arg

from retrue.cli.command import DONE, REFUSED_OR_DRIFTED, Command, Outcome, log, require_writable
from retrue.cli.terminal import terminal
from retrue.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from retrue.batch.batch import Row
    from retrue.batch.runners import Dask, Pool
    from retrue.report.page import Page

MOST_TOLD = 10  # failures


@dataclass(frozen=True, kw_only=True)
class Batch(Command):
    """Verify, follow and reconstruct many captures of many rigs; what is done is not done again.

    Attributes
    ----------
    job
        What to do, TOML: rig, pattern, captures, do, out.
    workers
        Processes to work with; by default one a core.
    scheduler
        Address of a Dask scheduler whose workers see the same paths; needs `pip install '.[dask]'`.
    dask
        Dask's own processes on this machine, instead of the pool.
    report
        A page to write, HTML: the rig over time, what failed, all captures.
    """

    job: Positional[Annotated[Path, arg(metavar="JOB.toml")]]
    workers: int | None = None
    scheduler: str | None = None
    dask: bool = False
    report: Annotated[Path | None, arg(metavar="PAGE.html")] = None

    def run(self) -> Outcome:
        from retrue.batch.batch import run_batch
        from retrue.batch.job import read_jobs
        from retrue.batch.summary import counts, write_summary

        require_writable(self.report)
        jobs = read_jobs(self.job)
        start = time.perf_counter()
        rows: list[Row] = []
        tasks = 0
        reports: list[dict[str, Any]] = []
        with runner_of(self.workers, self.scheduler, self.dask) as runner:
            for job in jobs:
                found, done = run_batch(job, runner, lambda what, done, total: terminal.progress(what)(done, total))
                write_summary(job.out, found)
                rows, tasks = rows + found, tasks + done
                reports.append({"out": str(job.out), "rig": str(job.rig), **counts(found)})
        failed = [row for row in rows if row.failed]
        for row in failed[:MOST_TOLD]:
            log(f"{row.name}: {row.failed}")
        if len(failed) > MOST_TOLD:
            log(f"and {len(failed) - MOST_TOLD} more; summary.csv has them all")
        report = {**counts(rows), "jobs": reports, "tasks": tasks, "seconds": time.perf_counter() - start}
        moved = any(row.result.get("verdict") == "drifted" for row in rows)
        status = REFUSED_OR_DRIFTED if failed or moved else DONE
        page = None if self.report is None else (self.report, self._page(rows))
        return Outcome(report, "\n".join(map(_told, reports)), status, page)

    def _page(self, rows: Sequence[Row]) -> Page:
        from retrue.batch.summary import counts, values
        from retrue.report.batch_page import batch_page

        return batch_page(counts(rows), [values(row) for row in rows])


def runner_of(workers: int | None, scheduler: str | None, dask: bool) -> Pool | Dask:
    """Who does the work, as the options say."""
    from retrue.batch.runners import Dask, Pool

    workers = (os.cpu_count() or 1) if workers is None else workers
    if not workers >= 1:
        raise InputError(f"--workers: expected 1 or more, found {workers}")
    return Dask(scheduler, workers) if dask or scheduler is not None else Pool(workers)


def _told(report: dict[str, Any]) -> str:
    names = ("good", "drifted", "unknown", "clouds", "failed")
    rest = "".join(f", {report[name]} {name}" for name in names if report[name])
    return f"{report['out']}: {report['captures']} captures{rest}"
