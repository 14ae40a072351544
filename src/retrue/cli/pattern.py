"""`retrue pattern`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

from tyro.conf import Positional, arg

from retrue.cli.command import Command, Outcome, made_folder
from retrue.errors import InputError

if TYPE_CHECKING:
    from retrue.patterns.color_grid import ColorGrid
    from retrue.patterns.gray_code import GrayCode
    from retrue.patterns.line_grid import LineGrid
    from retrue.patterns.sequence import FrameSequence

LARGEST_SIDE = 16384  # pixels; beyond any projector, and its pictures still fit into memory
AXES = {"both": ("column", "row"), "columns": ("column",), "rows": ("row",)}
ONLY_FOR = {
    "color-grid": ("rows", "columns", "pitch", "block", "camera_size", "rig", "distance"),
    "line-grid": ("axes",),
    "gray-code": ("step",),
    "phase-shift": ("period", "steps", "turns", "axes"),
    "sequence": ("layout", "axes"),
}


@dataclass(frozen=True, kw_only=True)
class Pattern(Command):
    """Make the pictures to project, and the pattern.json that decodes them.

    Attributes
    ----------
    kind
        One picture for a single capture (color-grid, line-grid), or a sequence for dense points: gray-code,
        phase-shift, or what another tool projects (sequence).
    projector_size
        Width and height of the projector in pixels.
    out
        Folder for the PNG pictures and pattern.json; made where it is not there. It may hold no other pictures,
        as of an earlier pattern.
    rows
        Of blocks of a colour grid; 40 by default.
    columns
        Of blocks of a colour grid; 51 by default.
    pitch
        From block to block of a colour grid, in projector pixels; the largest that fits, by default.
    block
        Side of a block of a colour grid, in projector pixels.
    camera_size
        Width and height of the camera's picture: makes the blocks of a colour grid about 9 camera pixels wide where
        the picture just holds what the projector lights, or, with the rig and the distance, exactly there.
    rig
        A rig file, to know how many camera pixels a projector pixel covers.
    distance
        From the camera to the scene, in the rig's unit.
    step
        Width of the finest stripes of a Gray code, in projector pixels.
    period
        Of the finest sine of a phase shift, in projector pixels.
    steps
        Shifts of each sine; more are quieter, and see less of gamma.
    turns
        What tells the turns of the finest sine: a Gray code, coarser sines, or sines of coprime periods.
    axes
        Columns alone give depth with a known rig; a pose needs rows, too. Of a line grid columns alone are stripes.
    layout
        Of another tool: procam-calibration, opencv, 3dunderworld, scan3d-capture, sltk, structuredlight,
        structuredlight-phase, slstudio-gray, slstudio-2x3, slstudio-nstep, slstudio-3, slstudio-4.
    """

    kind: Positional[Literal["color-grid", "line-grid", "gray-code", "phase-shift", "sequence"]]
    projector_size: tuple[int, int]
    out: Path
    rows: int | None = None
    columns: int | None = None
    pitch: int | None = None
    block: int | None = None
    camera_size: tuple[int, int] | None = None
    rig: Annotated[Path | None, arg(metavar="RIG")] = None
    distance: float | None = None
    step: int | None = None
    period: float | None = None
    steps: int | None = None
    turns: Literal["gray", "cue", "coprime"] | None = None
    axes: Literal["both", "columns", "rows"] | None = None
    layout: str | None = None

    def run(self) -> Outcome:
        from retrue.files.capture_folder import require_no_other_pictures
        from retrue.files.images import write_png
        from retrue.files.patterns import write_pattern
        from retrue.patterns.color_grid import ColorGrid
        from retrue.patterns.line_grid import LineGrid

        if not all(1 <= side <= LARGEST_SIDE for side in self.projector_size):
            width, height = self.projector_size
            raise InputError(f"--projector-size: expected two sides of 1 to {LARGEST_SIDE}, found {width} x {height}")
        self._require_options()
        pattern = self._pattern()
        if isinstance(pattern, ColorGrid | LineGrid):
            pictures = {"pattern.png": pattern.render()}
        else:
            pictures = {f"pattern_{number:02d}.png": picture for number, picture in enumerate(pattern.render())}
        require_no_other_pictures(self.out, pictures)
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

    def _require_options(self) -> None:
        """An `InputError` for an option of another kind of pattern."""
        for name in dict.fromkeys(name for names in ONLY_FOR.values() for name in names):
            kinds = [kind for kind, names in ONLY_FOR.items() if name in names]
            if getattr(self, name) is not None and self.kind not in kinds:
                option = name.replace("_", "-")
                raise InputError(f"--{option}: expected with {' or '.join(kinds)}, found with {self.kind}")

    def _pattern(self) -> ColorGrid | LineGrid | GrayCode | FrameSequence:
        from retrue.patterns.gray_code import GrayCode
        from retrue.patterns.layouts import LAYOUTS, layout_sequence
        from retrue.patterns.line_grid import make_line_grid
        from retrue.patterns.phase_shift import make_phase_shift

        if self.kind == "color-grid":
            return self._color_grid()
        if self.kind == "line-grid":
            grid = make_line_grid(self.projector_size)
            absent = {"columns": {"rows": None}, "rows": {"columns": None}}.get(self.axes or "both", {})
            return replace(grid, **absent)
        if self.kind == "gray-code":
            return GrayCode(self.projector_size, 1 if self.step is None else self.step)
        axes = None if self.axes is None else cast("tuple[Literal['column', 'row'], ...]", AXES[self.axes])
        if self.kind == "sequence":
            if self.layout is None:
                raise InputError(f"--layout: expected one of {', '.join(LAYOUTS)}, found none")
            return layout_sequence(self.layout, self.projector_size, axes)
        given: dict[str, Any] = {"period_px": self.period, "steps": self.steps, "turns": self.turns, "axes": axes}
        return make_phase_shift(self.projector_size, **{key: v for key, v in given.items() if v is not None})

    def _color_grid(self) -> ColorGrid:
        from retrue.patterns.color_grid import grid_for_camera, make_color_grid

        magnification = self._magnification()
        if magnification is None:
            given: dict[str, Any] = {
                "rows": self.rows,
                "columns": self.columns,
                "pitch": self.pitch,
                "block": self.block,
            }
            return make_color_grid(self.projector_size, **{key: v for key, v in given.items() if v is not None})
        if not (self.rows is self.columns is self.pitch is self.block is None):
            raise InputError("--rows, --columns, --pitch, --block: expected without --camera-size and --rig")
        return grid_for_camera(self.projector_size, magnification)

    def _magnification(self) -> float | None:
        """Camera pixels that a projector pixel covers; None where nobody says how the camera looks."""
        from retrue.files.rigs import read_rig
        from retrue.rig_difference import magnification

        if self.rig is None:
            if self.distance is not None:
                raise InputError("--distance: expected with --rig, which knows both lenses, found alone")
            if self.camera_size is None:
                return None
            return max(mine / its for mine, its in zip(self.camera_size, self.projector_size, strict=True))
        if self.distance is None:
            raise InputError("--rig: expected with --distance, from the camera to the scene, found alone")
        return magnification(read_rig(self.rig), self.distance)
