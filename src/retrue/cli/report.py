"""`--report`: the page about what a command found."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import replace

from retrue.cli.command import Outcome
from retrue.cli.terminal import terminal


def written_page(outcome: Outcome, arguments: Sequence[str]) -> Outcome:
    """Write the page of an outcome; returns the outcome, which then says so."""
    from retrue.pages import write_page

    if outcome.page is None:
        return outcome
    path, page = outcome.page
    terminal.detail("drawing the report")
    write_page(path, page, shlex.join(["retrue", *arguments]))
    return replace(
        outcome, report={**outcome.report, "page": str(path)}, text=f"{outcome.text}\n{path}: report written"
    )
