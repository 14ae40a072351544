"""`retrue calibrate`."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import OmitArgPrefixes, arg

from retrue.calibration.options import CalibrationOptions
from retrue.cli.command import (
    DONE,
    REFUSED_OR_DRIFTED,
    CapturePaths,
    Outcome,
    ReportingCommand,
    require_writable,
)
from retrue.cli.terminal import terminal

if TYPE_CHECKING:
    from retrue.calibration.board import Board
    from retrue.calibration.result import Calibrated, RefusedCalibration
    from retrue.calibration.views import BoardCapture
    from retrue.patterns.pattern import Pattern
    from retrue.recalibration.result import Verification
    from retrue.report.page import Page


@dataclass(frozen=True, kw_only=True)
class Calibrate(ReportingCommand):
    """Find the intrinsics of both devices and the pose between them, from captures of a printed board.

    At its end, each capture that the rig rests on is verified with it. Exit status 1 where one contradicts the rig,
    which is written all the same.

    Attributes
    ----------
    captures
        Folders, one a pose of the board: a Gray code, or two pictures, lit white and by the colour grid.
    pattern
        What the projector showed, JSON.
    board
        What is printed: chessboard:7x9:75mm (inner corners), charuco:5x7:30mm:22mm, circles:..., asymmetric-circles:...
    out
        The rig file to write. Nothing is written when the answer is refused.
    camera
        A file that holds intrinsics of the camera which are known and stay as they are.
    projector
        The same for the projector.
    limits
        Limits of the method.
    """

    captures: CapturePaths
    pattern: Annotated[Path, arg(metavar="P.json")]
    board: Annotated[str, arg(metavar="KIND:SIZE:LENGTH")]
    out: Path
    camera: Path | None = None
    projector: Path | None = None
    limits: OmitArgPrefixes[CalibrationOptions] = field(default_factory=CalibrationOptions)

    def run(self) -> Outcome:
        from retrue.answers import answer_report
        from retrue.calibration.board import parse_board
        from retrue.calibration.calibrate import calibrate
        from retrue.calibration.result import Calibrated
        from retrue.cli.json_output import plain
        from retrue.errors import InputError
        from retrue.files.board_captures import read_board_captures
        from retrue.files.captures import pictures_size
        from retrue.files.patterns import read_pattern
        from retrue.files.rigs import read_device, write_rig
        from retrue.rasters import check_alike

        require_writable(self.out, self.report)
        if not self.captures:
            raise InputError("expected at least one CAPTURE folder, found none")
        board = parse_board(self.board)
        pattern = read_pattern(self.pattern)
        sizes = [(str(path), size) for path in self.captures if (size := pictures_size(path)) is not None]
        check_alike(sizes)
        camera = projector = None
        if self.camera is not None:
            camera = read_device(self.camera, "camera", size=sizes[0][1] if sizes else None)
        if self.projector is not None:
            projector = read_device(self.projector, "projector", size=pattern.projector_size)
        start = time.perf_counter()
        captures = read_board_captures(self.captures, pattern, board, terminal.status)
        result = calibrate(
            captures,
            board,
            pattern.projector_size,
            self.limits,
            camera=camera,
            projector=projector,
            progress=terminal.status,
        )
        seconds = time.perf_counter() - start
        report = {**answer_report(result), **plain(result.evidence), "seconds": seconds}
        text = "\n".join([f"{result.verdict}: {result.reason}", *_described(result.evidence)])
        page = None if self.report is None else (self.report, self._page(result, captures, board, pattern))
        if not isinstance(result, Calibrated):
            return Outcome(report, f"{text}\nnothing was written", REFUSED_OR_DRIFTED, page)
        checks = _checks(result, captures)
        report["check"] = [{"name": name, **answer_report(check)} for name, check in checks.items()]
        write_rig(self.out, result.rig)
        text = "\n".join([text, *_checked(checks), f"{self.out}: written"])
        doubted = any(check.forbids_measuring for check in checks.values())
        return Outcome(report, text, REFUSED_OR_DRIFTED if doubted else DONE, page)

    def _page(
        self, result: Calibrated | RefusedCalibration, captures: list[BoardCapture], board: Board, pattern: Pattern
    ) -> Page:
        from retrue.calibration.views import picture_size
        from retrue.report.calibration_page import calibration_page

        sizes = {"camera": picture_size(captures[0].white), "projector": pattern.projector_size}
        return calibration_page(result, sizes, board.unit, out=str(self.out))


def _checks(result: Calibrated, captures: list[BoardCapture]) -> dict[str, Verification]:
    """What `retrue verify` says of the new rig and each capture that it rests on, by the capture's name."""
    from retrue.recalibration.verify import verify

    used = {view.name for view in result.views}
    checks: dict[str, Verification] = {}
    for capture in captures:
        if capture.name in used:
            terminal.status(f"verifying {capture.name}")
            checks[capture.name] = verify(result.rig, [capture.points])
    return checks


def _checked(checks: Mapping[str, Verification]) -> list[str]:
    """A line for all that hold, and one for each that does not."""
    good = sum(check.verdict == "good" for check in checks.values())
    lines = [f"check: {good} of {len(checks)} of its own captures verify"]
    return lines + [f"  {name}: {check.reason}" for name, check in checks.items() if check.verdict != "good"]


def _described(evidence: Mapping[str, Any]) -> list[str]:
    """What was left out, and what to capture next, a line each."""
    left_out = [f"left out {view['name']}: {view['reason']}" for view in evidence.get("left_out", ())]
    return left_out + [f"advice: {advice}" for advice in evidence.get("advice", ())]
