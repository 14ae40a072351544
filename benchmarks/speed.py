"""The page of speed, in one run: whole processes, pictures and points, each beside what others take.

python benchmarks/speed.py [--quick] [--rounds 15] [--renders FOLDER] [--write docs/speed.md]
    [--sequence CAPTURE pattern.json [rig.json]]...

All are run in turn; a ratio is the median of the ratios of the turns. Each library that is not installed is a row less.
"""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from speed_photographs import SIZE, SMALL, photograph_rows
from speed_pictures import NAMES, render_rows, sequence_rows
from speed_points import FULL, QUICK, point_rows
from speed_processes import process_rows
from speed_rows import Row, machine, table

RENDERS = Path(__file__).parents[1] / "tests" / "data" / "renders"
MEASURED = re.compile(r"(?<=<!-- measured -->\n).*(?=<!-- end of what was measured -->)", re.DOTALL)


def main() -> None:
    options = parsed()
    rounds = 1 if options.quick else options.rounds
    measured: list[Row] = []
    with tempfile.TemporaryDirectory() as scratch:
        for row in all_rows(options, Path(scratch), rounds):
            print(" | ".join(row.cells()), file=sys.stderr, flush=True)
            measured.append(replace(row, goal=None, before=None) if options.quick else row)  # they hold for full sizes
    text = f"{machine(rounds)}\n{table(measured)}"
    print(text, end="")
    if options.write is not None:
        page = options.write.read_text(encoding="utf-8")
        options.write.write_text(with_measured(page, text), encoding="utf-8")


def all_rows(options: argparse.Namespace, scratch: Path, rounds: int) -> Iterator[Row]:
    yield from process_rows(options.renders, scratch, rounds)
    yield from render_rows(options.renders, scratch, rounds, NAMES[:1] if options.quick else NAMES)
    for files in options.sequence:
        yield from sequence_rows(*files, rounds=min(rounds, 7))
    yield from photograph_rows(min(rounds, 7), *((SMALL, 1) if options.quick else (SIZE, 3)))
    yield from point_rows(rounds, QUICK if options.quick else FULL)


def with_measured(page: str, text: str) -> str:
    """The page with its measured part replaced."""
    replaced, count = MEASURED.subn(lambda _: f"\n{text}\n", page)
    if count != 1:
        raise SystemExit("the page has no part between <!-- measured --> and <!-- end of what was measured -->")
    return replaced


def parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="small sizes, one turn: only whether it runs")
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--renders", type=Path, default=RENDERS, help="wall_0.png and the like, with their rigs")
    parser.add_argument(
        "--sequence", type=Path, nargs="+", action="append", default=[], metavar="FILE", help="CAPTURE PATTERN [RIG]"
    )
    parser.add_argument("--write", type=Path, metavar="PAGE", help="replace the measured part of this page")
    options = parser.parse_args()
    if options.rounds < 1:
        parser.error("--rounds must be at least 1")
    if options.write is not None and options.quick:
        parser.error("--write is for measurements; --quick measures nothing")
    if any(len(files) not in (2, 3) for files in options.sequence):
        parser.error("--sequence needs a capture, its pattern, and a rig for a row of its pose")
    if not (options.renders / "wall_0.rig.json").is_file():
        parser.error(f"no wall_0.rig.json in {options.renders}")
    return options


if __name__ == "__main__":
    main()
