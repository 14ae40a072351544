"""Whether a way to call a command, as a page writes it, is one."""

from __future__ import annotations

import re
import shlex
from contextlib import ExitStack
from unittest.mock import patch

from retrue.cli.commands import EXAMPLES, command_kind
from retrue.cli.main import main


class Parsed(BaseException):
    """Raised in place of what the command would do; no exception that `main` would report."""


def parses(synopsis: str) -> bool:
    """Whether `retrue` takes it. Brackets mean optional, a bar a choice; what follows for the shell is left out."""
    call = re.split(r"\s[|>&]", re.sub(r"[\[\]]", "", synopsis))[0]
    words = [word.partition("|")[0] for word in shlex.split(call, comments=True)[1:]]
    with ExitStack() as stack:
        for name in EXAMPLES:
            stack.enter_context(patch.object(command_kind(name), "run", side_effect=Parsed))
        try:
            main(words)
        except Parsed:
            return True
    return False
