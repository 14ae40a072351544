"""`retrue calibrate`."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import OmitArgPrefixes, arg

from retrue.calibration.options import CalibrationOptions
from retrue.cli.command import (
    DONE,
    REFUSED_OR_DRIFTED,
    AFile,
    CapturePaths,
    Outcome,
    ReportingCommand,
    require_writable,
)
from retrue.cli.terminal import terminal

if TYPE_CHECKING:
    from retrue.calibration.board import Board
    from retrue.calibration.result import Calibrated
    from retrue.calibration.views import Capture
    from retrue.patterns.pattern import Pattern
    from retrue.rasters import Size
    from retrue.recalibration.result import Verification


@dataclass(frozen=True, kw_only=True)
class Calibrate(ReportingCommand):
    """Find the intrinsics of both devices and the pose between them, from captures of a printed board.

    At its end, each capture that the rig rests on is verified with it. Exit status 1 where one contradicts the rig,
    which is written all the same.

    Attributes
    ----------
    captures
        One a pose of the board: a folder of a Gray code or another sequence; of two pictures, lit white and by the
        colour grid; or a picture of the board, with a points CSV of the same name beside it. With --stereo: two
        folders, of the left and the right camera's pictures; one that holds both; or pairs, left and right in turn.
    pattern
        What the projector showed, JSON; not needed for points, nor for two cameras.
    stereo
        Calibrate two cameras: the second one stands for the projector. With --pattern, both saw that code, and are
        matched through it.
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
    board: Annotated[str, arg(metavar="KIND:SIZE:LENGTH")]
    out: Path
    pattern: Annotated[AFile | None, arg(metavar="P.json")] = None
    stereo: bool = False
    camera: AFile | None = None
    projector: AFile | None = None
    limits: OmitArgPrefixes[CalibrationOptions] = field(default_factory=CalibrationOptions)

    def run(self) -> Outcome:
        from retrue.answers import answer_report
        from retrue.calibration.board import parse_board
        from retrue.calibration.calibrate import calibrate
        from retrue.calibration.result import Calibrated
        from retrue.cli.json_output import plain
        from retrue.files.patterns import read_pattern
        from retrue.files.rigs import read_device, write_rig

        require_writable(self.out, self.report, made_of=(*self.captures, self.pattern, self.camera, self.projector))
        board = parse_board(self.board)
        pattern = None if self.pattern is None else read_pattern(self.pattern)
        camera_size, projector_size = self._sizes(pattern)
        camera = projector = None
        if self.camera is not None:
            camera = read_device(self.camera, "camera", size=camera_size)
        if self.projector is not None:
            projector = read_device(self.projector, "projector", size=projector_size)
            projector_size = projector.size
        start = time.perf_counter()
        captures = self._read(pattern, board)
        if projector_size is None:
            projector_size = _said_by_points(captures)
        result = calibrate(
            captures,
            board,
            projector_size,
            self.limits,
            camera=camera,
            projector=projector,
            progress=terminal.status,
        )
        seconds = time.perf_counter() - start
        report = {**answer_report(result), **plain(result.evidence), "seconds": seconds}
        text = "\n".join([f"{result.verdict}: {result.reason}", *_described(result.evidence)])
        page = None
        if self.report is not None:
            from retrue.report.calibration_page import calibration_page

            sizes = {"camera": camera_size or projector_size, "projector": projector_size}
            page = self.report, calibration_page(result, sizes, board.unit, out=str(self.out))
        if not isinstance(result, Calibrated):
            return Outcome(report, f"{text}\nnothing was written", REFUSED_OR_DRIFTED, page)
        checks = _checks(result, captures)
        report["check"] = [{"name": name, **answer_report(check)} for name, check in checks.items()]
        write_rig(self.out, result.rig)
        text = "\n".join([text, *_checked(checks), f"{self.out}: written"])
        doubted = any(check.forbids_measuring for check in checks.values())
        return Outcome(report, text, REFUSED_OR_DRIFTED if doubted else DONE, page)

    def _sizes(self, pattern: Pattern | None) -> tuple[Size | None, Size | None]:
        """Of both devices' pictures, before any work; None where only the captures will tell."""
        from retrue.errors import InputError
        from retrue.files.board_captures import picture_with_points
        from retrue.files.captures import pictures_size
        from retrue.files.pairs import stereo_pairs
        from retrue.rasters import check_alike

        if not self.captures:
            raise InputError("expected at least one CAPTURE, found none")
        if self.stereo:
            pairs = stereo_pairs(self.captures, coded=pattern is not None)
            for side in zip(*pairs, strict=True):
                check_alike([(str(path), size) for path in side if (size := pictures_size(path)) is not None])
            left, right = pairs[0]
            return pictures_size(left), pictures_size(right)
        shown = [(path, (picture_with_points(path) or (path,))[0]) for path in self.captures]
        sizes = [(str(path), size) for path, picture in shown if (size := pictures_size(picture)) is not None]
        check_alike(sizes)
        return sizes[0][1] if sizes else None, pattern.projector_size if pattern is not None else None

    def _read(self, pattern: Pattern | None, board: Board) -> Sequence[Capture]:
        if self.stereo:
            from retrue.files.stereo_captures import read_stereo_captures

            return read_stereo_captures(self.captures, board, pattern, terminal.status)
        from retrue.files.board_captures import read_board_captures

        return read_board_captures(self.captures, pattern, board, terminal.status)


def _said_by_points(captures: Sequence[Capture]) -> Size:
    """The projector's size, as points files say it."""
    from retrue.calibration.views import BoardCapture
    from retrue.errors import CaptureError

    said = [capture.points.projector_size for capture in captures if isinstance(capture, BoardCapture)]
    known = next((size for size in said if size is not None), None)
    if known is None:
        raise CaptureError(
            captures[0].name,
            "nobody said how large the projector's picture is: begin the points CSV with "
            "'# projector_size=1024x768', or give --pattern or --projector",
        )
    return known


def _checks(result: Calibrated, captures: Sequence[Capture]) -> dict[str, Verification]:
    """What `retrue verify` says of the new rig and each capture that it rests on, by the capture's name.

    Those that have matched points of both coordinates: of board corners or one coordinate alone, none is asked.
    """
    from retrue.recalibration.verify import verify

    used = {view.name for view in result.views}
    checks: dict[str, Verification] = {}
    for capture in captures:
        points = capture.points
        if capture.name in used and points is not None and len(points.axes) == 2:
            terminal.status(f"verifying {capture.name}")
            checks[capture.name] = verify(result.rig, [points])
    return checks


def _checked(checks: Mapping[str, Verification]) -> list[str]:
    """A line for all that hold, and one for each that does not."""
    good = sum(check.verdict == "good" for check in checks.values())
    if not checks:
        return []
    lines = [f"check: {good} of {len(checks)} of its own captures verify"]
    return lines + [f"  {name}: {check.reason}" for name, check in checks.items() if check.verdict != "good"]


def _described(evidence: Mapping[str, Any]) -> list[str]:
    """What was left out, and what to capture next, a line each."""
    left_out = [f"left out {view['name']}: {view['reason']}" for view in evidence.get("left_out", ())]
    return left_out + [f"advice: {advice}" for advice in evidence.get("advice", ())]
