"""Many captures of a rig: look at each, find when the rig had moved, make each cloud with the rig that held then."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

from retrue.batch.job import Job
from retrue.batch.ledger import Ledger, Stamp, opened_ledger, stamp_of
from retrue.batch.runners import Runner
from retrue.batch.tasks import Look, Renew, is_kept, paths_of, work
from retrue.errors import FileError
from retrue.files.atomic import read_bytes
from retrue.recalibration.streak import (
    Drifted,
    Streak,
    StreakOptions,
    after_drifted,
    after_good,
    after_refusal,
    after_unknown,
    attempts,
    is_due,
)

Progress = Callable[[str, int, int], None]
"""Called with what is being done, how many are done, and how many there are."""

LARGEST_INPUT = 2**27  # bytes of a rig or a pattern
AHEAD = 64  # captures that are verified with a rig before it is known whether they are the last that it holds for
SORTED = json.JSONEncoder(sort_keys=True)
MOVED = "the rig had moved, and the captures gave no new one"
NO_CLOUD = "no cloud is made with a rig that does not hold"


@dataclass(frozen=True, slots=True)
class Row:
    """What became of a capture.

    Attributes
    ----------
    rig : that held for it.
    result : as its tasks said: correspondences, verdict, points of the cloud.
    failed : why there is none, or not all that was asked for.
    """

    name: str
    rig: Path
    result: Mapping[str, Any]
    failed: str = ""


@dataclass(slots=True)
class Batch:
    """One job, and what is known of it by now."""

    job: Job
    runner: Runner
    ledger: Ledger
    progress: Progress
    stamps: dict[str, Stamp] = field(default_factory=dict[str, Stamp])
    digests: dict[Path, str] = field(default_factory=dict[Path, str])
    contexts: dict[tuple[Any, ...], str] = field(default_factory=dict[tuple[Any, ...], str])
    done: int = 0
    checked: bool = False

    def rows(self) -> list[Row]:
        """Every capture, in their order."""
        looks = [self.look(number) for number in range(len(self.job.captures))]
        if "recalibrate" not in self.job.do:
            results = self.results("captures", looks)
            return [_row(task.name, task.rig, results[task.name]) for task in looks]
        kept = [replace(task, verify=True, cloud=None, points=self.points_path(task)) for task in looks]
        verified = self._verified_in_order(kept)
        if "reconstruct" not in self.job.do:
            return verified
        holding = [row for row in verified if not row.failed]
        clouds = [
            replace(task, verify=False, rig=row.rig, points=known.points)
            for task, known, row in zip(looks, kept, verified, strict=True)
            if not row.failed
        ]
        made = self.results("clouds", clouds)
        rows = {row.name: _row_with(row, made[row.name]) for row in holding}
        return [rows.get(row.name, row) for row in verified]

    def look(self, number: int) -> Look:
        """What the job asks of a capture, with the rig that it names."""
        job, name = self.job, self.job.names[number]
        cloud = job.out / f"clouds/{name}.ply" if "reconstruct" in job.do else None
        verify = bool({"verify", "recalibrate"} & job.do)
        return Look(name, job.captures[number], job.pattern, job.rig, job.limits, verify, None, cloud)

    def points_path(self, task: Look) -> Path:
        """Where what is decoded of this capture is kept: of the picture as it is now, and no other."""
        try:
            digest = _digest([self._stamp(task), self._digest(task.pattern)])
        except FileError:  # gone: its task will say so
            digest = "none"
        return self.job.out / f"points/{task.name}.{digest[:12]}.npz"

    def _verified_in_order(self, looks: Sequence[Look]) -> list[Row]:
        """Follow the rig through time; a rig that the captures give holds from the first that had drifted."""
        options = StreakOptions(**self.job.limits.get("streak", {}))
        first = self.results("captures", looks)  # decoded once, all at once
        rows: list[Row] = []
        rig, begun, streak, tried = self.job.rig, -1, Streak(), set[tuple[Path, tuple[int, ...]]]()
        found, why = dict(first), dict[tuple[Path, int], str]()  # what spoke against a new rig
        while len(rows) < len(looks):
            number = len(rows)
            name = looks[number].name
            if name not in found:
                block = [item for item in looks[number : number + AHEAD] if item.name not in found]
                found |= self.results("", [replace(item, rig=rig) for item in block])
            row = _row(name, rig, found[name])
            rows.append(row)
            streak = _after(streak, number, row, options)
            if not is_due(streak, options):
                continue
            for numbers in attempts(streak, options):
                if (rig, numbers) in tried or streak.drifted[0].number == begun:
                    continue
                tried.add((rig, numbers))
                renewed = self._renewed(rig, [looks[item] for item in numbers])
                if isinstance(renewed, str):
                    why |= {(rig, item): renewed for item in numbers}
                else:
                    rig, begun = renewed, streak.drifted[0].number
                    del rows[begun:]
                    streak, found = Streak(), {}
                    break
            else:
                streak = after_refusal(streak)
        return [
            replace(row, failed=f"{MOVED}: {why.get((row.rig, number), NO_CLOUD)}")
            if row.result.get("verdict") == "drifted" and not row.failed
            else row
            for number, row in enumerate(rows)
        ]

    def _renewed(self, rig: Path, looks: Sequence[Look]) -> Path | str:
        """The rig that these captures give; else why not."""
        points = tuple(task.points for task in looks if task.points is not None)
        names = [task.name for task in looks]
        context = _digest([self._digest(rig), names, [self.stamps[name] for name in names]])
        out = self.job.out / "rigs" / f"{looks[0].name}.{context[:8]}.json"
        task = Renew(f"rig from {names[0]}", points, rig, self.job.limits, out)
        result = self.results("", [task])[task.name]
        return str(result.get("refused") or result.get("lost") or "") or out

    def results(self, what: str, tasks: Sequence[Look | Renew]) -> dict[str, Mapping[str, Any]]:
        """Of each task by its name: known, or done now."""
        results: dict[str, Mapping[str, Any]] = {}
        todo: list[Look | Renew] = []
        contexts: dict[str, str] = {}
        for task in tasks:
            contexts[task.name] = context = self._context(task)
            try:
                stamp = self._stamp(task)
            except FileError as error:
                results[task.name] = {"failed": error.problem}
                continue
            result = self.ledger.result(task.name, context, stamp, paths_of(task))
            if result is None or not ("failed" in result or is_kept(task)):
                todo.append(task)
            else:
                results[task.name] = result
        if todo:
            self._check_inputs()
        for done, (task, result) in enumerate(self.runner.run(work, todo), start=1):
            if "lost" not in result:
                self.ledger.write(task.name, contexts[task.name], self._stamp(task), paths_of(task), result)
            results[task.name] = result
            self.done += 1
            if what:
                self.progress(what, done, len(todo))
        return results

    def _check_inputs(self) -> None:
        """Before the first task: where all is done already, they were read then, and are the same."""
        if not self.checked:
            check_inputs(self.job)
            self.checked = True

    def _stamp(self, task: Look | Renew) -> Stamp:
        if isinstance(task, Renew):
            return []
        if task.name not in self.stamps:
            self.stamps[task.name] = stamp_of(task.capture)
        return self.stamps[task.name]

    def _context(self, task: Look | Renew) -> str:
        """A digest of all that goes in beside the capture; most captures have the same."""
        if isinstance(task, Renew):
            asked: tuple[Any, ...] = (task.rig, task.out.name)
        else:
            asked = (task.rig, task.verify, task.cloud is not None, task.points is not None, self._digest(task.pattern))
        if asked not in self.contexts:
            limits = {name: dict(values) for name, values in task.limits.items()}
            self.contexts[asked] = _digest([version("retrue"), self._digest(task.rig), limits, *asked[1:]])
        return self.contexts[asked]

    def _digest(self, path: Path | None) -> str:
        if path is None:
            return ""
        if path not in self.digests:
            self.digests[path] = hashlib.sha256(read_bytes(path, LARGEST_INPUT)).hexdigest()
        return self.digests[path]


def run_batch(job: Job, runner: Runner, progress: Progress) -> tuple[list[Row], int]:
    """Rows of all captures, and how many tasks that took now. Raises `FileError` for a rig or pattern of no use."""
    with opened_ledger(job.out) as ledger:
        batch = Batch(job, runner, ledger, progress)
        return batch.rows(), batch.done


def check_inputs(job: Job) -> None:
    """Raises `FileError` for a rig or a pattern that cannot be read."""
    from retrue.files.patterns import read_pattern
    from retrue.files.rigs import read_rig

    read_rig(job.rig)
    if job.pattern is not None:
        read_pattern(job.pattern)


def _after(streak: Streak, number: int, row: Row, options: StreakOptions) -> Streak:
    verdict = row.result.get("verdict")
    if verdict == "good":
        return after_good()
    if verdict == "unknown":
        return after_unknown(streak, options)
    if verdict != "drifted":  # no picture that says anything
        return streak
    sigma = row.result["sigma"]
    uncertainty = float("inf") if sigma is None else sigma["rotation_deg"] + sigma["translation_deg"]
    return after_drifted(streak, Drifted(number, uncertainty), options)


def _row(name: str, rig: Path, result: Mapping[str, Any]) -> Row:
    return Row(name, rig, result, str(result.get("failed") or result.get("lost") or ""))


def _row_with(row: Row, result: Mapping[str, Any]) -> Row:
    failed = str(result.get("failed") or result.get("lost") or "")
    return replace(row, result={**row.result, **result}, failed=failed)


def _digest(values: Any) -> str:
    return hashlib.sha256(SORTED.encode(values).encode()).hexdigest()
