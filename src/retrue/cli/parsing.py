"""From the words on the command line to the command that they name; a mistake becomes one line that helps."""

from __future__ import annotations

import contextlib
import io
import re
import sys
from collections.abc import Iterable, Sequence
from dataclasses import fields, is_dataclass
from difflib import get_close_matches
from typing import get_type_hints

from retrue.cli.command import Command
from retrue.cli.commands import EXAMPLES, call_tyro, command_kind
from retrue.cli.terminal import wants_color
from retrue.errors import RetrueError

HELP = {"-h", "--help"}


class UsageError(RetrueError):
    """Arguments that name no command, or not what it needs."""


def parse(arguments: Sequence[str]) -> Command:
    """The command, with its fields set. Raises `UsageError`; help is printed, and ends in `SystemExit`."""
    if not arguments:
        raise UsageError(f"expected a command: {', '.join(EXAMPLES)}; `retrue demo` shows all of it, --help explains")
    name = arguments[0]
    if not name.startswith("-") and name not in EXAMPLES:
        raise UsageError(f"{name}: no such command; {_nearest(name, EXAMPLES) or 'retrue --help lists them'}")
    complaint, shown = io.StringIO(), io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    try:
        with contextlib.ExitStack() as stack:
            stack.enter_context(contextlib.redirect_stderr(complaint))
            if not wants_color(sys.stdout):  # tyro asks the stream, and not the user, whether to color
                stack.enter_context(contextlib.redirect_stdout(shown))
            return call_tyro(arguments)
    except SystemExit as stop:
        if stop.code:
            raise UsageError(_explained(arguments, complaint.getvalue())) from None
        shown.seek(0)
        print(shown.read(), end="")
        if HELP & set(arguments) and name in EXAMPLES:
            print("\nexamples:", *EXAMPLES[name], sep="\n  ")
        raise


def _explained(arguments: Sequence[str], complaint: str) -> str:
    """What is missing by name, an unknown option with the nearest one; all else as tyro says it, less its box."""
    options = _options(command_kind(arguments[0])) if arguments[0] in EXAMPLES else []
    if "Unrecognized" in complaint:
        for word in (word.partition("=")[0] for word in arguments[1:] if word.startswith("--")):
            if word not in options and word not in HELP:
                help_says = f"retrue {arguments[0]} --help lists all"
                return f"{word}: retrue {arguments[0]} has no such option; {_nearest(word, options) or help_says}"
    if "Missing from" in complaint:
        names = re.findall(r"^\W {5}(\S.*?) +\W$", complaint.partition("For full helptext")[0], re.MULTILINE)
        return f"retrue {arguments[0]}: missing {', '.join(names)}; retrue {arguments[0]} --help has an example"
    _, _, inside = complaint.partition("\n")
    text = re.sub(r"[\s\u2500-\u257f]+", " ", inside)
    # What a class of options refuses:
    if limit := re.search(r"Error parsing [\w-]+: (\w+)(: expected .*?) ?(?:For full helptext|$)", text):
        return f"{_option(limit[1])}{limit[2]}"
    return re.sub(r"Argument helptext:.*(?=For full helptext)", "", text).strip()


def _nearest(word: str, known: Iterable[str]) -> str:
    close = get_close_matches(word, list(known), n=1)
    return f"did you mean {close[0]}?" if close else ""


def _options(kind: type) -> list[str]:
    """The options of a command, those of its limits included."""
    names: list[str] = []
    hints = get_type_hints(kind)
    for item in fields(kind):
        inner = hints[item.name]
        names += _options(inner) if is_dataclass(inner) and isinstance(inner, type) else [_option(item.name)]
    return names


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"
