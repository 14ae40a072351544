"""The guides quote messages as the code says them."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

import pytest

from tests.docs.pages import DOCS, FENCE, ROOT, pages

GAP = "\0"
QUOTED = re.compile(r"^(?:#+|\||-) +`([^`]+)`", re.MULTILINE)  # headings, first cells and items that are a message
GUIDES = sorted((DOCS / "guides").glob("*.md"))


def strings() -> Iterator[str]:
    """Every string of the package, what is filled in marked by a gap."""
    for source in (ROOT / "src").rglob("*.py"):
        for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
            if isinstance(node, ast.JoinedStr):
                yield "".join(part.value if isinstance(part, ast.Constant) else GAP for part in node.values)
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                yield node.value


@pytest.fixture(scope="module")
def said_strings() -> list[str]:
    return list(strings())


def is_said(message: str, said: list[str]) -> bool:
    """Whether the message, its gaps written `...`, is part of what is said."""
    parts = [re.escape(part.strip()) for part in message.split("...") if part.strip()]
    pattern = re.compile(r"\s?.*\s?".join(parts), re.DOTALL)
    return any(pattern.search(text) for text in said)


@pytest.mark.parametrize("guide", GUIDES, ids=lambda page: page.stem)
def test_messages_are_quoted_as_they_are(guide, said_strings) -> None:
    messages = QUOTED.findall(FENCE.sub("", guide.read_text(encoding="utf-8")))
    assert len(messages) > 10
    unknown = [message for message in messages if not is_said(message, said_strings)]
    assert not unknown


def test_extras_are_named_as_a_clone_installs_them() -> None:
    """The package is on no index."""
    told = [*pages(), *(ROOT / "src").rglob("*.py"), *(ROOT / "src").rglob("*.pyi")]
    assert [path for path in told if "retrue[" in path.read_text(encoding="utf-8")] == []
