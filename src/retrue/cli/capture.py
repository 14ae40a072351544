"""`retrue capture`."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import OmitArgPrefixes, Positional, arg

from retrue.cli.command import Command, Outcome, log, require_writable
from retrue.cli.terminal import terminal
from retrue.devices.options import RecordOptions
from retrue.errors import FileError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from retrue.geometry.arrays import Image
    from retrue.patterns.pattern import Pattern

PAUSE = 2.0  # seconds between two tries to write


@dataclass(frozen=True, kw_only=True)
class Capture(Command):
    """Show a pattern and record it: for each picture the one frame of the camera that shows it, told by its content.

    Attributes
    ----------
    setup
        Which camera and which projector, TOML.
    pattern
        What to show, JSON: of a grid one picture, with white and black around it; or a sequence.
    out
        A new folder for the pictures, there whole or not at all: grid.png, white.png, black.png; or 00.png, 01.png ...
    patience_seconds
        How long to wait for a device that goes away, or a disk that is full.
    limits
        When a frame is taken for the one that shows a picture.
    """

    setup: Positional[Annotated[Path, arg(metavar="SETUP.toml")]]
    pattern: Annotated[Path, arg(metavar="P.json")]
    out: Annotated[Path, arg(metavar="DIR")]
    patience_seconds: float = 60.0
    limits: OmitArgPrefixes[RecordOptions] = field(default_factory=RecordOptions)

    def run(self) -> Outcome:
        from retrue.devices.drivers import make_rig
        from retrue.devices.exposure import find_exposure
        from retrue.devices.recorder import Recorder
        from retrue.devices.setup import LARGEST_SETUP, parse_setup
        from retrue.devices.steady import SteadyCamera, SteadyProjector
        from retrue.files.atomic import read_text
        from retrue.files.capture_folder import require_new_folder
        from retrue.files.patterns import read_pattern
        from retrue.files.rigs import read_rig

        pattern = read_pattern(self.pattern)
        setup = parse_setup(read_text(self.setup, LARGEST_SETUP), self.setup)
        require_new_folder(self.out)
        require_writable(self.out.parent / "picture.png" if self.out.parent.is_dir() else None)
        rig = read_rig(setup.rig) if setup.rig is not None and setup.rig.exists() else None
        start = time.perf_counter()
        with make_rig(setup, rig) as live:
            camera = SteadyCamera(live.camera, log, self.patience_seconds)
            projector = SteadyProjector(live.projector, log, self.patience_seconds)
            if pattern.projector_size != projector.size:
                (wide, high), (width, height) = pattern.projector_size, projector.size
                raise FileError(
                    self.pattern, f"is made for {wide} x {high} pixels, but {projector.name} has {width} x {height}"
                )
            terminal.status("setting the exposure")
            exposure = camera.exposure_ms if "exposure_ms" in setup.camera else find_exposure(camera, projector)
            terminal.status("looking at white and black")
            recorder = Recorder(camera, projector, self.limits)
            names, shown = _shown(pattern)
            frames = recorder.record(shown, terminal.progress("recording"))
        self._write({name: frame.picture for name, frame in zip(names, frames, strict=True)})
        report: dict[str, Any] = {
            "capture": str(self.out),
            "pictures": len(frames),
            "exposure_ms": exposure,
            "seconds": time.perf_counter() - start,
        }
        exposed = "" if exposure is None else f", exposed for {exposure:.3g} ms"
        return Outcome(report, f"{self.out}: {len(frames)} pictures{exposed}")

    def _write(self, pictures: Mapping[str, Image]) -> None:
        """Now, or when the disk has room again."""
        from retrue.files.capture_folder import write_capture

        end, told = time.monotonic() + self.patience_seconds, False
        while True:
            try:
                write_capture(self.out, pictures)
            except FileError as error:
                if time.monotonic() > end:
                    raise
                if not told:
                    log(f"{error}; trying again")
                told = True
                time.sleep(PAUSE)
            else:
                return


def _shown(pattern: Pattern) -> tuple[list[str], list[Any]]:
    """Names, and pictures to show."""
    from retrue.devices.shown_pictures import black_and_white
    from retrue.files.captures import GRID_PICTURES

    pictures = pattern.render()
    if isinstance(pictures, list):
        digits = max(2, len(str(len(pictures) - 1)))
        return [f"{number:0{digits}d}" for number in range(len(pictures))], pictures
    black, white = black_and_white(pattern.projector_size)
    return list(GRID_PICTURES), [pictures, white, black]
