"""The site as a reader sees it, from disk: no errors, no requests to anywhere, nothing wider than the screen."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.docs.pages import DOCS, pages

sync_api = pytest.importorskip("playwright.sync_api", reason="no playwright here")
CHROMIUM = shutil.which("chromium")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium here")
LAPTOP, PHONE = 1280, 390
ALL = [page.relative_to(DOCS).with_suffix(".html") for page in pages()[1:]]
ONE_OF_A_KIND = [Path(name) for name in ("index.html", "quick-start.html", "method.html", "api/recalibration.html")]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.mark.parametrize(("width", "shown"), [(LAPTOP, ONE_OF_A_KIND), (PHONE, ALL)], ids=["laptop", "phone"])
def test_pages_are_sound(browser: Any, site: Path, width: int, shown: list[Path]) -> None:
    view = browser.new_page(viewport={"width": width, "height": 900})
    complaints: list[str] = []
    view.on("console", lambda said: complaints.append(said.text) if said.type in ("error", "warning") else None)
    view.on("pageerror", lambda error: complaints.append(str(error)))
    view.on("request", lambda asked: None if asked.url.startswith(("file:", "data:")) else complaints.append(asked.url))
    for page in shown:
        view.goto((site / page).as_uri())
        assert view.evaluate("document.documentElement.scrollWidth") <= width, page
        lost = view.evaluate("[...document.images].filter(i => i.complete && !i.naturalWidth).map(i => i.src)")
        assert lost == [], page
    assert complaints == []
    view.close()


def test_the_search_works_from_disk(browser: Any, site: Path) -> None:
    view = browser.new_page(viewport={"width": LAPTOP, "height": 900})
    view.goto((site / "index.html").as_uri())
    view.click(".md-search__input")
    view.keyboard.type("keystone", delay=20)
    found = view.locator(".md-search-result__link")
    found.first.wait_for(timeout=20_000)
    assert any("pattern" in link.get_attribute("href") for link in found.all())
    view.close()
