"""`retrue project`."""

from __future__ import annotations

import contextlib
import signal
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from retrue.cli.command import Command, Outcome, log
from retrue.cli.terminal import terminal
from retrue.errors import InputError

if TYPE_CHECKING:
    from retrue.geometry.arrays import Image

FOREVER = 1e9  # seconds


@dataclass(frozen=True, kw_only=True)
class Project(Command):
    """Show pictures on the projector, full screen and pixel for pixel, for whoever takes the photographs otherwise.

    Attributes
    ----------
    shown
        A pattern, JSON, or pictures of the screen's own size.
    screen
        Number of the projector among the screens, from 0.
    seconds
        How long each picture stays. Without it: until Space, Enter or an arrow is pressed; Esc ends.
    """

    shown: Positional[Annotated[tuple[Path, ...], arg(metavar="P.json|PICTURE...")]]
    screen: int
    seconds: float | None = None

    def run(self) -> Outcome:
        from retrue.devices.shown_pictures import fitting
        from retrue.devices.steady import SteadyProjector
        from retrue.devices.window_projector import WindowProjector

        if not self.shown:
            raise InputError("expected a pattern, JSON, or pictures to show, found none")
        if self.seconds is not None and not self.seconds > 0:
            raise InputError(f"--seconds: expected more than 0, found {self.seconds:g}")
        pictures = [picture for path in self.shown for picture in _pictures(path)]
        window = WindowProjector(self.screen)
        window.open()
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        with contextlib.closing(window), contextlib.suppress(KeyboardInterrupt):
            projector = SteadyProjector(window, log, FOREVER)
            ready = [(name, fitting(picture, projector, name)) for name, picture in pictures]
            index = 0
            while 0 <= index < len(ready):
                name, picture = ready[index]
                projector.show(picture)
                terminal.status(f"{name}: {index + 1} of {len(ready)} on {window.name}; Esc ends")
                wish = projector.wait(self.seconds or FOREVER)
                if wish == "quit":
                    break
                index = max(index - 1, 0) if wish == "back" else index + 1
        return Outcome({"pictures": len(pictures), "screen": self.screen}, "ended")


def _pictures(path: Path) -> list[tuple[str, Image]]:
    """Each with its name."""
    from retrue.files.images import read_image
    from retrue.files.patterns import read_pattern

    if path.suffix.lower() != ".json":
        return [(str(path), read_image(path))]
    rendered = read_pattern(path).render()
    if not isinstance(rendered, list):
        return [(str(path), rendered)]
    return [(f"{path}, picture {number}", picture) for number, picture in enumerate(rendered, start=1)]
