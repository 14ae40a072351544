"""`retrue pattern`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from retrue.cli.command import Command, Outcome, made_folder
from retrue.errors import InputError

LARGEST_SIDE = 16384  # pixels; beyond any projector, and its pictures still fit into memory


@dataclass(frozen=True, kw_only=True)
class Pattern(Command):
    """Make the pictures to project, and the pattern.json that decodes them.

    Attributes
    ----------
    kind
        One picture for a single capture, or a sequence for dense points.
    projector_size
        Width and height of the projector in pixels.
    out
        Folder for the PNG pictures and pattern.json; made where it is not there.
    """

    kind: Positional[Literal["color-grid", "line-grid", "gray-code"]]
    projector_size: tuple[int, int]
    out: Path

    def run(self) -> Outcome:
        from retrue.files.images import write_png
        from retrue.files.patterns import write_pattern
        from retrue.patterns.color_grid import make_color_grid
        from retrue.patterns.gray_code import GrayCode
        from retrue.patterns.line_grid import make_line_grid

        if not all(1 <= side <= LARGEST_SIDE for side in self.projector_size):
            width, height = self.projector_size
            raise InputError(f"--projector-size: expected two sides of 1 to {LARGEST_SIDE}, found {width} x {height}")
        if self.kind != "gray-code":
            make = make_color_grid if self.kind == "color-grid" else make_line_grid
            pattern = make(self.projector_size)
            pictures = {"pattern.png": pattern.render()}
        else:
            pattern = GrayCode(self.projector_size)
            pictures = {f"pattern_{number:02d}.png": picture for number, picture in enumerate(pattern.render())}
        folder = made_folder(self.out)
        for name, picture in pictures.items():
            write_png(folder / name, picture)
        write_pattern(folder / "pattern.json", pattern)
        report = {
            "kind": self.kind,
            "projector_size": list(self.projector_size),
            "pattern": str(folder / "pattern.json"),
            "pictures": [str(folder / name) for name in pictures],
        }
        return Outcome(report, f"{folder}: {len(pictures)} picture(s) to project, and pattern.json")
