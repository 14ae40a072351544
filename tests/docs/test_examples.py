"""Every example of the manual and the README does what the page says.

After a change that alters them, `make examples` writes what they print and draw now; read the difference.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.docs.alike import same_picture, same_text
from tests.docs.pages import ROOT, blocks, examples, pages, pictures
from tests.docs.sandbox import Sandbox
from tests.docs.synopsis import parses

PAGES = pytest.mark.parametrize("page", pages(), ids=lambda page: str(page.relative_to(ROOT)))


@PAGES
def test_examples_print_and_draw_what_is_shown(page: Path, tmp_path: Path) -> None:
    text = page.read_text(encoding="utf-8")
    sandbox = Sandbox(tmp_path)
    for example in examples(text):
        printed = sandbox.run(example)
        expected = example.output
        assert expected is None or same_text(expected, printed), (
            f"{example.source}\nshown:\n{expected}\nprinted:\n{printed}"
        )
    for shown in pictures(text):
        drawn = sandbox.drawn(shown)
        assert drawn is None or same_picture(drawn, page.parent / shown), shown


@PAGES
def test_synopses_are_valid(page: Path) -> None:
    for block in blocks(page.read_text(encoding="utf-8")):
        if block.language == "sh" and not block.excepted:
            for line in block.text.splitlines():
                assert not line.startswith("retrue ") or parses(line), line


def test_a_synopsis_that_is_wrong_is_noticed() -> None:
    assert parses("retrue decode CAPTURE --pattern P.json --out points.csv  # a comment")
    assert not parses("retrue decode CAPTURE --patern P.json --out points.csv")
    assert not parses("retrue recalbrate rig.json CAPTURE... --out new.json")


def test_few_blocks_are_excepted() -> None:
    excepted = [page.name for page in pages() for block in blocks(page.read_text(encoding="utf-8")) if block.excepted]
    assert len(excepted) <= 4, excepted


@pytest.mark.parametrize(
    ("shown", "printed"),
    [
        ("found 1822 points\n", "found 1823 points\n"),
        ("RMS 0.035 px\n", "RMS 0.036 px\n"),
        ("decoded in 0.79 s\n", "decoded in 31 s\n"),
        ("1  2026-11-22 07:43:40  found\n", "1  2031-01-02 00:00:00  found\n"),
        ("usage:\n...\nexit\n", "usage:\n  many\n  lines\nexit\n"),
    ],
)
def test_what_may_differ(shown: str, printed: str) -> None:
    assert same_text(shown, printed)


@pytest.mark.parametrize(
    ("shown", "printed"),
    [
        ("good\n", "drifted\n"),
        ("1\n", "2\n"),
        ("8 poses\n", "7 poses\n"),
        ("moved by 3.98 deg\n", "moved by 4.28 deg\n"),
        ("one line\n", "one line\nand another\n"),
        ("", "something\n"),
        ("usage:\n...\nexit\n", "usage:\nentry\n"),
    ],
)
def test_what_may_not(shown: str, printed: str) -> None:
    assert not same_text(shown, printed)
