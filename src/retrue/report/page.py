"""A report as values, and as one HTML file that needs nothing but a browser: no network, no folder beside it."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from typing import Any, Literal

from retrue.report.space import space_assets

Tone = Literal["good", "warn", "bad"]
Figure = Mapping[str, Any]
"""What Plotly draws: `data`, `layout`. A color may be "var(--name)", a custom property of page.css."""


@dataclass(frozen=True, slots=True)
class Fact:
    """One figure to see at a glance."""

    label: str
    value: str
    note: str = ""


@dataclass(frozen=True, slots=True)
class Text:
    """A paragraph."""

    text: str
    kind: str = field(default="text", init=False)


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of cells; the first column names the row, numbers stand in the others.

    Attributes
    ----------
    head : one name a column.
    rows : cells as they are shown.
    caption : what it says, in a sentence; may be empty.
    numeric : whether the other columns are set flush right, figures under figures.
    """

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""
    numeric: bool = True
    kind: str = field(default="table", init=False)


@dataclass(frozen=True, slots=True, eq=False)
class Chart:
    """A drawing.

    Attributes
    ----------
    figure : for Plotly.
    label : what it shows, for those who cannot see it.
    caption : how to read it.
    aspect, extra : its height is `aspect` times its width, and so many pixels for axes and legends.
    """

    figure: Figure
    label: str
    caption: str = ""
    aspect: float = 0.5
    extra: int = 0
    kind: str = field(default="chart", init=False)


@dataclass(frozen=True, slots=True)
class Tabs:
    """Blocks of which one is seen at a time; in print, all."""

    panels: tuple[tuple[str, Chart], ...]
    kind: str = field(default="tabs", init=False)


@dataclass(frozen=True, slots=True, eq=False)
class Space:
    """Points, surfaces and devices in space, to turn, cut and measure.

    Attributes
    ----------
    html : as `space_html` makes it.
    caption : how to read it.
    names : of what is drawn.
    """

    html: str
    caption: str = ""
    names: tuple[str, ...] = ()
    kind: str = field(default="space", init=False)


Block = Text | Table | Chart | Tabs | Space


@dataclass(frozen=True, slots=True)
class Section:
    """A heading, a sentence below it, and what follows."""

    title: str
    lead: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True, slots=True)
class Page:
    """A report.

    Attributes
    ----------
    job : "recalibrate" ...
    verdict, tone : one word, and what it means for the reader.
    sentence : the verdict in a sentence.
    advice : what to do next, a sentence each.
    """

    job: str
    verdict: str
    tone: Tone
    sentence: str
    facts: tuple[Fact, ...]
    sections: tuple[Section, ...]
    advice: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Provenance:
    """Where a page comes from: the command as typed, when (ISO 8601), and what computed it."""

    command: str
    made: str
    versions: Mapping[str, str]


def page_html(page: Page, provenance: Provenance) -> str:
    """The whole file. All text is escaped; the page is forbidden to load anything from anywhere."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(_asset), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    environment.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    return environment.get_template("page.html.j2").render(
        page=page,
        provenance=provenance,
        style=_asset("page.css"),
        script=_asset("page.js"),
        plotly=_packed_plotly() if _is_drawn(page) else "",
        space=_space_assets(page),
    )


def _is_drawn(page: Page) -> bool:
    return any(isinstance(block, Chart | Tabs) for section in page.sections for block in section.blocks)


def _space_assets(page: Page) -> dict[str, str] | None:
    """Style and script of drawings in space, where there are any."""
    if not any(isinstance(block, Space) for section in page.sections for block in section.blocks):
        return None
    style, script = space_assets()
    return {"style": style, "script": script}


def _asset(name: str) -> str:
    return (files("retrue.report") / "assets" / name).read_text(encoding="utf-8")


@cache
def _packed_plotly() -> str:
    """Plotly's script (plotly.js-dist-min, MIT), compressed: the browser unpacks it in a few milliseconds."""
    return base64.b64encode((files("retrue.report") / "assets" / "plotly.min.js.gz").read_bytes()).decode()
