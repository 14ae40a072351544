"""What a command leaves to read: the page of `--report`, and the report of a fault of our own."""

from __future__ import annotations

import shlex
import tempfile
import traceback
from collections.abc import Sequence
from dataclasses import replace

from retrue.cli.command import Outcome
from retrue.cli.terminal import terminal
from retrue.errors import RetrueError


def written_page(outcome: Outcome, arguments: Sequence[str]) -> Outcome:
    """Write the page of an outcome; returns the outcome, which then says so.

    What the command was asked for is done by now: a page that cannot be written is told, and changes no verdict.
    """
    from retrue.pages import write_page

    if outcome.page is None:
        return outcome
    path, page = outcome.page
    terminal.detail("drawing the report")
    try:
        write_page(path, page, shlex.join(["retrue", *arguments]))
    except Exception as error:
        terminal.note(str(error) if isinstance(error, RetrueError) else fault_report(error, arguments))
        return replace(outcome, report={**outcome.report, "page": None}, text=f"{outcome.text}\n{path}: no report")
    return replace(
        outcome, report={**outcome.report, "page": str(path)}, text=f"{outcome.text}\n{path}: report written"
    )


def fault_report(error: Exception, arguments: Sequence[str]) -> str:
    """Write down what happened, for whoever mends it; returns the line that says so, and where it lies."""
    said = f"a fault of our own, {type(error).__name__}: {error}"
    text = f"{shlex.join(['retrue', *arguments])}\n\n{''.join(traceback.format_exception(error))}"
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="retrue-", suffix=".txt", delete=False, encoding="utf-8", errors="backslashreplace"
        ) as stream:
            stream.write(text)
    except OSError:
        return said
    return f"{said}; please send us {stream.name}"
