"""`retrue rescan`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import Positional, arg

from retrue.cli.batch import runner_of
from retrue.cli.command import DONE, REFUSED_OR_DRIFTED, Command, Outcome
from retrue.cli.terminal import terminal
from retrue.errors import InputError

if TYPE_CHECKING:
    from retrue.batch.rescan import Stale

MOST_SHOWN = 40  # captures


@dataclass(frozen=True, kw_only=True)
class Rescan(Command):
    """Find captures that were taken after the rig had moved and before anybody knew, and make their clouds again.

    Attributes
    ----------
    job
        The job of a batch, TOML; the history beside its rig tells which rig stood there when.
    since
        Only captures since then, such as 2026-11-24 or 2026-11-24T06:00; local time where no zone is given.
    list
        Only list them, with how far each was off; write no cloud.
    workers
        Processes to work with; by default one a core.
    scheduler
        Address of a Dask scheduler whose workers see the same paths; needs `pip install '.[dask]'`.
    dask
        Dask's own processes on this machine, instead of the pool.
    """

    job: Positional[Annotated[Path, arg(metavar="JOB.toml")]]
    since: Annotated[str | None, arg(metavar="TIME")] = None
    list: bool = False
    workers: int | None = None
    scheduler: str | None = None
    dask: bool = False

    def run(self) -> Outcome:
        from retrue.batch.job import read_jobs
        from retrue.batch.rescan import rescan
        from retrue.files.rigs import read_rig

        since = None if self.since is None else _time(self.since)
        reports: list[dict[str, Any]] = []
        texts: list[str] = []
        open_ones = 0
        with runner_of(self.workers, self.scheduler, self.dask) as runner:
            for job in read_jobs(self.job):
                stale, looked_at = rescan(
                    job, since, runner, lambda what, n, total: terminal.progress(what)(n, total), clouds=not self.list
                )
                unit = read_rig(job.rig).unit
                open_ones += sum(item.cloud is None for item in stale)
                reports.append({"out": str(job.out), "captures": looked_at, "stale": [_report(item) for item in stale]})
                texts.append(_table(job.out, stale, looked_at, unit))
        return Outcome({"jobs": reports}, "\n".join(texts), REFUSED_OR_DRIFTED if open_ones else DONE)


def _time(text: str) -> datetime:
    try:
        return datetime.fromisoformat(text).astimezone()
    except (ValueError, OverflowError, OSError) as error:
        raise InputError(f"--since: expected a time such as 2026-11-24T06:00, found {text[:40]!r}") from error


def _report(item: Stale) -> dict[str, Any]:
    return {
        "capture": item.name,
        "time": item.time.isoformat(timespec="seconds"),
        "made_with": item.made_with,
        "fits": item.fits,
        "off": item.off,
        "inferred": item.inferred,
        "cloud": None if item.cloud is None else str(item.cloud),
        "failed": item.failed,
    }


def _table(out: Path, stale: Sequence[Stale], looked_at: int, unit: str) -> str:
    """One line a capture that must be made again, in 80 columns."""
    from retrue.shown import MISSING, figures

    made = sum(item.cloud is not None for item in stale)
    title = f"{out}: {len(stale)} of {looked_at} captures were measured with a rig that did not hold, {made} made again"
    if not stale:
        return title
    lines = [title, f"  {'time (UTC)':<19}  {'made with':>9}  {'fits':>5}  {'off by, ' + unit[:6]:>14}  capture"]
    for item in stale[:MOST_SHOWN]:
        fits = MISSING if item.fits is None else str(item.fits)
        off = MISSING if item.off is None else figures(item.off, 3)
        lines.append(f"  {item.time:%Y-%m-%d %H:%M:%S}  {item.made_with:>9}  {fits:>5}  {off:>14}  {item.name}")
    if len(stale) > MOST_SHOWN:
        lines.append(f"  and {len(stale) - MOST_SHOWN} more: rescan.csv")
    return "\n".join(lines)
