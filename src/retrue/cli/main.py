"""The command line: one subcommand a file, usage generated from their fields."""

from __future__ import annotations

import contextlib
import io
import json
import re
import sys
from collections.abc import Sequence
from typing import Annotated, Any, cast

import tyro

from retrue.cli.calibrate import Calibrate
from retrue.cli.command import BAD_INPUT, Command
from retrue.cli.convert import Convert
from retrue.cli.decode import Decode
from retrue.cli.demo import Demo
from retrue.cli.diff import Diff
from retrue.cli.experiment import Experiment
from retrue.cli.history import History
from retrue.cli.known_distance import registry
from retrue.cli.pattern import Pattern
from retrue.cli.recalibrate import Recalibrate
from retrue.cli.reconstruct import Reconstruct
from retrue.cli.rollback import Rollback
from retrue.cli.simulate import Simulate
from retrue.cli.verify import Verify
from retrue.cli.watch import Watch
from retrue.errors import RetrueError

Commands = (
    Annotated[Demo, tyro.conf.subcommand("demo")]
    | Annotated[Pattern, tyro.conf.subcommand("pattern")]
    | Annotated[Decode, tyro.conf.subcommand("decode")]
    | Annotated[Calibrate, tyro.conf.subcommand("calibrate")]
    | Annotated[Recalibrate, tyro.conf.subcommand("recalibrate")]
    | Annotated[Verify, tyro.conf.subcommand("verify")]
    | Annotated[Reconstruct, tyro.conf.subcommand("reconstruct")]
    | Annotated[Watch, tyro.conf.subcommand("watch")]
    | Annotated[History, tyro.conf.subcommand("history")]
    | Annotated[Rollback, tyro.conf.subcommand("rollback")]
    | Annotated[Diff, tyro.conf.subcommand("diff")]
    | Annotated[Convert, tyro.conf.subcommand("convert")]
    | Annotated[Simulate, tyro.conf.subcommand("simulate")]
    | Annotated[Experiment, tyro.conf.subcommand("experiment")]
)
DESCRIPTION = "Recalibrate a camera-projector rig from one picture, and know how sure the answer is."
INTERRUPTED = 130  # as a shell reports SIGINT


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit status: 0 done, 1 refused or drifted, 2 bad usage or bad input."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    if arguments == ["--version"]:
        from importlib.metadata import version

        print(f"retrue {version('retrue')}")
        return 0
    as_json = "--json" in arguments
    try:
        outcome = _parse(arguments).run()
    except RetrueError as error:
        return _fail(str(error), as_json)
    except KeyboardInterrupt:
        print("retrue: interrupted", file=sys.stderr)
        return INTERRUPTED
    print(json.dumps(outcome.report, allow_nan=False) if as_json else outcome.text)
    return outcome.exit_status


def _parse(arguments: list[str]) -> Command:
    """The command that the arguments name; a mistake in them becomes one line, without tyro's box."""
    complaint = io.StringIO()
    try:
        with contextlib.redirect_stderr(complaint):
            command = tyro.cli(
                cast("Any", Commands),
                prog="retrue",
                description=DESCRIPTION,
                args=arguments,
                config=(tyro.conf.FlagCreatePairsOff,),
                registry=registry,
            )
    except SystemExit as stop:
        if not stop.code:
            raise
        raise UsageError(_without_box(complaint.getvalue())) from None
    return cast("Command", command)


def _without_box(complaint: str) -> str:
    """The text in tyro's box, less its title and the help of the argument concerned."""
    _, _, inside = complaint.partition("\n")
    text = re.sub(r"[\s\u2500-\u257f]+", " ", inside)
    return re.sub(r"Argument helptext:.*(?=For full helptext)", "", text).strip()


class UsageError(RetrueError):
    """Arguments that name no command, or not what it needs."""


def _fail(message: str, as_json: bool) -> int:
    line = " ".join(message.split())
    print(f"retrue: {line}", file=sys.stderr)
    if as_json:
        print(json.dumps({"error": line}))
    return BAD_INPUT
