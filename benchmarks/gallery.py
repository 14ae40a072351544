"""Pictures of real scans for docs/view.md, as the page shows them: a skull and a sea shell, from ../shared/data.

    python -m benchmarks.gallery [FOLDER]

Needs playwright and a Chromium. The shell is the left half of its capture; on its right stands a box.
"""

from __future__ import annotations

import io
import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image
from scipy import sparse

import retrue
from benchmarks.view import FLAGS
from retrue.patterns.layouts import layout_sequence
from retrue.reconstruction.cloud import Cloud, Mesh
from retrue.reconstruction.mesh import surface_faces

DATA = Path(__file__).parents[2] / "shared" / "data"
SETTLED = """() => new Promise((done) => {
  const root = document.querySelector('.space');
  let before = '';
  const look = () => {
    if (root.dataset.drawn === before) return done();
    before = root.dataset.drawn;
    setTimeout(look, 4000);
  };
  setTimeout(look, 4000);
})"""  # all points are in
PAGE, PAIR = (760, 800), (550, 656)


def scanned(rig: Path, folder: Path, layout: str, projector: tuple[int, int], axes: list[str] | None) -> Cloud:
    """The cloud of a folder, smoothed, of its largest surfaces, small holes closed, with normals."""
    pattern = layout_sequence(layout, projector, axes)
    points = retrue.decode(pattern, retrue.read_folder(folder)[0])
    options = retrue.ReconstructOptions(smooth=True)
    cloud = retrue.fill_holes(retrue.reconstruct(retrue.read_rig(rig, unit="mm"), points, options))
    return retrue.with_normals(in_largest(cloud))


def in_largest(cloud: Cloud) -> Cloud:
    """What is of its largest surface, or of one that has a tenth of its faces."""
    faces = surface_faces(cloud)
    links = np.concatenate([faces[:, :2], faces[:, 1:]])
    graph = sparse.coo_array((np.ones(len(links)), links.T), shape=(len(cloud), len(cloud)))
    piece = sparse.csgraph.connected_components(graph, directed=False)[1][faces[:, 0]]
    sizes = np.bincount(piece)
    found = np.zeros(len(cloud), np.bool_)
    found[faces[sizes[piece] > 0.1 * sizes.max()]] = True
    return cloud.select(found)


def shown(model: Cloud | Mesh, title: str, color: str, size: tuple[int, int], *, whole: bool) -> Image.Image:
    """The page, or of it what is drawn, in a window of that size."""
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as folder, sync_playwright() as play:
        path = Path(folder) / f"{title}.html"
        retrue.write_view(path, model)
        browser = play.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        height = size[1] if whole else size[1] + 400
        page = browser.new_page(viewport={"width": size[0], "height": height})
        page.goto(path.as_uri())
        page.wait_for_selector(".space[data-ready]", timeout=90_000)
        page.select_option(".space select >> nth=0", label=color)
        page.evaluate(SETTLED)
        taken = page.screenshot() if whole else page.locator(".space canvas").first.screenshot()
        browser.close()
    return Image.open(io.BytesIO(taken)).convert("RGB")


def main(folder: Path) -> None:
    scanner = DATA / "phase-scanner"
    skull = scanned(scanner / "calibration.xml", scanner / "skull_2x3", "slstudio-2x3", (1824, 1140), ["column"])
    shown(skull, "skull", "sigma", PAGE, whole=True).save(folder / "skull-sigma.png", optimize=True)
    sea = DATA / "gray-shell"
    shells = scanned(sea / "procam_2016_12_09.yaml", sea, "sltk", (1280, 800), None)
    x, _, z = shells.points.T
    shell = shells.select(x / z < (np.min(x / z) + np.max(x / z)) / 2)
    parts = [
        shown(skull, "scan", "normal", PAIR, whole=False),
        shown(retrue.make_mesh(in_largest(shell)), "scan", "true colour", PAIR, whole=False),
    ]
    pair = Image.new("RGB", (sum(part.width for part in parts), max(part.height for part in parts)), (38, 42, 50))
    for number, part in enumerate(parts):
        pair.paste(part, (number * parts[0].width, 0))
    pair.save(folder / "skull-shell.jpg", quality=88)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("docs/gallery/pictures"))
