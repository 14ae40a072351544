"""`retrue decode`."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from retrue.cli.command import CapturePath, Command, Outcome, PatternPath, read_captures, require_writable


@dataclass(frozen=True, kw_only=True)
class Decode(Command):
    """Match camera pixels with projector pixels, and write them as CSV.

    Attributes
    ----------
    capture
        A picture (colour grid), a folder of pictures (Gray code), or a points CSV.
    pattern
        What the projector showed, JSON.
    out
        The CSV to write: camera_x,camera_y,projector_x,projector_y and what else is known.
    """

    capture: CapturePath
    pattern: PatternPath = None
    out: Path

    def run(self) -> Outcome:
        from retrue.files.plain_json import plain
        from retrue.files.points import write_points

        require_writable(self.out)
        start = time.perf_counter()
        (points,) = read_captures([self.capture], self.pattern)
        seconds = time.perf_counter() - start
        write_points(self.out, points)
        report = {"correspondences": len(points), "seconds": seconds, "card": plain(points.card), "out": str(self.out)}
        return Outcome(report, f"{self.out}: {len(points)} correspondences, decoded in {seconds:.2f} s")
