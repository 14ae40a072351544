"""`retrue studio`."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from retrue.cli.command import Command, Outcome, log, made_folder
from retrue.errors import FileError, InputError

LIVE = {"real_time": True, "fps": 10.0}
"""Of a simulated rig that people watch."""


@dataclass(frozen=True, kw_only=True)
class Studio(Command):
    """The rig in a browser: see what the decoder sees, check it, recalibrate it, scan with it; needs .[studio].

    With --fleet, a page of many rigs that are watched, beside it or alone.

    Attributes
    ----------
    setup
        Which camera and which projector, TOML.
    simulated
        A simulated rig instead, which can be bumped.
    folder
        Where scans lie, and the rig where the setup names none; made where it is not there.
    fleet
        The folder that `retrue watch fleet.toml --out DIR` writes, whose rigs a page shows.
    port
        The port of 127.0.0.1 to listen on; only this computer can reach it, and only with the printed token.
    """

    setup: Positional[Annotated[Path | None, arg(metavar="SETUP.toml")]] = None
    simulated: bool = False
    folder: Annotated[Path, arg(metavar="DIR")] = Path("studio")
    fleet: Annotated[Path | None, arg(metavar="DIR")] = None
    port: int = 8090

    def run(self) -> Outcome:
        from retrue.devices.setup import LARGEST_SETUP, SIMULATED, parse_setup
        from retrue.files.atomic import read_text
        from retrue.studio.app import HOST, require_free_port, require_nicegui, serve
        from retrue.studio.guard import new_token
        from retrue.studio.studio import Studio as Live

        if self.setup is not None and self.simulated:
            raise InputError("expected a setup, TOML, or --simulated; not both")
        if self.setup is None and not self.simulated and self.fleet is None:
            raise InputError("expected a setup, TOML, or --simulated, or --fleet and the folder of one")
        if self.fleet is not None and not self.fleet.is_dir():
            raise FileError(self.fleet, "expected the folder of `retrue watch fleet.toml --out DIR`, found none")
        setup = SIMULATED if self.setup is None else parse_setup(read_text(self.setup, LARGEST_SETUP), self.setup)
        if setup.camera["driver"] == "simulated":
            setup = replace(setup, camera=LIVE | dict(setup.camera))
        require_nicegui()
        require_free_port(self.port)
        token = new_token()
        address = f"http://{HOST}:{self.port}/?token={token}"
        log(f"open {address} (Ctrl-C ends it)")
        with contextlib.suppress(KeyboardInterrupt):
            live = None if self.setup is None and not self.simulated else Live(setup, made_folder(self.folder))
            serve(live, token, self.port, None if self.fleet is None else partial(_fleet_page, self.fleet))
        return Outcome({"address": address}, "ended")


def _fleet_page(folder: Path) -> str:
    from retrue.watch.rig_status import read_fleet_status
    from retrue.watch.status import status_page

    return status_page(read_fleet_status(folder))
