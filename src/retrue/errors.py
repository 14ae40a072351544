"""Every exception that `retrue` raises on purpose.

    RetrueError
    ├── InputError              a value that the caller handed in is not what it must be
    │   └── FileError           the same, of a file: names it
    │       └── CaptureError    a capture whose pictures do not belong together or do not decode
    ├── DeviceError             a camera or a projector that does not do what was asked of it: names it
    └── DegenerateError         the data cannot determine what was asked for

and what it warns of, `RetrueWarning`. A message is one line: what, expected, found, what to do.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import fields, is_dataclass
from os import PathLike
from pathlib import Path
from typing import Any, cast


class RetrueError(Exception):
    """Root of the tree; `except RetrueError` catches all that is below."""


class InputError(RetrueError, ValueError):
    """A value that is not what it must be."""


class FileError(InputError):
    """A file (or folder) that cannot be used: says which one and why."""

    def __init__(self, path: str | Path, problem: str) -> None:
        self.path = Path(path)
        self.problem = problem
        super().__init__(f"{path}: {problem}")


class CaptureError(FileError):
    """A capture that does not decode: a picture missing, doubled, late, of another size ..."""


class DeviceError(RetrueError):
    """A camera or projector that is not there, went away, or cannot do what was asked: says which one and why."""

    def __init__(self, device: str, problem: str) -> None:
        self.device = device
        self.problem = problem
        super().__init__(f"{device}: {problem}")


class DegenerateError(RetrueError):
    """The data do not determine what was asked for (three points, collinear points ...)."""


class RetrueWarning(UserWarning):
    """What a reader should know of a file that is read all the same; the command line prints it."""


def require_kind(value: Any, kind: type | tuple[type, ...], name: str, advice: str = "") -> None:
    """An `InputError` where the argument `name` is something else; it says what was meant, as far as can be told.

    `advice` is for somebody who hands in a path: what reads it.

    >>> try:
    ...     require_kind("rig.json", dict, "rig", "retrue.read_rig reads one")
    ... except InputError as error:
    ...     print(error)
    rig: expected a dict, found the text 'rig.json'; retrue.read_rig reads one
    """
    if isinstance(value, kind):
        return
    advice = advice if isinstance(value, str | PathLike) else _within(value, kind)
    raise InputError(f"{name}: expected {_a(_names(kind))}, found {_found(value)}{advice and '; '}{advice}")


def require_kinds(values: Any, kind: type | tuple[type, ...], name: str, advice: str = "") -> None:
    """The same of a list, or another sequence, all of one kind."""
    if isinstance(values, kind):
        raise InputError(f"{name}: expected a list of {_names(kind)}, found a single one; put it in [ ]")
    if isinstance(values, str | PathLike) or not isinstance(values, Sequence):
        advice = advice if isinstance(values, str | PathLike) else ""
        raise InputError(f"{name}: expected a list of {_names(kind)}, found {_found(values)}{advice and '; '}{advice}")
    for index, value in enumerate(cast("Sequence[Any]", values)):
        require_kind(value, kind, f"{name}[{index}]", advice)


def require_choice(value: Any, choices: Iterable[str], name: str) -> None:
    """An `InputError` where `value` is none of those words."""
    words = list(choices)
    if not isinstance(value, str) or value not in words:
        raise InputError(f"{name}: expected one of {', '.join(words)}, found {in_brief(value)}")


def require_names(names: Any, count: int) -> None:
    """An `InputError` where `names` is neither empty nor one text for each of `count` things."""
    require_kinds(names, str, "names")
    if len(names) not in (0, count):
        raise InputError(f"names: expected one for each of {count}, or none, found {len(names)}")


def require_path(path: Any, call: str) -> Path:
    """The path; an `InputError` where something else stands in its place in that call."""
    if not isinstance(path, str | PathLike):
        raise InputError(f"path: expected text or a pathlib.Path, as in {call}; found {_found(path)}")
    found = Path(cast("Any", path))
    if "\0" in str(found):
        raise FileError(str(found).replace("\0", "\\0"), "cannot be read or written: no file has a NUL in its name")
    return found


def in_brief(value: Any) -> str:
    """`value` in a message: as Python writes it where that is short, else what kind of thing it is."""
    text = repr(value)
    return text if len(text) <= 60 and "\n" not in text else _found(value)


def _names(kind: type | tuple[type, ...]) -> str:
    *others, last = [each.__name__ for each in (kind if isinstance(kind, tuple) else (kind,))]
    return f"{', '.join(others)} or {last}" if others else last


def _found(value: Any) -> str:
    if isinstance(value, str):
        return f"the text {value[:60]!r}"
    if isinstance(value, PathLike):
        return f"the path {str(cast('Any', value))[:60]!r}"
    if isinstance(value, type):
        return f"the class {value.__name__}"
    return "None" if value is None else _a(type(value).__name__)


def _a(noun: str) -> str:
    return f"{'an' if noun[0] in 'aeiouAEIOU' or noun == 'ndarray' else 'a'} {noun}"


def _within(value: Any, kind: type | tuple[type, ...]) -> str:
    """Where in `value` the thing is that was meant."""
    if is_dataclass(value) and not isinstance(value, type):
        inside = [item.name for item in fields(value) if isinstance(getattr(value, item.name), kind)]
        if inside:
            return f"hand in its .{' or .'.join(inside)}"
    if isinstance(value, list | tuple) and any(isinstance(each, kind) for each in cast("Sequence[Any]", value)):
        return "hand in one of them"
    return ""
