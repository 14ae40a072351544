"""The drawing in space: what travels to the browser, and what it does there."""

import base64
import gzip
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from retrue import Cloud, InputError, Mesh, write_view
from retrue.report.space import MOST_POINTS, Layer, Line, space_html, space_page


def plane(count=4000, depth=1000.0, unit="mm"):
    rng = np.random.default_rng(1)
    points = np.column_stack([rng.uniform(-200, 200, (count, 2)), np.full(count, depth)])
    colors = rng.integers(0, 256, (count, 3)).astype(np.uint8)
    normals = np.tile([0.0, 0.0, -1.0], (count, 1))
    return Cloud(points, colors, points[:, :2], unit, normals=normals, sigma=np.linspace(0.1, 1, count))


def spec_of(html):
    return json.loads(re.search(r'<script type="application/json">(.*?)</script>', html, re.S).group(1))


def unpacked(text, kind):
    return np.frombuffer(gzip.decompress(base64.b64decode(text)), kind)


def test_points_travel_to_a_small_part_of_their_extent():
    cloud = plane()
    (layer,) = spec_of(space_html([Layer("points", cloud)]))["layers"]
    places = unpacked(layer["place"], "<u2").reshape(-1, 3) / 65535 * layer["extent"] + layer["low"]
    colors = unpacked(layer["tint"], "u1").reshape(-1, 3)
    distance, row = cKDTree(cloud.points).query(places)
    assert len(np.unique(row)) == len(cloud)
    assert distance.max() < 400 / 65535
    assert np.array_equal(colors, cloud.colors[row])


def test_the_first_points_are_an_even_thinning():
    (layer,) = spec_of(space_html([Layer("points", plane())]))["layers"]
    few = unpacked(layer["place"], "<u2").reshape(-1, 3)[:400]
    counts = np.histogram2d(few[:, 0], few[:, 1], bins=4)[0]
    assert counts.min() > 8


def test_too_many_points_are_thinned_and_that_is_said():
    assert MOST_POINTS >= 2_000_000
    (layer,) = spec_of(space_html([Layer("points", plane())], most=1000))["layers"]
    assert layer["of"] == "1,000 of 4,000"
    assert len(unpacked(layer["place"], "<u2")) == 3 * 1000


def test_a_mesh_of_too_many_faces_is_shown_as_points(monkeypatch):
    cloud = plane(30)
    mesh = Mesh(cloud.points, cloud.colors, np.arange(30).reshape(-1, 3), "mm")
    (layer,) = spec_of(space_html([Layer("mesh", mesh)]))["layers"]
    assert (len(unpacked(layer["faces"], "<u4")), layer["of"]) == (30, "30")
    monkeypatch.setattr("retrue.report.space.MOST_FACES", 9)
    (layer,) = spec_of(space_html([Layer("mesh", mesh)]))["layers"]
    assert (layer["faces"], layer["of"]) == (None, "30, as points: 10 faces are too many")


def test_a_sparse_grid_is_drawn_as_the_surface_that_it_shows(monkeypatch):
    """Blocks of a colour grid far apart would look like confetti; what was set aside is on no surface."""
    row, column = np.mgrid[:12, :20].reshape(2, -1)
    points = np.column_stack([10.0 * column, 10.0 * row, np.full(240, 900.0)])
    cells = np.column_stack([row, column])
    colors, step = np.full((240, 3), 9, np.uint8), np.linspace(0.1, 1, 240)
    cloud = Cloud(points, colors, points[:, :2], "mm", cells, sigma=step)
    (layer,) = spec_of(space_html([Layer("points", cloud)]))["layers"]
    faces = unpacked(layer["faces"], "<u4").reshape(-1, 3)
    assert len(faces) == 2 * 11 * 19
    places = unpacked(layer["place"], "<u2").reshape(-1, 3) / 65535 * layer["extent"] + layer["low"]
    assert np.abs(np.diff(places[faces], axis=1)).max() < 10.1  # between neighbours, so in the order of the points
    assert np.ptp(unpacked(layer["known"], "u1")[::2]) > 200  # and coloured by sigma where that is asked
    assert layer["dots"]
    assert spec_of(space_html([Layer("set aside", cloud, aside=True)]))["layers"][0]["faces"] is None
    monkeypatch.setattr("retrue.report.space.SPARSE", 239)
    assert spec_of(space_html([Layer("points", cloud)]))["layers"][0]["faces"] is None


def test_all_that_is_to_be_seen_at_first_is_named():
    far = Line("far", np.array([[0.0, 0, 0], [0, 0, 5000]]), (1, 1, 1))
    layers = [Layer("points", plane())]
    near, whole = (np.array(spec_of(space_html(layers, [far], about=about))["ends"]) for about in ("points", "all"))
    assert near[:, 2].max() == pytest.approx(1000)
    assert whole[:, 2].max() == 5000
    alone = spec_of(space_html([], [far]))
    assert np.array(alone["ends"])[:, 2].tolist() == [0, 5000]
    assert alone["layers"] == []


def test_the_first_view_is_as_near_as_the_points_let_it():
    cloud = plane()
    slanted = replace(cloud, points=cloud.points + cloud.points[:, :1] * [0, 0, 3.0])  # its box is mostly empty
    ends = np.array(spec_of(space_html([Layer("points", slanted)]))["ends"])
    assert cKDTree(slanted.points).query(ends)[0].max() < 1e-6
    for axis in range(3):
        assert np.ptp(ends[:, axis]) > 0.97 * np.ptp(slanted.points[:, axis])


def test_what_cannot_be_drawn_is_refused():
    with pytest.raises(InputError, match="expected points"):
        space_html([])
    with pytest.raises(InputError, match="one unit"):
        space_html([Layer("a", plane()), Layer("b", plane(unit="m"))])
    with pytest.raises(InputError, match="expected points"):
        write_view("never.html")


def test_names_are_no_markup():
    page = space_page([Layer("</script><b>", plane())], [Line("<q>", np.zeros((2, 3)), (1, 1, 1))], "<script>")
    assert "</script><b>" not in page
    assert "<q>" not in page
    assert "<title><script>" not in page


@pytest.mark.parametrize("width", [1280, 390])
def test_clicks_measure_a_slider_compares_and_planes_cut(browser, tmp_path, width):
    cloud = plane(60_000)
    write_view(tmp_path / "view.html", cloud, before=replace(cloud, points=cloud.points * [1, 1, 1.1]))
    page = browser.new_page(viewport={"width": width, "height": 800})
    errors = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto((tmp_path / "view.html").as_uri())
    page.wait_for_selector(".space[data-ready]")
    page.wait_for_selector(".space[data-drawn='120000']")
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    found = page.evaluate(
        """() => {
          const space = document.querySelector('.space').space;
          space.turn = [0, 0]; space.frame(0);
          const apart = [[-50, 0, 1000], [50, 0, 1000]].map((at) => space.onScreen(at));
          space.spec.layers[0].shown = false;
          for (const [x, y] of apart) space.click(x, y);
          return document.querySelector('.measured').textContent;
        }"""
    )
    assert float(found.split()[0]) == pytest.approx(100, abs=12)
    page.fill(".truth input", "200")
    assert "lengths" in page.text_content(".measured")
    page.select_option(".unit", "m")
    assert float(page.text_content(".measured").split()[0]) == pytest.approx(0.1, abs=0.012)
    assert page.is_visible(".compare input")
    page.select_option(".mode", "sigma")
    page.wait_for_selector(".bar", state="visible")
    cut = page.evaluate(
        """() => {
          const space = document.querySelector('.space').space, lit = () => {
            const gl = space.gl, px = new Uint8Array(4 * gl.drawingBufferWidth * gl.drawingBufferHeight);
            space.filled = 0; space.moving = false;
            do space.frame(0); while (space.filled < space.total);
            gl.readPixels(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight, gl.RGBA, gl.UNSIGNED_BYTE, px);
            let count = 0;
            for (let k = 0; k < px.length; k += 4) count += px[k] > 60 || px[k + 1] > 60;
            return count;
          };
          space.spec.layers[0].shown = true;  // each is shown on its side of the slider
          const whole = lit(); space.cut.low[0] = 0; return lit() / whole;
        }"""
    )
    assert 0.35 < cut < 0.65
    assert not errors
    page.close()


@pytest.mark.parametrize("width", [1280, 390])
def test_slow_frames_hold_fewer_points_and_a_view_at_rest_all(browser, tmp_path, width):
    write_view(tmp_path / "view.html", plane(150_000))
    page = browser.new_page(viewport={"width": width, "height": 800})
    page.goto((tmp_path / "view.html").as_uri())
    page.wait_for_selector(".space[data-drawn='150000']")
    slow, slower, fast = page.evaluate(
        """() => [80, 800, 5].map((milliseconds) => {
          const space = document.querySelector('.space').space;
          for (let frame = 0; frame < (milliseconds < 20 ? 200 : 2); frame++) space.learn(milliseconds);
          space.before = null; space.move(); space.frame();
          return [space.drawn, space.root.querySelector('.thinned')?.textContent];
        })"""
    )
    assert 5_000 <= slower[0] < slow[0] < 50_000
    assert slower[1] == f"{slower[0]:,} of 150,000 points while it moves"
    assert fast == [150_000, None]
    page.evaluate("document.querySelector('.space').space.learn(800), document.querySelector('.space').space.move()")
    page.wait_for_selector(".space[data-drawn='150000']")
    page.wait_for_selector(".thinned", state="detached")
    page.close()
