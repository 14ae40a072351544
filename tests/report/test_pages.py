"""What the pages say, and that they say it safely."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser

import numpy as np
import pytest

from retrue.capture import Capture
from retrue.recalibration.light import log_irradiance
from retrue.recalibration.recalibrate import recalibrate
from retrue.recalibration.result import Evidence, PoseCandidate
from retrue.report.evidence_tables import evidence_blocks
from retrue.report.figures import embedded_picture, numbers, polyline
from retrue.report.lengths import shown_unit
from retrue.report.page import Chart, Page, Space, Table, Tabs
from retrue.report.recalibration_page import recalibration_page
from retrue.report.residual_section import round_factor
from tests.recalibration.scenes import RIG, WALL, Scene, bumped, capture

from .pages import PAGES, PROVENANCE, accepted, html, unchanged

HOSTILE = "<script>alert(1)</script><img src=x onerror=alert(2)>&amp;'\".png"


@pytest.fixture(scope="module")
def pages() -> dict[str, Page]:
    return {name: make() for name, make in PAGES.items()}


def charts(page: Page) -> Iterator[Chart]:
    for section in page.sections:
        for block in section.blocks:
            if isinstance(block, Chart):
                yield block
            elif isinstance(block, Tabs):
                yield from (chart for _, chart in block.panels)


def names_in_space(page: Page) -> set[str]:
    """What stands in the drawings in space."""
    blocks = (block for section in page.sections for block in section.blocks)
    return {name for block in blocks if isinstance(block, Space) for name in block.names}


def text_of(document: str) -> str:
    """What a reader reads: no styles, no scripts, no tags."""
    words = re.sub(r"<(style|script)\b.*?</\1>", " ", document, flags=re.DOTALL)
    return " ".join(unescape(re.sub(r"<[^>]+>", " ", words)).split())


class Tags(HTMLParser):
    """Every tag with its attributes."""

    def __init__(self, document: str) -> None:
        super().__init__()
        self.seen: list[tuple[str, dict[str, str | None]]] = []
        self.feed(document)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append((tag, dict(attrs)))


@pytest.mark.parametrize("name", PAGES)
def test_plotly_knows_every_word_of_the_figures(pages, name):
    from plotly.graph_objects import Figure

    drawn = list(charts(pages[name]))
    assert bool(drawn) == (name != "calibration_refused")
    for chart in drawn:
        plain = re.sub(r'"var\(--\w+\)"', '"#123456"', json.dumps(chart.figure, allow_nan=False))
        Figure(json.loads(plain))  # raises on what it does not know


@pytest.mark.parametrize("name", PAGES)
def test_every_color_stands_in_the_style(pages, name):
    document = html(pages[name])
    style = document[document.index("<style>") : document.index("</style>")]
    drawn = json.dumps([chart.figure for chart in charts(pages[name])])
    for color in set(re.findall(r'"var\((--\w+)\)"', drawn)):
        assert style.count(f"{color}:") == 2, color  # light and dark


@pytest.mark.parametrize("name", PAGES)
def test_one_file_that_refers_to_nothing(pages, name):
    document = html(pages[name])
    assert len(document) < 10e6
    assert "default-src 'none'" in document
    for tag, attributes in Tags(document).seen:
        assert tag not in ("iframe", "object", "embed", "base", "form")
        assert "src" not in attributes, (tag, attributes)
        assert attributes.get("href", "data:,") == "data:,"


def test_a_file_name_cannot_become_markup():
    tame, wild = (Tags(html(accepted(name, out=name))).seen for name in ("scene.png", HOSTILE))
    assert [tag for tag, _ in wild] == [tag for tag, _ in tame]
    assert HOSTILE in text_of(html(accepted(HOSTILE)))


def test_an_accepted_change(pages):
    words = text_of(html(pages["accepted"]))
    change = np.degrees(np.linalg.norm(np.radians([0, 2.0, 2.0])))  # 2.83
    assert f"Accepted If nobody touched the lenses, the projector has turned by {change:.2f}°" in words
    assert "and was written to new.json" in words
    assert "Why this one It holds if nobody touched the lenses." in words
    assert "Rival margin points light move 1: " in words
    assert "Chosen pose Rival 1" in words
    assert pages["accepted"].advice[0].startswith("Measure with new.json from now on")
    assert PROVENANCE.command in words
    assert "retrue 0.1.0" in words
    expected = {"points before", "points after", "plane", "camera", "projector before", "projector after", "Rival 1"}
    assert names_in_space(pages["accepted"]) == expected


def test_a_refusal_says_what_to_do_and_still_shows_what_was_seen(pages):
    page = pages["refused"]
    assert (page.verdict, page.tone) == ("Refused", "warn")
    assert page.sentence.startswith("Another pose explains the captures as well")
    assert page.sentence.endswith("Nothing was written.")
    assert page.advice == ("Put an object or a second plane in view.",)
    assert {"Rival 1", "camera"} <= names_in_space(page)
    few = pages["hardly_anything"]
    assert few.advice == ("Light more of the scene.",)
    assert "found 5" in few.sentence


def test_a_rig_that_holds_says_so_and_asks_for_nothing():
    page = unchanged()
    assert (page.verdict, page.tone) == ("Unchanged", "good")
    assert "the rig still holds" in page.sentence
    assert "was kept" in page.sentence
    assert "written" not in page.sentence
    assert page.advice[0] == "Go on measuring: nothing has to be done."
    assert "What the captures say" in text_of(html(page))


def test_one_candidate_and_eight_fit_the_table():

    def candidate(*, chosen: bool) -> PoseCandidate:
        return PoseCandidate(RIG.projector_from_camera, (), 0.1, None, chosen)

    for rivals in (0, 7):
        candidates = (candidate(chosen=True), *(candidate(chosen=False) for _ in range(rivals)))
        (table,) = evidence_blocks(RIG, Evidence(10, candidates), shown_unit("m"))
        assert isinstance(table, Table)
        assert table.head == ("", "Chosen pose", *(f"Rival {number}" for number in range(1, rivals + 1)))
        assert all(len(row) == len(table.head) for row in table.rows)


def test_verdicts_of_verify(pages):
    assert (pages["good"].verdict, pages["good"].tone) == ("Holds", "good")
    assert (pages["drifted"].verdict, pages["drifted"].tone, pages["drifted"].advice) == (
        "Recalibrate",
        "bad",
        ("Recalibrate.",),
    )
    assert "first.png" in text_of(html(pages["good"]))


def test_a_calibration_shows_boards_coverage_and_sigmas(pages):
    page = pages["calibrated"]
    words = text_of(html(page))
    assert "Points are known to" in words
    for heading in ("Poses of the board", "What the board covered", "How well each pose fits", "What came out"):
        assert heading in words
    camera, projector, bars = charts(page)
    assert names_in_space(page) == {"camera", "projector", *(f"capture_{k}" for k in range(5))}
    for chart, size in ((camera, (1280, 960)), (projector, (1024, 768))):
        assert chart.figure["layout"]["xaxis"]["range"] == [-0.5, size[0] - 0.5]
        assert "times as long" in chart.caption
    assert all(0.05 < value < 0.2 for trace in bars.figure["data"] for value in trace["y"])  # 0.1 px a coordinate
    (intrinsics,) = (
        block
        for section in page.sections
        for block in section.blocks
        if isinstance(block, Table) and block.rows[0][0] == "fx"
    )
    assert abs(float(intrinsics.rows[0][1]) - 1600) < 10 * float(intrinsics.rows[0][2])
    alone = pages["calibration_refused"]
    assert alone.sentence.startswith("One pose of the board does not determine the intrinsics")


def test_a_unit_that_nobody_knows_is_not_called_millimetres():
    words = text_of(html(accepted(unit="unknown")))
    assert "rig units" in words
    assert not re.search(r"\d mm\b", words)
    assert shown_unit("in").text(1.0) == "25.4 mm"
    assert shown_unit("squares").text(12.34) == "12.3 squares"


def test_arrows_are_lengthened_by_a_round_factor():
    assert round_factor(np.full(10, 0.05), 38.4) == 500
    assert round_factor(np.zeros(3), 38.4) == pytest.approx(2e5)


def test_numbers_and_lines_have_no_nan_in_json():
    line = polyline(np.arange(8.0).reshape(2, 2, 2))
    assert numbers(line[:, 0]) == [0.0, 2.0, None, 4.0, 6.0, None]


@pytest.mark.parametrize("shape", [(900, 1600), (900, 1600, 3)])
def test_photographs_are_made_small(shape):
    picture = np.random.default_rng(0).integers(0, 65536, shape).astype(np.uint16)
    assert embedded_picture(picture).startswith("data:image/jpeg;base64,")
    assert len(embedded_picture(np.full(shape, 200, dtype=np.uint8))) < 40_000


def test_the_light_is_shown_as_measured_and_as_each_candidate_predicts_it():
    seen = capture(Scene(), area=(0.1, 0.9, 0.1, 0.9), grid=(30, 24))
    normal, distance = WALL
    n = normal / np.linalg.norm(normal) / distance
    y = RIG.projector.unproject(seen.projector_px)
    lit = np.exp(log_irradiance(y, RIG.projector_from_camera.R, RIG.projector_from_camera.t, np.tile(n, (len(y), 1))))
    points = replace(seen, light=lit)
    result = recalibrate(bumped(RIG, [0, 2, 0], [0, 2, 0]), [points])
    page = recalibration_page(RIG, [Capture("wall.png", points)], result)
    (section,) = (section for section in page.sections if section.title == "In the projector's light")
    (tabs,) = section.blocks
    assert [name for name, _ in tabs.panels][:3] == ["Measured", "Chosen pose", "Rival 1"]
    measured, chosen, rival = (np.array(chart.figure["data"][0]["customdata"]) for _, chart in tabs.panels[:3])
    assert np.abs(np.log(measured / chosen)).max() < 0.05
    if len(rival) == len(measured):
        assert np.median(np.abs(np.log(measured / rival))) > 0.1
    without = recalibration_page(RIG, [Capture("wall.png", seen)], result)
    assert "In the projector's light" not in [section.title for section in without.sections]
