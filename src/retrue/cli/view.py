"""`retrue view`."""

from __future__ import annotations

import contextlib
import signal
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from retrue.cli.command import Command, Outcome, log, require_writable


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
        On that page the first of two clouds is "before", the second "after": a slider goes from one to the other.
    """

    files: Positional[Annotated[tuple[Path, ...], arg(metavar="FILE...")]]
    host: str = "127.0.0.1"
    port: int = 8080
    out: Path | None = None
    compare: bool = False

    def run(self) -> Outcome:
        return self._serve() if self.out is None else self._write(self.out)

    def _write(self, out: Path) -> Outcome:
        from retrue.files.atomic import replaced_file
        from retrue.viewer.contents import read_contents
        from retrue.viewer.page import contents_page

        require_writable(out)
        page = contents_page(read_contents(self.files), compare=self.compare, title=out.stem)
        with replaced_file(out) as stream:
            stream.write(page.encode(errors="backslashreplace"))
        return Outcome({"out": str(out)}, f"{out}: open it in a browser")

    def _serve(self) -> Outcome:
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
