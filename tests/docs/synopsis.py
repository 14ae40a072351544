"""Whether a way to call a command, as a page writes it, is one."""

from __future__ import annotations

import pkgutil
import re
import shlex
from contextlib import ExitStack
from importlib import import_module
from unittest.mock import patch

import retrue.cli
from retrue.cli.command import Command
from retrue.cli.main import main


class Parsed(Exception):
    """Raised in place of what the command would do."""


def parses(synopsis: str) -> bool:
    """Whether `retrue` takes it. Brackets mean optional, a bar a choice; what follows for the shell is left out."""
    call = re.split(r"\s[|>&]", re.sub(r"[\[\]]", "", synopsis))[0]
    words = [word.partition("|")[0] for word in shlex.split(call, comments=True)[1:]]
    for module in pkgutil.iter_modules(retrue.cli.__path__):
        import_module(f"retrue.cli.{module.name}")
    with ExitStack() as stack:
        for command in Command.__subclasses__():
            stack.enter_context(patch.object(command, "run", side_effect=Parsed))
        try:
            main(words)
        except Parsed:
            return True
    return False
