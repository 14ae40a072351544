"""`retrue view`."""

from __future__ import annotations

import contextlib
import signal
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from retrue.cli.command import Command, Outcome, log


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
    """

    files: Positional[Annotated[tuple[Path, ...], arg(metavar="FILE...")]]
    host: str = "127.0.0.1"
    port: int = 8080

    def run(self) -> Outcome:
        from retrue.viewer.contents import read_contents
        from retrue.viewer.scene import make_scene
        from retrue.viewer.server import require_viser, serving

        require_viser()
        scene = make_scene(read_contents(self.files))
        for note in scene.notes:
            log(note)
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        address = f"http://{self.host}:{self.port}"
        with contextlib.suppress(KeyboardInterrupt), serving(scene, self.host, self.port):
            log(f"look at {address}; Ctrl-C ends it")
            threading.Event().wait()
        return Outcome({"address": address, "notes": list(scene.notes)}, "ended")
