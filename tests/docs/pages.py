"""The manual's pages, and the examples in them.

A `console` block holds commands after `$ ` and, below each, what it prints. A `python` block may be followed at once
by a `text` block with what it prints. Both are run. A `sh` block says how a command is called; its `retrue` lines
must parse. `<!-- not run: REASON -->` on the line before a block excepts it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
EXCEPTED = re.compile(r"<!-- not run: .+ -->\n$")
PICTURE = re.compile(r"!\[[^\]]*\]\(([^)]+)\)|<img[^>]* src=\"([^\"]+)\"")


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, its text, and where that text stands in the page."""

    language: str
    text: str
    start: int
    end: int
    excepted: bool


@dataclass(frozen=True)
class Example:
    """Something to run, what it is said to print (None: nothing is said), and where the page says so."""

    language: str
    source: str
    output: str | None
    start: int
    end: int


def pages() -> list[Path]:
    """Every page of the manual, and the README."""
    return [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]


def blocks(page: str) -> list[Block]:
    """The fenced blocks of a page's text."""
    return [
        Block(found[1], found[2], found.start(2), found.end(2), bool(EXCEPTED.search(page[: found.start()])))
        for found in FENCE.finditer(page)
    ]


def examples(page: str) -> Iterator[Example]:
    """What is run of a page's text, in its order."""
    found = blocks(page)
    for block, following in zip_longest(found, found[1:]):
        if block.excepted:
            continue
        if block.language == "console":
            yield from _commands(block)
        elif block.language == "python":
            printed = following if following and page[block.end : following.start] == "```\n```text\n" else None
            at = (printed.start, printed.end) if printed else (block.end, block.end)
            yield Example("python", block.text, printed.text if printed else None, *at)


def _commands(block: Block) -> Iterator[Example]:
    """Each command of a console block; a backslash at its end continues it on the next line."""
    assert block.text.startswith("$ "), f"a console block begins with a command: {block.text!r}"
    for found in re.finditer(r"^\$ ((?:.*\\\n)*.*)\n((?:(?!\$ ).*\n)*)", block.text, re.MULTILINE):
        yield Example("console", found[1], found[2], block.start + found.start(2), block.start + found.end(2))


def pictures(page: str) -> list[str]:
    """Paths of the pictures that a page shows, as it writes them."""
    return [found[1] or found[2] for found in PICTURE.finditer(page)]
