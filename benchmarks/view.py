"""How many frames a second does the view draw while it is turned? Two million points in a headless browser.

    python -m benchmarks.view [POINTS]

No graphics card: the browser draws on the processor (SwiftShader). Frames are counted over three seconds of turning,
after two to settle; beside them the processor's time of all the browser's processes for a frame, which a busy machine
does not change, and how many points a frame held.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np

from retrue import Cloud, write_view

SIZES = ((1280, 900), (390, 844))
FLAGS = ["--no-sandbox", "--enable-unsafe-swiftshader", "--disable-gpu-compositing"]  # as a browser without a card
TURN = """(seconds) => new Promise((done) => {
  const root = document.querySelector('.space'), space = root.space, start = performance.now();
  let frames = 0, points = 0;
  const step = (now) => {
    if (now - start > 1000 * seconds) {
      done([frames, 1000 * frames / (now - start), points / frames, space.fineness]);
      return;
    }
    space.turn[0] += 0.02; space.move();
    frames += 1; points += space.drawn;
    requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
})"""


def make_cloud(count: int) -> Cloud:
    """A bowed wall with a ball before it, coloured, sure to a tenth."""
    rng = np.random.default_rng(0)
    xy = rng.uniform(-300, 300, (count, 2))
    away = np.hypot(*xy.T)
    z = 1000 + 2e-4 * xy[:, 0] ** 2 - np.where(away < 120, np.sqrt(np.maximum(120.0**2 - away**2, 0)), 0)
    colors = np.clip(128 + 100 * np.sin(xy / 20)[:, [0, 1, 0]] + rng.normal(0, 6, (count, 3)), 0, 255).astype(np.uint8)
    normals = np.tile([0.0, 0.0, -1.0], (count, 1))
    return Cloud(np.column_stack([xy, z]), colors, xy, "mm", normals=normals, sigma=rng.uniform(0.05, 0.2, count))


def processor_seconds() -> float:
    """Of every process below this one."""
    import psutil

    total = 0.0
    for process in psutil.Process().children(recursive=True):
        try:
            times = process.cpu_times()
        except psutil.NoSuchProcess:
            continue
        total += times.user + times.system
    return total


def main(count: int) -> None:
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as folder, sync_playwright() as play:
        path = Path(folder) / "view.html"
        write_view(path, make_cloud(count))
        print(f"{count:,} points, a page of {path.stat().st_size / 1e6:.1f} MB")
        for width, height in SIZES:
            browser = play.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
            page = browser.new_page(viewport={"width": width, "height": height})
            page.set_default_timeout(180_000)
            page.goto(path.as_uri())
            page.wait_for_selector(".space[data-ready]")
            page.wait_for_selector(f".space[data-drawn='{count}']")
            page.evaluate(TURN, 2.0)
            before = processor_seconds()
            frames, rate, points, fineness = page.evaluate(TURN, 3.0)
            each = 1000 * (processor_seconds() - before) / frames
            print(
                f"{width:5} px: {rate:5.1f} frames a second, {each:5.1f} ms of processor time a frame, "
                f"{points:10,.0f} points a frame, {100 * fineness:.0f} % of the pixels across"
            )
            browser.close()


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 2_000_000)
