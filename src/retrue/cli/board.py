"""`retrue board`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from retrue.cli.command import Command, Outcome, require_writable


@dataclass(frozen=True, kw_only=True)
class Board(Command):
    """Make the board to print for a calibration, true to size, with a ruler that checks the printer.

    Attributes
    ----------
    spec
        chessboard:COLUMNSxROWS:SQUARE (inner corners), circles:..., asymmetric-circles:..., or
        charuco:COLUMNSxROWS:SQUARE:MARKER:DICTIONARY (squares), as `retrue calibrate --board` takes it.
    paper
        A4, A3, A2, A1, A0, Letter, Legal, Tabloid, or a size such as 300x200mm.
    out
        The file, .pdf or .svg.
    """

    spec: Positional[Annotated[str, arg(metavar="BOARD")]]
    paper: str = "A4"
    out: Path

    def run(self) -> Outcome:
        from retrue.calibration.board import parse_board
        from retrue.files.board_sheet import lay_out_board, write_board

        laid = lay_out_board(parse_board(self.spec), self.spec, self.paper)
        require_writable(self.out)
        write_board(self.out, laid.sheet)
        width, height = laid.size_mm
        report = {"board": self.spec, "paper": self.paper, "size_mm": [width, height], "out": str(self.out)}
        how = f"{width:g} x {height:g} mm on {self.paper}{', on its side' if laid.landscape else ''}"
        return Outcome(report, f"{self.out}: {how}; print it at 100 % and measure its ruler")
