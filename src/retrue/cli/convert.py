"""`retrue convert`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from retrue.cli.command import Command, Outcome, log, require_writable


@dataclass(frozen=True, kw_only=True)
class Convert(Command):
    """Carry a rig from one tool's format to another's; what a format cannot hold is asked for, or warned of.

    Attributes
    ----------
    source
        The file to read: ours, or another tool's, told by its content.
    out
        The file to write; YAML, XML or JSON as its name ends, where the format has a choice.
    to
        Name of the format to write; `retrue convert A B --to help` lists them.
    camera_size
        Width and height, where the source does not hold them.
    projector_size
        The same for the projector.
    unit
        Of length, where the source does not hold it.
    """

    source: Positional[Annotated[Path, arg(metavar="A")]]
    out: Positional[Annotated[Path, arg(metavar="B")]]
    to: Annotated[str, arg(metavar="NAME")] = "retrue"
    camera_size: tuple[int, int] | None = None
    projector_size: tuple[int, int] | None = None
    unit: str | None = None

    def run(self) -> Outcome:
        from retrue.errors import InputError
        from retrue.files.foreign_rigs import RIG_FORMATS
        from retrue.files.rigs import read_rig, write_rig

        if self.to not in RIG_FORMATS:
            raise InputError(f"--to: expected one of {', '.join(RIG_FORMATS)}, found {self.to}")
        require_writable(self.out)
        rig = read_rig(self.source, camera_size=self.camera_size, projector_size=self.projector_size, unit=self.unit)
        lost = write_rig(self.out, rig, self.to)
        if lost:
            log(f"{self.out}: {self.to} cannot hold {', '.join(lost)}")
        return Outcome({"out": str(self.out), "to": self.to, "lost": list(lost)}, f"{self.out}: written as {self.to}")
