"""`retrue completion`."""

from __future__ import annotations

import contextlib
import io
from dataclasses import dataclass
from typing import Literal

from tyro.conf import Positional

from retrue.cli.command import Command, Outcome


@dataclass(frozen=True, kw_only=True)
class Completion(Command):
    """Print the script that completes commands, options and file names in a shell.

    Attributes
    ----------
    shell
        Which shell it is for.
    """

    shell: Positional[Literal["bash", "zsh", "fish"]]

    def run(self) -> Outcome:
        from retrue.cli.commands import call_tyro

        script = io.StringIO()
        with contextlib.redirect_stdout(script), contextlib.suppress(SystemExit):
            call_tyro(["--tyro-print-completion", self.shell])
        return Outcome({"shell": self.shell, "script": script.getvalue()}, script.getvalue().rstrip())
