"""`retrue completion`."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator
from dataclasses import MISSING, dataclass, fields, is_dataclass
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from tyro.conf import Positional

from retrue.cli.command import Command, Outcome


@dataclass(frozen=True, kw_only=True)
class Completion(Command):
    """Print the script that completes commands, options, choices and file names in a shell.

    Attributes
    ----------
    shell
        Which shell it is for.
    """

    shell: Positional[Literal["bash", "zsh", "fish"]]

    def run(self) -> Outcome:
        from retrue.cli.commands import EXAMPLES, command_kind

        words = {name: words_of(command_kind(name)) for name in EXAMPLES}
        text = {"bash": _bash, "zsh": _zsh, "fish": _fish}[self.shell](words)
        return Outcome({"shell": self.shell, "script": f"{text}\n"}, text)


@dataclass(frozen=True, slots=True)
class Words:
    """What may follow the name of a command.

    Attributes
    ----------
    options : in the order of its help.
    choices : of those options that take one of a few words.
    first : what the first argument may be, where that is one of a few words.
    """

    options: list[str]
    choices: dict[str, list[str]]
    first: list[str]


def words_of(kind: type) -> Words:
    """Of a command, its limits included.

    >>> from retrue.cli.commands import command_kind
    >>> words_of(command_kind("verify")).choices["--lens"]
    ['fixed', 'may-have-changed', 'refit']
    """
    words = Words(["--help"], {}, [])
    first = True
    for name, hint, default in _arguments(kind):
        choices = _choices(hint)
        if "ositional" in repr(hint):  # in the words of tyro's marker, or of its setting
            if first:
                words.first.extend(choices)
            first = False
            continue
        option = f"--{'no-' if default is True else ''}{name.replace('_', '-')}"
        words.options.append(option)
        if choices:
            words.choices[option] = choices
    return words


def _arguments(kind: type) -> Iterator[tuple[str, Any, Any]]:
    """Name, type and default of each field, and of those of its limits."""
    hints = get_type_hints(kind, include_extras=True)
    for item in fields(kind):
        hint = hints[item.name]
        inner = get_args(hint)[0] if get_origin(hint) is Annotated else hint
        if isinstance(inner, type) and is_dataclass(inner):
            yield from _arguments(inner)
        else:
            yield item.name, hint, None if item.default is MISSING else item.default


def _choices(hint: Any) -> list[str]:
    if get_origin(hint) is Literal:
        return [str(word) for word in get_args(hint)]
    return [word for inner in get_args(hint) if not isinstance(inner, str) for word in _choices(inner)]


def _cases(words: dict[str, Words], show: str) -> tuple[list[str], list[str], list[str]]:
    """Lines of a shell's `case`: of options, of what follows one, and of the first argument. `show` offers words."""
    options = [f'    "{name}") {show.format(" ".join(own.options))} ;;' for name, own in words.items()]
    after = [
        f'    "{name} {option}") {show.format(" ".join(choices))} ;;'
        for name, own in words.items()
        for option, choices in own.choices.items()
    ]
    first = [f'    "{name}") {show.format(" ".join(own.first))} ;;' for name, own in words.items() if own.first]
    return options, after, first


def _bash(words: dict[str, Words]) -> str:
    options, after, first = _cases(words, '_retrue_offer "{}"')
    return "\n".join(
        [
            "# bash completion of retrue",
            '_retrue_offer() { COMPREPLY=($(compgen -W "$1" -- "${COMP_WORDS[COMP_CWORD]}")); }',
            "_retrue() {  # where it offers nothing, bash offers files",
            "  COMPREPLY=()",
            "  local command=${COMP_WORDS[1]} before=${COMP_WORDS[COMP_CWORD-1]} current=${COMP_WORDS[COMP_CWORD]}",
            f'  if [[ $COMP_CWORD == 1 ]]; then _retrue_offer "{" ".join(words)}"; return; fi',
            '  case "$command $before" in',
            *after,
            "  esac",
            "  [[ ${COMPREPLY[*]} ]] && return",
            '  if [[ $current == -* ]]; then case "$command" in',
            *options,
            "  esac; return; fi",
            '  [[ $COMP_CWORD == 2 ]] && case "$command" in',
            *first,
            "  esac",
            "}",
            "complete -o default -F _retrue retrue",
        ]
    )


def _zsh(words: dict[str, Words]) -> str:
    options, after, first = _cases(words, "compadd -- {}")
    return "\n".join(
        [
            "#compdef retrue",
            "_retrue() {",
            '  local command="$words[2]" before="$words[CURRENT-1]" current="$words[CURRENT]"',
            f"  if (( CURRENT == 2 )); then compadd -- {' '.join(words)}; return; fi",
            '  case "$command $before" in',
            *[line.replace(" ;;", "; return ;;") for line in after],
            "  esac",
            '  if [[ "$current" == -* ]]; then case "$command" in',
            *options,
            "  esac; return; fi",
            '  (( CURRENT == 3 )) && case "$command" in',
            *[line.replace(" ;;", "; return ;;") for line in first],
            "  esac",
            "  _files",
            "}",
            'if [[ "$funcstack[1]" == _retrue ]]; then _retrue "$@"; else compdef _retrue retrue; fi',
        ]
    )


def _fish(words: dict[str, Words]) -> str:
    """tyro's own, to which it adds files and the words that a first argument may be."""
    from retrue.cli.commands import call_tyro

    script = io.StringIO()
    with contextlib.redirect_stdout(script), contextlib.suppress(SystemExit):
        call_tyro(["--tyro-print-completion", "fish"])
    lines = [
        f"complete --command retrue --condition '__fish_seen_subcommand_from {name}' "
        f"--arguments '{' '.join(own.first)}'"
        for name, own in words.items()
        if own.first
    ]
    return "\n".join([script.getvalue().rstrip().replace("complete --no-files ", "complete "), *lines])
