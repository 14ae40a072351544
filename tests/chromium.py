"""Pages in a real browser: headless Chromium."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser

CHROMIUM = shutil.which("chromium")
SOFTWARE_WEBGL = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
NOTHING_ELSE_BY_IT = ["--disable-gpu-rasterization", "--disable-gpu-compositing"]  # a GPU played by the CPU is slow


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """One for all tests of a module: each opens pages of its own."""
    if CHROMIUM is None:
        pytest.skip("no chromium here: `make browser` installs it")
    from playwright.sync_api import sync_playwright

    flags = [*SOFTWARE_WEBGL, *NOTHING_ELSE_BY_IT, "--no-sandbox", "--disable-dev-shm-usage"]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=flags)
        yield browser
        browser.close()
