"""`retrue rollback`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from tyro.conf import Positional, arg

from retrue.cli.command import Command, Outcome, RigPath, log

RECENT = 20  # entries, among which damaged lines are told


@dataclass(frozen=True, kw_only=True)
class Rollback(Command):
    """Put an earlier rig back in place; that is written into the history too, so it can be undone.

    Attributes
    ----------
    rig
        The rig file.
    entry
        Which one, as `retrue history` numbers them; without it the one before, and once more the one before that.
    """

    rig: RigPath
    entry: Positional[Annotated[int | None, arg(metavar="ID")]] = None

    def run(self) -> Outcome:
        from retrue.cli.json_output import pose_report
        from retrue.files.history import read_history, roll_back

        for line in read_history(self.rig, RECENT).damaged:
            log(f"{line}; passed over")
        entry = roll_back(self.rig, self.entry)
        report = {
            "id": entry.id,
            "restored": entry.restored,
            "projector_from_camera": pose_report(entry.rig.projector_from_camera),
        }
        return Outcome(report, f"{self.rig}: rolled back to entry {entry.restored}, which is entry {entry.id} now")
