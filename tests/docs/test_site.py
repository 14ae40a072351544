"""The site is whole, needs no network to be read, and is sound in a browser, from disk."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from playwright.sync_api import Browser

import retrue
from tests.docs.pages import DOCS, ROOT, pages

FETCHED = re.compile(r"<(?:script|img|iframe|link)\b[^>]*?(?:src|href)=\"?(?:https?:)?//[^>]*>")
LAPTOP, PHONE = 1280, 390
ALL = [page.relative_to(DOCS).with_suffix(".html") for page in pages()[1:]]
ONE_OF_A_KIND = [Path(name) for name in ("index.html", "quick-start.html", "method.html", "api/recalibration.html")]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built without a network, warnings as errors (not with --quiet, which would hide them from --strict too)."""
    folder = tmp_path_factory.mktemp("site")
    nowhere = dict.fromkeys(("http_proxy", "https_proxy", "HTTP_PROXY", "HTTPS_PROXY"), "http://127.0.0.1:9")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)],
        cwd=ROOT,
        env={**os.environ, **nowhere, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return folder


def test_every_page_is_there(site: Path) -> None:
    for page in pages()[1:]:
        assert (site / page.relative_to(DOCS)).with_suffix(".html").is_file()


def test_nothing_is_fetched(site: Path) -> None:
    for page in site.rglob("*.html"):
        assert FETCHED.findall(page.read_text(encoding="utf-8")) == [], page
    for style in site.rglob("*.css"):
        assert not re.search(r"url\(\s*[\"']?(?:https?:)?//", style.read_text(encoding="utf-8")), style


def test_equations_are_drawn_without_a_script(site: Path) -> None:
    method = (site / "method.html").read_text(encoding="utf-8")
    assert method.count("<math") > 20
    assert "arithmatex" not in method


def test_every_public_name_is_explained(site: Path) -> None:
    api = "".join(page.read_text(encoding="utf-8") for page in (site / "api").glob("*.html"))
    explained = set(re.findall(r'id="?retrue\.(\w+)[">]', api))
    assert set(dir(retrue)) - explained == set()


def test_links_of_the_readme_lead_somewhere() -> None:
    for target in re.findall(r"\]\((?!http)([^)#]+)", (ROOT / "README.md").read_text(encoding="utf-8")):
        assert (ROOT / target).is_file(), target


@pytest.mark.parametrize(("width", "shown"), [(LAPTOP, ONE_OF_A_KIND), (PHONE, ALL)], ids=["laptop", "phone"])
def test_pages_are_sound(browser: Browser, site: Path, width: int, shown: list[Path]) -> None:
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


def test_the_search_works_from_disk(browser: Browser, site: Path) -> None:
    view = browser.new_page(viewport={"width": LAPTOP, "height": 900})
    view.goto((site / "index.html").as_uri())
    view.click(".md-search__input")
    view.keyboard.type("keystone", delay=20)
    found = view.locator(".md-search-result__link")
    found.first.wait_for(timeout=20_000)
    assert any("pattern" in link.get_attribute("href") for link in found.all())
    view.close()
