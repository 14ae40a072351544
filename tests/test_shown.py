"""What a prompt and a notebook show of a value: a few short lines, and never its arrays."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

import retrue
from retrue.shown import ShortRepr, vector
from tests.examples import examples, public_values

SHOWN = [name for name in public_values() if issubclass(getattr(retrue, name), ShortRepr)]
PLAIN = {
    "Artefact",
    "Board",
    "DistanceError",
    "Frame",
    "GrayCode",
    "KnownDistance",
    "Photographs",
    "Reason",
    "Scale",
    "Setup",
}  # as Python shows them: a few short fields


def test_only_what_is_short_by_itself_is_shown_by_python() -> None:
    assert {name for name in public_values() if not name.endswith("Options")} - set(SHOWN) == PLAIN


@pytest.mark.parametrize("name", public_values())
def test_a_value_is_shown_in_a_few_short_lines(name: str) -> None:
    text = repr(examples()[name])
    assert len(text.splitlines()) <= 9
    assert len(text) <= 700
    assert text.startswith((f"{name}:", type(examples()[name]).__name__))
    if name in SHOWN:
        assert max(map(len, text.splitlines())) <= 110
        assert "array" not in text
        assert not re.search(r"\d\.\d{8}", text)


class Tags(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.mark.parametrize("name", SHOWN)
def test_a_notebook_shows_the_same_as_a_table(name: str) -> None:
    value = examples()[name]
    page = Tags()
    page.feed(value._repr_html_())
    assert page.open == []
    assert "".join(page.text.split()) == "".join(repr(value).split())


def test_names_cannot_break_out_of_a_notebook() -> None:
    rig = examples()["Rig"]
    assert isinstance(rig, retrue.Rig)
    html = replace(rig, unit="<script>", evidence={"<b>": 1})._repr_html_()
    assert "<script>" not in html
    assert "&lt;b&gt;" in html


@pytest.mark.parametrize("name", ["Accepted", "Calibrated", "Cloud", "Mesh", "Rig"])
def test_a_notebook_shows_what_lies_in_space_in_a_frame_of_its_own(name: str) -> None:
    page = Tags()
    tags: list[tuple[str, dict[str, str | None]]] = []
    page.handle_starttag = lambda tag, attrs: (page.open.append(tag), tags.append((tag, dict(attrs))))  # type: ignore
    page.feed(examples()[name]._repr_html_())
    (frame,) = (attributes for tag, attributes in tags if tag == "iframe")
    assert frame["sandbox"] == "allow-scripts"
    inner = frame["srcdoc"]
    assert inner is not None
    assert inner.startswith("<!doctype html>")
    assert "default-src 'none'" in inner
    assert "class Space" in inner


def test_an_answer_says_what_was_found_and_how_sure_it_is() -> None:
    accepted = examples()["Accepted"]
    assert isinstance(accepted, retrue.Accepted)
    lines = repr(accepted).splitlines()
    assert lines[0].startswith("Accepted: if nobody touched the lenses, resolved by points")
    (rests_on,) = (line.split() for line in lines if line.lstrip().startswith("from "))
    assert rests_on[:3] == ["from", str(accepted.evidence.correspondences), "correspondences,"]
    moved = re.search(r"moved +(\S+) deg, direction of t (\S+) deg", repr(accepted))
    assert moved
    assert abs(float(moved[1]) - 3) < 0.2
    assert abs(float(moved[2]) - 1) < 1
    assert re.search(r"points +\S+ m away were off by \S+ m, sigma \S+ m", repr(accepted))


def test_nothing_is_known_and_nothing_is_there() -> None:
    assert repr(retrue.Evidence(3)) == "Evidence\n  from  3 correspondences"
    nothing = np.empty((0, 2))
    assert repr(retrue.Correspondences(nothing, nothing)) == "Correspondences: 0 points"
    assert vector([float("nan"), 1.0]) == "[nan, 1]"
    assert vector([0.0, 0.0]) == "[0, 0]"
    assert vector([123456.7, -0.00001]) == "[123457, 0]"
