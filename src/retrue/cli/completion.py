"""`retrue completion`."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Literal, get_args, get_origin, get_type_hints

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
        from retrue.cli.commands import EXAMPLES, call_tyro, command_kind

        script = io.StringIO()
        with contextlib.redirect_stdout(script), contextlib.suppress(SystemExit):
            call_tyro(["--tyro-print-completion", self.shell])
        choices = {name: words for name in EXAMPLES if (words := _first_choices(command_kind(name)))}
        text = _with_arguments(script.getvalue().rstrip(), self.shell, choices)
        return Outcome({"shell": self.shell, "script": f"{text}\n"}, text)


def _first_choices(kind: type) -> list[str]:
    """What a command's first argument may be, where it is one of a few words."""
    hints = get_type_hints(kind, include_extras=True)
    for item in fields(kind):
        if "Positional" in repr(hints[item.name]) or "positional" in repr(hints[item.name]):
            inner = get_args(hints[item.name])[0]
            return [str(word) for word in get_args(inner)] if get_origin(inner) is Literal else []
    return []


def _with_arguments(script: str, shell: str, choices: Mapping[str, Sequence[str]]) -> str:
    """tyro's script completes commands and options; this adds files, and the words that a first argument may be."""
    if shell == "bash":
        cases = [
            f'    {name}) COMPREPLY=($(compgen -W "{" ".join(words)}" -- "${{COMP_WORDS[2]}}")) ;;'
            for name, words in choices.items()
        ]
        lines = [
            "_retrue() {",
            "  COMPREPLY=()",
            "  [[ $COMP_CWORD == 2 ]] && case ${COMP_WORDS[1]} in",
            *cases,
            "  esac",
        ]
        lines += [
            '  [[ ${COMPREPLY[*]} ]] || _tyro_retrue "$@"',
            "  [[ ${COMPREPLY[*]} ]] || COMPREPLY=()  # files, then",
        ]
        lines += ["}", "complete -o default -F _retrue retrue"]
        return "\n".join([script, "", *lines])
    if shell == "fish":
        lines = [
            f"complete --command retrue --condition '__fish_seen_subcommand_from {name}' "
            f"--arguments '{' '.join(words)}'"
            for name, words in choices.items()
        ]
        return "\n".join([script.replace("complete --no-files ", "complete "), *lines])
    return script
