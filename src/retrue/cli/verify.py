"""`retrue verify`."""

from __future__ import annotations

import time
from dataclasses import dataclass

from retrue.cli.command import (
    DONE,
    REFUSED_OR_DRIFTED,
    CapturePaths,
    Command,
    Outcome,
    PatternPath,
    RigPath,
    read_captures,
)


@dataclass(frozen=True, kw_only=True)
class Verify(Command):
    """Ask whether captures still fit a rig; nothing is written. Exit status 0 only where they do.

    Attributes
    ----------
    rig
        The rig file.
    captures
        Pictures (colour grid), folders of pictures (Gray code) or points CSVs, all taken with the rig as it is now.
    pattern
        What the projector showed, JSON; not needed for a CSV.
    """

    rig: RigPath
    captures: CapturePaths
    pattern: PatternPath = None

    def run(self) -> Outcome:
        from retrue.cli.json_output import verification_report
        from retrue.files.rigs import read_rig
        from retrue.recalibration.verify import verify

        rig = read_rig(self.rig)
        captures = read_captures(self.captures, self.pattern)
        start = time.perf_counter()
        verification = verify(rig, captures)
        report = verification_report(verification, time.perf_counter() - start)
        text = f"{verification.verdict}: {verification.reason}"
        return Outcome(report, text, DONE if verification.verdict == "good" else REFUSED_OR_DRIFTED)
