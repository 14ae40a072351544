"""YAML that nests, as Kalibr and BoofCV write it: mappings, lists and words, and nothing else of YAML.

Nothing is executed: no tag is resolved, no anchor followed. What a line of another kind says is passed over, and
missed where it was needed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from retrue.errors import FileError
from retrue.files.storage import LARGEST_MATRIX, NUMBER
from retrue.geometry.arrays import FloatArray

Tree = str | list["Tree"] | dict[str, "Tree"]
KEY = re.compile(r"""["']?([A-Za-z_][\w.-]*)["']?[ \t]*:(?=[ \t]|$)""")
MOST_LINES = 10_000
DEEPEST = 8


@dataclass(frozen=True, slots=True)
class Node:
    """A mapping of the file, and where it stands in it, for messages."""

    path: Path
    members: Mapping[str, Tree]
    name: str = ""

    def __contains__(self, name: str) -> bool:
        return name in self.members

    def node(self, name: str) -> Node:
        """A mapping within this one."""
        value = self._member(name)
        if not isinstance(value, dict):
            raise FileError(self.path, f"{self._full(name)}: expected entries of its own, found none")
        return Node(self.path, value, self._full(name))

    def text(self, name: str) -> str:
        """A word."""
        value = self._member(name)
        if not isinstance(value, str):
            raise FileError(self.path, f"{self._full(name)}: expected a word, found other entries")
        return value.strip("\"'")

    def numbers(self, name: str, length: int | None = None) -> FloatArray:
        """A number, or all of a list, of lists too, flat; so many of them where that is said."""
        words = list(_words(self._member(name)))
        for word in words:
            if not NUMBER.fullmatch(word) or not np.isfinite(float(word)):
                raise FileError(self.path, f"{self._full(name)}: expected finite numbers, found {word[:40]!r}")
        if len(words) > LARGEST_MATRIX or (length is not None and len(words) != length):
            raise FileError(self.path, f"{self._full(name)}: expected {length or 'few'} numbers, found {len(words)}")
        return np.array([float(word) for word in words], dtype=np.float64)

    def number(self, name: str) -> float:
        """One."""
        return float(self.numbers(name, 1)[0])

    def _member(self, name: str) -> Tree:
        if name not in self.members:
            raise FileError(self.path, f"{self._full(name)}: expected this entry, found none")
        return self.members[name]

    def _full(self, name: str) -> str:
        return f"{self.name}.{name}" if self.name else name


def parse_nested_yaml(path: Path, text: str) -> Node:
    """The file's mapping; of a key that stands twice, the first. Raises `FileError` for what is too large or deep.

    >>> tree = parse_nested_yaml(Path("a.yaml"), "cam0:\\n  T:\\n  - [1, 2]\\n  - [3,\\n   4]\\n  model: pinhole # a")
    >>> tree.node("cam0").numbers("T").tolist(), tree.node("cam0").text("model")
    ([1.0, 2.0, 3.0, 4.0], 'pinhole')
    """
    lines = [
        line for line in map(_bare, text.splitlines()) if line.strip() and not line.startswith(("%", "---", "..."))
    ]
    if len(lines) > MOST_LINES:
        raise FileError(path, f"expected at most {MOST_LINES} lines, found {len(lines)}")
    return Node(path, _mapping(_joined(lines), 0))


def _bare(line: str) -> str:
    """Without its comment."""
    return re.sub(r"(^|\s)#.*", "", line).rstrip().replace("\t", "    ")


def _joined(lines: Sequence[str]) -> list[str]:
    """A list in brackets that goes on in the next lines, on one."""
    joined: list[str] = []
    open_brackets = 0
    for line in lines:
        if open_brackets > 0:
            joined[-1] += " " + line.strip()
        else:
            joined.append(line)
        open_brackets = max(0, open_brackets + line.count("[") - line.count("]"))
    return joined


def _mapping(lines: Sequence[str], depth: int) -> dict[str, Tree]:
    """The entries that stand leftmost; what is further to the right, or a list, belongs to the entry above it."""
    members: dict[str, Tree] = {}
    level = min((_indent(line) for line in lines), default=0)
    start = 0
    while start < len(lines):
        key = KEY.match(lines[start].strip()) if _indent(lines[start]) == level else None
        end = start + 1
        while end < len(lines) and (_indent(lines[end]) > level or lines[end].lstrip().startswith("- ")):
            end += 1
        if key is not None and key[1] not in members:
            rest = lines[start].strip()[key.end() :].strip()
            members[key[1]] = _value(rest, lines[start + 1 : end], depth)
        start = end
    return members


def _value(rest: str, below: Sequence[str], depth: int) -> Tree:
    if rest or not below:
        return _flow(rest)
    if below[0].lstrip().startswith("-"):
        items = [line.strip() for line in below]
        return [_flow(re.sub(r"^(-[ \t]+)+", "", item)) for item in items]
    return _mapping(below, depth + 1) if depth < DEEPEST else ""


def _flow(text: str) -> Tree:
    """A word, or the words of a list in brackets: lists within it flat."""
    text = re.sub(r"!!?[\w-]+", " ", text).strip()
    if not text.startswith("["):
        return text
    return list[Tree](re.sub(r"[\[\],]", " ", text).split())


def _words(value: Tree) -> list[str]:
    if isinstance(value, str):
        return [value] if value else []
    if isinstance(value, dict):
        return ["entries"]  # no number
    return [word for item in value for word in _words(item)]


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip())
