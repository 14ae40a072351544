"""Judge `retrue` on simulated cases whose truth is known; a row a kind.

    python -m benchmarks.judgement.run --kind all --trials 100 --jobs 2
    python -m benchmarks.judgement.run --kind "focal camera, rich" --trials 200 --dump failures.jsonl
    python -m benchmarks.judgement.run --kind "focal camera, rich" --only 17

A pose is wrong when it is more than 5 of its own sigma and more than 0.2 deg off, in rotation or direction of t.
Columns: `lens` how many answers call the lens checked / unchecked / changed; `sure` the wrong ones that call it
checked or changed; `lazy` the unchecked ones whose points know both focal lengths to 1 %; `owed` the cases whose
points contradict the lenses handed in by 6 sigma at any pose, and before it how many of them were called changed or
answered right; `tell` of how many cases the points allow an answer inside the limits of `retrue` (Cramer-Rao), and
`kept` the share of those that was answered and right; `NEES` mean normalised error squared of the five parameters (5
is honest); `z` the mean of (error / sigma)^2 of rotation and of direction of t (1 is honest), `e` of (error /
bound)^2 (1 is efficient); `<3s` the share with both within 3 sigma; then the medians of both errors and of the larger
focal length's.
"""

from __future__ import annotations

import argparse
import ast
import dataclasses
import json
import os
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")  # a process for each core; threads below them would only wait
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

import retrue

from .kinds import GROUPS, KINDS, Kind, draw
from .lens import PRIORS
from .score import LENS_SIGMAS, Outcome, ask

ANSWERED = ("accepted", "unchanged")
KNOWN_FOCAL = 0.01


def trial(name: str, prior: str, old: float | None, settings: Mapping[str, Any], seed: int) -> Outcome:
    """One case, drawn and judged."""
    return ask(name, seed, KINDS[name].job, draw(name, seed, prior, old), settings)


def failed(kind: Kind, outcome: Outcome) -> bool:
    """Whether a reader wants to see the case again: no answer, a wrong one, or the wrong word."""
    if kind.job == "recalibrate":
        return outcome.verdict not in ANSWERED
    words = {"verify": ("good", "drifted"), "reconstruct": ("written", "refused")}[kind.job]
    return outcome.verdict != words[bool(kind.drift or kind.mislead or kind.spoil)]


def within_limits(outcome: Outcome) -> bool:
    """Whether the points could tell the pose to what `retrue` asks for."""
    return outcome.at_best is not None and bool(outcome.at_best.error <= retrue.RecalibrateOptions().max_error)


def mean(values: Sequence[Any], form: str = "{:.2f}", of: Any = np.mean) -> str:
    """That average of what is known, or a dash."""
    known = [v for v in values if v is not None and np.isfinite(v)]
    return form.format(of(known)) if known else "-"


def pose_row(outcomes: list[Outcome]) -> list[str]:
    """Of the answers of `recalibrate`."""
    verdicts = Counter(o.verdict for o in outcomes)
    given = [o for o in outcomes if o.off is not None and o.sigma is not None]
    lens = Counter(o.lens for o in outcomes)
    sure = [o for o in outcomes if o.verdict == "wrong" and o.lens in ("checked", "changed")]
    owed = [o for o in outcomes if o.at_best and o.at_best.against > LENS_SIGMAS]
    paid = [o for o in owed if o.lens == "changed" or o.verdict in ANSWERED or "LensChanged" in o.reason]
    lazy = [o for o in outcomes if o.lens == "unchecked" and o.at_best and (o.at_best.lens[:, 0] < KNOWN_FOCAL).all()]
    tell = [o for o in outcomes if within_limits(o)]
    kept = [o for o in tell if o.verdict in ANSWERED]
    with np.errstate(all="ignore"):
        z = np.array([o.off / o.sigma for o in given]).reshape(-1, 2)  # type: ignore[operator]
        best = np.array([o.off / o.at_best.pose for o in given]).reshape(-1, 2)  # type: ignore[operator, union-attr]
    return [
        *(str(verdicts[v]) for v in ("accepted", "wrong", "unchanged", "refused", "error")),
        "/".join(str(lens[v]) for v in ("checked", "unchecked", "changed")),
        str(len(sure)),
        str(len(lazy)),
        f"{len(paid)}/{len(owed)}" if owed else "-",
        str(len(tell)),
        f"{100 * len(kept) / len(tell):.0f}%" if tell else "-",
        mean([o.nees for o in given]),
        mean(z[:, 0] ** 2) + " " + mean(z[:, 1] ** 2),
        mean(best[:, 0] ** 2) + " " + mean(best[:, 1] ** 2),
        f"{100 * np.mean((z < 3).all(axis=1)):.0f}%" if len(z) else "-",
        mean([o.off[0] for o in given], "{:.3f}", np.median),  # type: ignore[index]
        mean([o.off[1] for o in given], "{:.3f}", np.median),  # type: ignore[index]
        mean([None if o.focal_off is None else 100 * o.focal_off for o in given], "{:.2f}%", np.median),
        mean([1000 * o.seconds for o in outcomes], "{:.0f}", np.median),
    ]


def word_row(words: Sequence[str], outcomes: list[Outcome]) -> list[str]:
    """Of answers that are a word."""
    verdicts = Counter(o.verdict for o in outcomes)
    return [
        *(str(verdicts[v]) for v in (*words, "error")),
        str(len(outcomes) - sum(verdicts[v] for v in (*words, "error"))),
        mean([o.nees for o in outcomes if o.verdict == "good"]),
        mean([o.at_best.pose[0] for o in outcomes if o.at_best], "{:.3f}", np.median),
        mean([o.at_best.pose[1] for o in outcomes if o.at_best], "{:.3f}", np.median),
        mean([1000 * o.seconds for o in outcomes], "{:.0f}", np.median),
    ]


POSE_COLUMNS = {
    "accept": 7,
    "wrong": 6,
    "unchg": 6,
    "refuse": 7,
    "error": 6,
    "lens": 9,
    "sure": 5,
    "lazy": 5,
    "owed": 7,
}
POSE_COLUMNS |= {"tell": 5, "kept": 5, "NEES": 7, "z": 15, "e": 15, "<3s": 6, "rot": 7, "t": 7, "focal": 7, "ms": 6}
WORDS = {"verify": ("good", "drifted", "unknown"), "reconstruct": ("written", "refused")}


def table(job: str) -> tuple[list[str], list[int]]:
    """Headings and widths."""
    if job == "recalibrate":
        return list(POSE_COLUMNS), list(POSE_COLUMNS.values())
    head = [*WORDS[job], "error", "other", "d2 good", "best rot", "best t", "ms"]
    return head, [9] * len(head)


def line(name: str, cells: Sequence[str], widths: Sequence[int]) -> str:
    return f"{name:24}" + "".join(f"{cell:>{width}}" for cell, width in zip(cells, widths, strict=True))


def setting(text: str) -> tuple[str, Any]:
    """NAME=VALUE, the value a Python literal, else a word."""
    name, _, value = text.partition("=")
    try:
        return name, ast.literal_eval(value)
    except (ValueError, SyntaxError):
        return name, value


def plain(value: Any) -> Any:
    """For JSON."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return dataclasses.asdict(value)
    return str(value)


def _without_figures(reason: str) -> str:
    return re.sub(r"[\d.]*\d", "#", reason)[:70]


def show_reasons(outcomes: list[Outcome]) -> None:
    """The commonest, by the name of their type where they have one."""
    said = Counter(
        f"{o.verdict}: {o.reason.split(':')[0] if o.verdict in ('refused', 'unknown') else _without_figures(o.reason)}"
        for o in outcomes
    )
    for reason, count in said.most_common(8):
        print(f"    {count:5} {reason}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--kind", default="all", help=f"a kind, or a group: {', '.join(GROUPS)}; semicolons between some"
    )
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument(
        "--seed", type=int, default=0, help="the trials of a kind have seeds from 1000000 times this on"
    )
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--prior", choices=list(PRIORS), default="foreign", help="how well the lenses were calibrated")
    parser.add_argument("--old", type=float, help="how far the old pose is off, at most, in degrees")
    parser.add_argument("--reasons", action="store_true")
    parser.add_argument("--dump", type=Path, metavar="FILE", help="append what failed, a line of JSON each")
    parser.add_argument("--only", type=int, metavar="SEED", help="replay one case of one kind, and print all of it")
    parser.add_argument("--list", action="store_true", help="print the kinds of each group")
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="a field of RecalibrateOptions, for ablations"
    )
    arguments = parser.parse_args()
    settings = dict(setting(text) for text in arguments.set)
    if arguments.list:
        for group, kinds in GROUPS.items():
            print(f"{group}: {'; '.join(kinds)}")
        return
    names: list[str] = []
    for asked in arguments.kind.split(";"):
        if asked.strip() not in KINDS and asked.strip() not in GROUPS:
            parser.error(f"--kind: expected names that --list prints, found {asked.strip()!r}")
        names += GROUPS.get(asked.strip(), [asked.strip()])
    if arguments.only is not None:
        for name in names:
            outcome = trial(name, arguments.prior, arguments.old, settings, arguments.only)
            print(json.dumps(dataclasses.asdict(outcome), default=plain, indent=2))
        return
    seeds = range(arguments.seed * 1_000_000, arguments.seed * 1_000_000 + arguments.trials)
    job = ""
    with ProcessPoolExecutor(arguments.jobs) as pool:
        for name in names:
            if KINDS[name].job != job:
                job = KINDS[name].job
                head, widths = table(job)
                print(line(f"of {arguments.trials} each", head, widths), flush=True)
            run = partial(trial, name, arguments.prior, arguments.old, settings)
            outcomes = list(pool.map(run, seeds, chunksize=max(1, min(8, arguments.trials // arguments.jobs))))
            print(
                line(name, pose_row(outcomes) if job == "recalibrate" else word_row(WORDS[job], outcomes), widths),
                flush=True,
            )
            if arguments.reasons:
                show_reasons(outcomes)
            if arguments.dump:
                with arguments.dump.open("a", encoding="utf-8") as file:
                    for outcome in outcomes:
                        if failed(KINDS[name], outcome):
                            file.write(json.dumps(dataclasses.asdict(outcome), default=plain) + "\n")


if __name__ == "__main__":
    main()
