"""The house style of docstrings, `name : what it is`, in the numpydoc form that the manual's parser reads.

Numpydoc expects a type behind the colon. Ours stand in the annotations, where the parser finds them by itself.
"""

import re
import textwrap
from typing import Any

import griffe

NAMED = ("Attributes", "Parameters", "Raises")
SECTIONS = (*NAMED, "Returns")
ITEM = re.compile(r"([\w, ]+) : (.*)", re.DOTALL)


class DescribedNames(griffe.Extension):
    """Rewrites every docstring before it is parsed."""

    def on_instance(self, *, obj: griffe.Object, **_: Any) -> None:
        if obj.docstring:
            returns = obj.returns if isinstance(obj, griffe.Function) else None
            obj.docstring.value = numpydoc(obj.docstring.value, str(returns or ""))


def numpydoc(docstring: str, returns: str) -> str:
    """The same with descriptions below the names, and headers over what follows the last section."""
    section, lines = "", []
    for paragraph in docstring.split("\n\n"):
        first, *rest = paragraph.split("\n")
        if first in SECTIONS and rest:
            section = first
            lines += [first, rest[0], *_items(section, rest[1:], returns)]
        elif first.startswith(">>>"):
            section = "Examples"
            lines += [section, "--------", paragraph]
        elif section in SECTIONS and not first.startswith(" "):
            section = "Notes"
            lines += [section, "-----", paragraph]
        else:
            lines.append(paragraph)
        lines.append("")
    return "\n".join(lines)


def _items(section: str, rows: list[str], returns: str) -> list[str]:
    if section == "Returns" and " " in rows[0]:
        return [returns, textwrap.indent("\n".join(rows), "    ")]
    lines: list[str] = []
    for item in re.split(r"\n(?=\S)", "\n".join(rows)):
        named = ITEM.fullmatch(item)
        for name in named[1].split(", ") if named else ():
            lines += [name, f"    {named[2]}"]  # each by itself, for each has a type of its own
        lines += [] if named else [item]
    return lines
