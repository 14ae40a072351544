"""`retrue recalibrate`."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeGuard

from tyro.conf import OmitArgPrefixes

from retrue.cli.command import (
    DONE,
    REFUSED_OR_DRIFTED,
    AFile,
    CapturePaths,
    Outcome,
    PatternPath,
    RigPath,
    require_writable,
    with_advice,
)
from retrue.cli.photographs import PhotographCommand, axes_report, axes_text
from retrue.errors import InputError
from retrue.recalibration.options import RecalibrateOptions

if TYPE_CHECKING:
    from retrue.capture import Capture
    from retrue.recalibration.result import Accepted, Refused
    from retrue.report.page import Page
    from retrue.rig import Rig


@dataclass(frozen=True, kw_only=True)
class Recalibrate(PhotographCommand):
    """Find the pose of a rig again from what it sees now; any scene will do.

    Attributes
    ----------
    rig
        The rig as it was last calibrated; its lenses are kept, but for --lens refit.
    captures
        Pictures (colour grid), folders of pictures (Gray code) or points CSVs, all taken since it moved; with --stereo
        pairs of photographs.
    pattern
        What the projector showed, JSON; not needed for a CSV.
    out
        The new rig file; the same rig again where it still holds. Nothing is written when the answer is refused.
    in_place
        Instead of --out: write the new rig over the old one, and keep both in the history beside it. Where the points
        cannot check the lenses, only with --lens fixed.
    limits
        Limits of the method.
    """

    rig: RigPath
    captures: CapturePaths
    pattern: PatternPath = None
    out: AFile | None = None
    in_place: bool = False
    limits: OmitArgPrefixes[RecalibrateOptions] = field(default_factory=RecalibrateOptions)

    def run(self) -> Outcome:
        from retrue.cli.json_output import recalibration_report
        from retrue.files.rigs import read_rig
        from retrue.recalibration.axes import axes_of
        from retrue.recalibration.recalibrate import recalibrate
        from retrue.recalibration.result import Accepted, unattended

        if (self.out is None) == (not self.in_place):
            raise InputError("expected one of --out NEW.json and --in-place")
        require_writable(self.rig if self.in_place else self.out, self.report, made_of=(*self.captures, self.pattern))
        rig = read_rig(self.rig)
        captures = self.read(rig, self.captures, self.pattern)
        start = time.perf_counter()
        result = recalibrate(rig, [capture.points for capture in captures], self.limits)
        seconds = time.perf_counter() - start
        result = unattended(result) if self.in_place else result
        report = recalibration_report(result, seconds)
        axes = axes_of(rig.projector_from_camera, result.evidence) if self.stereo else ()
        if self.stereo:
            report |= {"axes": axes_report(axes)}
        page = None if self.report is None else (self.report, self._page(rig, captures, result))
        said = _described(result, rig.unit)
        if axes:
            said += f"\n{axes_text(axes)}"
        if not isinstance(result, Accepted):
            refused = Outcome(report, f"{said}\nnothing was written", REFUSED_OR_DRIFTED, page)
            return self.told(with_advice(refused, captures))
        if result.unchanged and self.in_place:
            kept = f"{self.rig}: nothing was written, the rig in it still holds"
            report |= {"out": None, "history_id": None}
            return self.told(with_advice(Outcome(report, f"{said}\n{kept}", DONE, page), captures))
        written = self._write(result)
        same = ", the same rig" if result.unchanged else ""
        text = f"{said}\n{written['out']}: written{same}"
        return self.told(with_advice(Outcome(report | written, text, DONE, page), captures))

    def _page(self, rig: Rig, captures: list[Capture], result: Accepted | Refused) -> Page:
        from retrue.report.recalibration_page import recalibration_page

        out = str(self.rig if self.in_place else self.out)
        return recalibration_page(rig, captures, result, out="" if result.verdict == "unchanged" else out)

    def _write(self, result: Accepted) -> dict[str, Any]:
        if self.out is not None:
            from retrue.files.rigs import write_rig

            write_rig(self.out, result.rig)
            return {"out": str(self.out)}
        from retrue.files.history import capture_record, write_in_place

        entry = write_in_place(self.rig, result, [capture_record(capture) for capture in self._files()])
        return {"out": str(self.rig), "history_id": entry.id}

    def _files(self) -> list[Path]:
        """What a history records: captures, or each photograph of each pair."""
        if not self.takes_photographs(self.captures):
            return list(self.captures)
        from retrue.files.pairs import stereo_pairs

        return [path for pair in stereo_pairs(self.captures) for path in pair]


def _described(result: Accepted | Refused, unit: str) -> str:
    """The answer in a few lines."""
    from retrue.recalibration.summary import lens_condition, lens_text
    from retrue.shown import figures

    evidence = result.evidence
    condition = "" if result.verdict == "refused" else lens_condition(evidence.lenses)
    lines = [f"{result.verdict}{condition and f', {condition}'}: {result.reason}"]
    lines.append(f"from {evidence.correspondences} correspondences")
    if evidence.rms_px is not None:
        lines[-1] += f", RMS {evidence.rms_px:.3f} px"
    if evidence.lenses is not None:
        lines.append(f"lenses: {lens_text(evidence.lenses)}")
    if evidence.change is not None:
        change = evidence.change
        lines.append(f"moved by {change.rotation_deg:.3f} deg, direction of t by {change.translation_deg:.3f} deg")
    if evidence.sigma is not None:
        sigma = evidence.sigma
        lines.append(f"sigma {sigma.rotation_deg:.3f} deg, direction of t {sigma.translation_deg:.3f} deg")
    if evidence.change is not None and _is_known(evidence.change.displacement):
        distance = f"{figures(evidence.working_distance, 4)} {unit}"
        lines.append(f"points at {distance} were off by {figures(evidence.change.displacement, 4)} {unit}")
        if evidence.sigma is not None and _is_known(evidence.sigma.displacement):
            lines[-1] += f", are now within {figures(evidence.sigma.displacement)} {unit} (sigma)"
    if evidence.scale:
        lines.append(f"scale: {evidence.scale}")
    return "\n".join(lines)


def _is_known(length: float | None) -> TypeGuard[float]:
    return length is not None and isfinite(length)
