"""Equations as MathML, made when the site is built: browsers draw them by themselves, and nothing is fetched."""

import html
import re
from typing import Any

from latex2mathml.converter import convert

EQUATION = re.compile(r'<(span|div) class="arithmatex">(.*?)</\1>', re.DOTALL)


def on_page_content(content: str, **_: Any) -> str:
    r"""The page with each \(...\) and \[...\] that the Markdown extension has marked drawn."""
    return EQUATION.sub(_drawn, content)


def _drawn(match: re.Match[str]) -> str:
    formula = html.unescape(match[2]).strip()
    display = "block" if formula.startswith(r"\[") else "inline"
    return convert(formula[2:-2].strip(), display=display)
