"""`retrue verify`."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

from tyro.conf import OmitArgPrefixes

from retrue.cli.command import (
    DONE,
    REFUSED_OR_DRIFTED,
    CapturePaths,
    Outcome,
    PatternPath,
    RigPath,
    require_writable,
    with_advice,
)
from retrue.cli.photographs import PhotographCommand, axes_report, axes_text
from retrue.recalibration.options import VerifyOptions


@dataclass(frozen=True, kw_only=True)
class Verify(PhotographCommand):
    """Ask whether captures still fit a rig; nothing is written. Exit status 0 only where they do.

    Attributes
    ----------
    rig
        The rig file.
    captures
        Pictures (colour grid), folders of pictures (Gray code) or points CSVs, all taken with the rig as it is now;
        with --stereo pairs of photographs.
    pattern
        What the projector showed, JSON; not needed for a CSV.
    limits
        Limits of the method.
    """

    rig: RigPath
    captures: CapturePaths
    pattern: PatternPath = None
    limits: OmitArgPrefixes[VerifyOptions] = field(default_factory=VerifyOptions)

    def run(self) -> Outcome:
        from retrue.cli.json_output import verification_report
        from retrue.files.rigs import read_rig
        from retrue.recalibration.axes import axes_of_verification
        from retrue.recalibration.verify import verify

        require_writable(self.report, made_of=(self.rig, *self.captures, self.pattern))
        rig = read_rig(self.rig)
        captures = self.read(rig, self.captures, self.pattern)
        start = time.perf_counter()
        verification = verify(rig, [capture.points for capture in captures], self.limits)
        report = verification_report(verification, time.perf_counter() - start)
        text = f"{verification.band}: {verification.reason}"
        if self.stereo:
            axes = axes_of_verification(rig.projector_from_camera, verification)
            report |= {"axes": axes_report(axes)}
            text += f"\n{axes_text(axes)}" if axes else ""
        page = None
        if self.report is not None:
            from retrue.report.verification_page import verification_page

            page = (self.report, verification_page(rig, captures, verification))
        status = DONE if verification.verdict == "good" else REFUSED_OR_DRIFTED
        return self.told(with_advice(Outcome(report, text, status, page), captures))
