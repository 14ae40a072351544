"""The site is whole, and needs no network to be read."""

from __future__ import annotations

import re
from pathlib import Path

import retrue
from tests.docs.pages import DOCS, ROOT, pages

FETCHED = re.compile(r"<(?:script|img|iframe|link)\b[^>]*?(?:src|href)=\"?(?:https?:)?//[^>]*>")


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
