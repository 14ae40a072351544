"""`retrue accept`."""

from __future__ import annotations

import hashlib
import shlex
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import OmitArgPrefixes, arg

from retrue.acceptance.options import AcceptOptions
from retrue.cli.command import (
    DONE,
    REFUSED_OR_DRIFTED,
    AFile,
    CapturePaths,
    Outcome,
    PatternPath,
    ReportingCommand,
    RigPath,
    require_writable,
    with_advice,
)
from retrue.errors import InputError

if TYPE_CHECKING:
    from retrue.acceptance.accept import Acceptance
    from retrue.capture import Capture
    from retrue.report.certificate import Particulars


@dataclass(frozen=True, kw_only=True)
class Accept(ReportingCommand):
    """Test a rig on a calibrated artefact, after VDI/VDE 2634 part 2, and write a certificate.

    Put a ball, a ball bar or a plate into the measuring volume, one capture for each position of it; it is found by
    itself. Exit status 1 where a value is beyond its limit, where its uncertainty leaves that open, or where nothing
    could be measured.

    Attributes
    ----------
    rig
        The rig file, as it stands now.
    captures
        One of each position: pictures, folders of pictures, or points CSVs.
    pattern
        What the projector showed, JSON; not needed for a CSV.
    artefact
        sphere:DIAMETER, spheres:DIAMETER:DISTANCE or plane; lengths as calibrated, 25.4mm or 25.4012mm+-0.0008mm
        with the expanded uncertainty (k = 2) of the calibration.
    out
        The certificate to write, PDF; needs `pip install '.[certificate]'`. Left out: the values are only printed.
    serial
        Serial numbers and whatever else names the devices and the artefact, NAME=VALUE each.
    place
        Where it was measured.
    operator
        Who measured.
    number
        Of the certificate; the time, unless given.
    limits
        Limits of the test.
    """

    rig: RigPath
    captures: CapturePaths
    pattern: PatternPath = None
    artefact: Annotated[str, arg(metavar="ARTEFACT")]
    out: AFile | None = None
    serial: Annotated[tuple[str, ...], arg(metavar="NAME=VALUE")] = ()
    place: str = ""
    operator: str = ""
    number: str = ""
    limits: OmitArgPrefixes[AcceptOptions] = field(default_factory=AcceptOptions)

    def run(self) -> Outcome:
        from retrue.acceptance.accept import accept
        from retrue.acceptance.artefact import parse_artefact
        from retrue.files.rigs import read_rig
        from retrue.reconstruction.options import ReconstructOptions
        from retrue.reconstruction.reconstruct import reconstruct

        artefact = parse_artefact(self.artefact)
        named = [word.partition("=") for word in self.serial]
        for name, mark, _ in named:
            if not (name and mark):
                raise InputError(f"--serial: expected NAME=VALUE, such as camera=40123456, found {name}")
        if self.out is not None:
            from retrue.report.certificate import require_certificate

            require_certificate(self.out)
        require_writable(self.out, made_of=(self.rig, *self.captures, self.pattern))
        rig = read_rig(self.rig)
        captures = self.read(rig, self.captures, self.pattern, one_coordinate=True, photographs=self.out is not None)
        start = time.perf_counter()
        everything = ReconstructOptions(
            keep_strays=True
        )  # an acceptance test leaves out three in a thousand, and no more
        clouds = [reconstruct(rig, capture.points, everything) for capture in captures]
        answer = accept(clouds, artefact, self.limits, names=[capture.name for capture in captures])
        seconds = time.perf_counter() - start
        if self.out is not None and answer.verdict != "refused":
            self._write(answer, captures, {name: value for name, _, value in named})
        good = answer.verdict in ("passed", "measured")
        report = _report(answer) | {"out": None if answer.verdict == "refused" or self.out is None else str(self.out)}
        text = _text(answer)
        if report["out"] is not None:
            text += f"\n{self.out}: certificate written"
        status = DONE if good else REFUSED_OR_DRIFTED
        return with_advice(Outcome(report | {"seconds": seconds}, text, status), captures)

    def _write(self, answer: Acceptance, captures: list[Capture], named: dict[str, str]) -> None:
        from retrue.files.atomic import replaced_file
        from retrue.report.certificate import certificate_pdf

        assert self.out is not None
        photographs = {capture.name: capture.photograph for capture in captures}
        content = certificate_pdf(answer, self._particulars(named), photographs)
        with replaced_file(self.out) as stream:
            stream.write(content)

    def _particulars(self, named: dict[str, str]) -> Particulars:
        """What stands in the certificate beside the values."""
        from datetime import UTC, datetime

        from retrue.pages import versions
        from retrue.report.certificate import Particulars

        now = datetime.now(UTC)
        files = [self.rig, *([] if self.pattern is None else [self.pattern]), *self.captures]
        return Particulars(
            number=self.number or now.strftime("%Y%m%d-%H%M%S"),
            made=now.strftime("%Y-%m-%d %H:%M UTC"),
            place=self.place,
            operator=self.operator,
            devices=named,
            command=shlex.join(["retrue", *sys.argv[1:]]),
            versions=versions(),
            hashes={str(path): _hash(path) for path in files},
        )


def _hash(path: Path) -> str:
    """SHA-256 of a file; of a folder, of the names and bytes of its files in order."""
    digest = hashlib.sha256()
    for file in sorted(path.iterdir()) if path.is_dir() else [path]:
        if file.is_file():
            if path.is_dir():
                digest.update(file.name.encode(errors="surrogateescape") + b"\0")
            digest.update(file.read_bytes())
    return digest.hexdigest()


def _report(answer: Acceptance) -> dict[str, Any]:
    from retrue.acceptance.accept import SYMBOLS
    from retrue.answers import answer_report
    from retrue.plain_json import plain

    positions = [
        {
            "name": position.name,
            "points": len(position.residuals),
            "centre": plain(position.centre),
            "refused": None if position.cause is None else str(position.cause),
            "values": [
                {
                    "quantity": value.quantity,
                    "symbol": SYMBOLS[value.quantity],
                    "part": value.part,
                    "value": value.value,
                    "expanded_uncertainty": value.expanded,
                    "limit": value.limit,
                    "decision": value.decision,
                }
                for value in position.values
            ],
        }
        for position in answer.positions
    ]
    return answer_report(answer) | {"artefact": str(answer.artefact), "unit": answer.unit, "positions": positions}


def _text(answer: Acceptance) -> str:
    """A table of the values, in 80 columns."""
    from retrue.acceptance.accept import SYMBOLS
    from retrue.shown import counted, figures, figures_beside

    lines = [f"{answer.verdict}: {answer.reason}", f"{answer.artefact}, in {answer.unit}, U with k = 2"]
    wanted = answer.artefact.positions
    if len(answer.positions) < wanted:
        lines.append(
            f"an interim check: {counted(len(answer.positions), 'position')}, VDI/VDE 2634 part 2 asks for {wanted}"
        )
    lines.append(f"  {'position':<28}{'':<4}{'':<8}{'value':>10}{'U':>9}{'limit':>9}  decision")
    for position in answer.positions:
        name = position.name if len(position.name) <= 27 else f"...{position.name[-24:]}"
        if position.cause is not None:
            lines.append(f"  {name:<28}{position.cause}")
        for value in position.values:
            limit = "-" if value.limit is None else figures(value.limit)
            found = figures_beside(value.value, value.expanded)
            lines.append(
                f"  {name:<28}{SYMBOLS[value.quantity]:<4}{value.part:<8}{found:>10}"
                f"{figures(value.expanded):>9}{limit:>9}  {value.decision}"
            )
    return "\n".join(lines)
