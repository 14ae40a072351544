"""`retrue diff`."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from retrue.cli.command import Command, Outcome


@dataclass(frozen=True, kw_only=True)
class Diff(Command):
    """Say how far two rigs of the same devices are apart, and what that does to a measurement.

    Attributes
    ----------
    first
        A rig file.
    second
        Another one.
    working_distance
        Depth of the scene in the rig's unit; else as the first rig's evidence has it, or the second's.
    """

    first: Positional[Annotated[Path, arg(metavar="A")]]
    second: Positional[Annotated[Path, arg(metavar="B")]]
    working_distance: float | None = None

    def run(self) -> Outcome:
        from retrue.files.history import known_working_distance
        from retrue.files.rigs import read_rig
        from retrue.plain_json import plain
        from retrue.rig_difference import rig_difference

        first, second = read_rig(self.first), read_rig(self.second)
        distance = self.working_distance
        if distance is None:
            distance = known_working_distance(self.first, first) or known_working_distance(self.second, second)
        difference = rig_difference(first, second, distance)
        unit = first.unit
        lines = [
            f"rotation        {difference.rotation_deg:.4f} deg",
            f"direction of t  {difference.translation_deg:.4f} deg",
            f"t               {difference.translation:.4g} {unit}",
            f"|t|             {round(difference.length, 9):+.4g} {unit}",
        ]
        if distance is None:
            lines.append("give --working-distance for what that does to a point there")
        else:
            lines.append(f"a point at {distance:.4g} {unit} lands {difference.displacement:.4g} {unit} away (RMS)")
        return Outcome({**plain(asdict(difference)), "unit": unit}, "\n".join(lines))
