"""`retrue view`."""

from __future__ import annotations

import contextlib
import signal
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from retrue.cli.command import Command, Outcome, log, require_writable

if TYPE_CHECKING:
    from retrue.viewer.scene import Scene


@dataclass(frozen=True, kw_only=True)
class View(Command):
    """Look at rigs, clouds, meshes, points, candidate poses and histories in the browser.

    Attributes
    ----------
    files
        Rig files (with the history beside each), clouds and meshes (PLY, OBJ, STL, GLB), points CSVs (with the rig
        that saw them), and what `retrue recalibrate --json` printed (with the rig).
    host
        Where to listen; only this computer can see what is on 127.0.0.1.
    port
        The port to listen on.
    out
        Write a page that needs no server instead: HTML that loads nothing, to turn, cut and measure.
    compare
        The first of two clouds is "before", the second "after": a slider goes from one to the other.
    """

    files: Positional[Annotated[tuple[Path, ...], arg(metavar="FILE...")]]
    host: str = "127.0.0.1"
    port: int = 8080
    out: Path | None = None
    compare: bool = False

    def run(self) -> Outcome:
        from retrue.viewer.contents import read_contents
        from retrue.viewer.scene import make_scene

        if self.out is not None:
            require_writable(self.out)
        scene = make_scene(read_contents(self.files), compare=self.compare)
        for note in scene.notes:
            log(note)
        return self._served(scene) if self.out is None else self._written(scene, self.out)

    def _written(self, scene: Scene, out: Path) -> Outcome:
        from retrue.files.atomic import replaced_file

        with replaced_file(out) as stream:
            stream.write(scene.page(out.stem).encode(errors="backslashreplace"))
        return Outcome({"out": str(out), "notes": list(scene.notes)}, f"{out}: open it in a browser")

    def _served(self, scene: Scene) -> Outcome:
        from retrue.viewer.server import serving

        signal.signal(signal.SIGTERM, signal.default_int_handler)
        address = f"http://{self.host}:{self.port}"
        with contextlib.suppress(KeyboardInterrupt), serving(scene.page("retrue view"), self.host, self.port):
            log(f"look at {address} (Ctrl-C ends it)")
            threading.Event().wait()
        return Outcome({"address": address, "notes": list(scene.notes)}, "ended")
