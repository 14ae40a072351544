"""The command line: one subcommand a file, usage generated from their fields."""

from __future__ import annotations

import io
import json
import os
import re
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path

from retrue.cli.command import BAD_INPUT, OUR_FAULT, Outcome
from retrue.cli.parsing import parse
from retrue.cli.terminal import GREEN, RED, YELLOW, colored, terminal
from retrue.errors import RetrueError, RetrueWarning

INTERRUPTED = 130  # as a shell reports SIGINT
VERDICTS = {
    "accepted": GREEN, "unchanged": GREEN, "holds": GREEN,
    "refused": YELLOW, "improvable": YELLOW, "cannot tell": YELLOW,
    "recalibrate": RED, "drifted": RED,
}  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit status.

    0 done, 1 refused or drifted, 2 bad usage or bad input, 70 a fault of our own.
    """
    _print_anything()
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")  # what is wrong with a file is said by us, in one line
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    if arguments == ["--version"]:
        from importlib.metadata import version

        _print(f"retrue {version('retrue')}")
        return 0
    as_json = "--json" in arguments
    try:
        try:
            command = parse(arguments)
        except BrokenPipeError:  # its help, cut short
            _read_no_more()
            return 0
        terminal.start(quiet=command.quiet, verbose=command.verbose)
        with warnings.catch_warnings():
            warnings.simplefilter("default", RetrueWarning)  # each once
            warnings.showwarning = _note_warning
            outcome = command.run()
        if outcome.page is not None:
            from retrue.cli.report import written_page

            outcome = written_page(outcome, arguments)
    except RetrueError as error:
        return _fail(str(error), as_json, BAD_INPUT)
    except KeyboardInterrupt:
        terminal.clear()
        print("retrue: interrupted", file=sys.stderr)
        return INTERRUPTED
    except Exception as error:  # nobody foresaw it: a traceback is for us, and not for whoever waits for an answer
        from retrue.cli.report import fault_report

        return _fail(fault_report(error, arguments), as_json, OUR_FAULT)
    terminal.clear()
    if as_json or not command.quiet:
        _print(json.dumps(outcome.report, allow_nan=False) if as_json else _painted(outcome))
    return outcome.exit_status


def _note_warning(message: Warning | str, category: type[Warning], *_: object) -> None:
    """Our own warnings as notes; what others warn of is for us, and not for whoever waits for an answer."""
    if issubclass(category, RetrueWarning):
        terminal.note(f"note: {message}")


def _print_anything() -> None:
    """Escape what the terminal's encoding lacks, such as a file's name: what is done must not fail in the telling."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _print(text: str) -> None:
    """To stdout; that nobody reads to its end is no mistake of ours."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        _read_no_more()


def _read_no_more() -> None:
    """What is printed from here on goes nowhere."""
    sys.stdout = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115 - for what Python flushes at its end


def _painted(outcome: Outcome) -> str:
    """The answer for people, its verdict in color."""
    found = re.match(r"[a-z ]+(?=[:,])", outcome.text)
    if found is None or found[0] not in VERDICTS:
        return outcome.text
    return colored(found[0], VERDICTS[found[0]], sys.stdout) + outcome.text[found.end() :]


def _fail(message: str, as_json: bool, status: int) -> int:
    line = " ".join(message.split())
    terminal.clear()
    print(f"{colored('retrue:', RED, sys.stderr)} {line}", file=sys.stderr)
    if as_json:
        print(json.dumps({"error": line}))
    return status
