"""The pages in a real browser: headless Chromium, with WebGL in software."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Locator, Page

from .pages import PAGES, html

WIDE, NARROW = {"width": 1280, "height": 800}, {"width": 390, "height": 844}
BLUE = (0x6E, 0xA8, 0xFF)  # the camera's frustum, on dark whatever the page


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("pages")
    for name, make in PAGES.items():
        (folder / f"{name}.html").write_text(html(make()), encoding="utf-8")
    return {name: folder / f"{name}.html" for name in PAGES}


def opened(browser: Browser, path: Path, scheme: str = "light") -> Page:
    """The page from disk, everything drawn; any complaint or request fails the test."""
    page = browser.new_page(viewport=WIDE, color_scheme=scheme)
    complaints: list[str] = []
    page.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda request: complaints.append(request.url))
    page.goto(path.as_uri())
    if page.locator(".plot").count():
        page.wait_for_selector("html[data-ready]", state="attached")
    for index in range(page.locator(".space").count()):
        page.locator(".space").nth(index).and_(page.locator("[data-ready]")).wait_for()
    assert [line for line in complaints if not line.startswith(("blob:", path.as_uri()))] == []
    return page


@pytest.fixture(scope="module")
def accepted(browser: Browser, files: dict[str, Path]) -> Iterator[Page]:
    """One page for all that does not change it for good."""
    page = opened(browser, files["accepted"])
    yield page
    page.close()


def pixels(element: Locator) -> np.ndarray:
    """What the element looks like, (height, width, 3)."""
    return np.asarray(Image.open(io.BytesIO(element.screenshot())).convert("RGB")).astype(int)


def scene(page: Page) -> Locator:
    return page.locator(".space canvas").first


def turn_over(page: Page, size: dict[str, int], scheme: str) -> None:
    """Another width, another color scheme, and time to draw."""
    page.set_viewport_size(size)
    page.emulate_media(color_scheme=scheme)
    page.wait_for_timeout(500)


@pytest.mark.parametrize("name", PAGES)
def test_loads_draws_and_fits(browser, files, name):
    page = opened(browser, files[name])
    for size, scheme in ((WIDE, "light"), (NARROW, "dark")):
        turn_over(page, size, scheme)
        assert page.evaluate("document.documentElement.scrollWidth") == size["width"]
        plots = page.locator(".plot")
        for index in range(plots.count()):
            assert plots.nth(index).locator("svg.main-svg").count() > 0
        shade = np.median(pixels(page.locator("header")))
        assert shade > 230 if scheme == "light" else shade < 60
        if scene(page).count() == 0:
            assert name in ("calibration_refused", "hardly_anything")
            continue
        drawn = pixels(scene(page))
        if name != "reconstructed":  # which shows its points, and the devices when one turns round
            assert (np.abs(drawn - BLUE).max(axis=2) < 40).sum() > 30, "the camera's frustum is not there"
        assert len(np.unique(drawn.reshape(-1, 3), axis=0)) > 20
    page.close()


def test_the_mouse_turns_the_scene(accepted):
    scene(accepted).scroll_into_view_if_needed()
    before = pixels(scene(accepted))
    box = scene(accepted).bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    accepted.mouse.move(x, y)
    accepted.mouse.down()
    accepted.mouse.move(x + 160, y + 20, steps=8)
    accepted.mouse.up()
    accepted.wait_for_timeout(300)
    assert (np.abs(pixels(scene(accepted)) - before).max(axis=2) > 40).sum() > 2000


def test_hovering_tells_the_residual(accepted):
    panel = accepted.locator('[role="tabpanel"].shown')
    point = panel.locator(".scatterlayer path.point").nth(400)
    point.scroll_into_view_if_needed()
    box = point.bounding_box()
    assert box is not None
    accepted.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2, steps=3)
    label = panel.locator(".hoverlayer .hovertext").first
    label.wait_for(state="attached")
    said = label.text_content() or ""
    assert "residual" in said
    assert said.endswith(" px")


def test_tabs_by_mouse_and_by_key(accepted):
    tabs, panels = accepted.get_by_role("tab"), accepted.locator('[role="tabpanel"]')
    assert [tabs.nth(k).inner_text() for k in range(3)] == ["After", "Before", "Arrows"]
    assert [panels.nth(k).is_visible() for k in range(3)] == [True, False, False]
    tabs.nth(1).click()
    assert [panels.nth(k).is_visible() for k in range(3)] == [False, True, False]
    assert tabs.nth(1).get_attribute("aria-selected") == "true"
    accepted.keyboard.press("ArrowRight")
    assert [panels.nth(k).is_visible() for k in range(3)] == [False, False, True]
    assert tabs.nth(2).evaluate("tab => tab === document.activeElement")


def test_paper_is_light_and_shows_all_tabs_and_a_picture_of_the_scene(accepted):
    turn_over(accepted, WIDE, "dark")
    assert accepted.pdf(format="A4").startswith(b"%PDF")
    accepted.emulate_media(media="print")
    assert accepted.evaluate("document.querySelector('img.paper').naturalWidth") > 900
    assert accepted.locator("img.paper").first.is_visible()
    assert not scene(accepted).is_visible()
    assert all(accepted.locator('[role="tabpanel"]').nth(k).is_visible() for k in range(3))
    assert not accepted.locator(".tablist").is_visible()
    red, green, blue = accepted.evaluate("getComputedStyle(document.body).color.match(/[0-9]+/g).map(Number)")
    assert max(red, green, blue) < 60


def test_words_and_tables_need_no_javascript(browser, files):
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(files["accepted"].as_uri())
    assert page.get_by_role("heading", name="Accepted").is_visible()
    assert page.get_by_role("table").first.is_visible()
    assert "need JavaScript" in page.locator("body").inner_text()
    context.close()
