"""`--report` on every command that has it."""

import re
import shutil
from collections import Counter
from html import unescape
from pathlib import Path

import cv2
import numpy as np
import pytest

from retrue import Camera, Rig, RigidTransform, write_pattern, write_rig
from retrue.files import images
from retrue.files.atomic import read_bytes
from retrue.patterns.gray_code import GrayCode

from .conftest import names

DEMO = Path(__file__).parents[2] / "src" / "retrue" / "demo_data"


def words(page: Path) -> str:
    """What a reader reads."""
    document = re.sub(r"<(style|script)\b.*?</\1>", " ", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    return " ".join(unescape(re.sub(r"<[^>]+>", " ", document)).split())


@pytest.fixture
def page(tmp_path):
    return tmp_path / "page.html"


def test_recalibrate(retrue, files, page):
    run = retrue("recalibrate", files.before, files.points, "--out", files.folder / "new.json", "--report", page)
    assert run.status == 0
    assert f"{page}: report written" in run.out
    said = words(page)
    assert "Accepted If nobody touched the lenses, the projector has turned by 5.0" in said
    assert "600 correspondences in points.csv" in said
    assert f"retrue recalibrate {files.before} {files.points} --out" in said
    assert re.search(r"Python 3\.\d+.* retrue 0\.", said)


def test_a_refusal_is_shown_too(retrue, files, page):
    rng = np.random.default_rng(1)
    noise = "".join(",".join(f"{x:.3f}" for x in rng.uniform(0, 700, 4)) + "\n" for _ in range(200))
    files.points.write_text("camera_x,camera_y,projector_x,projector_y\n" + noise)
    new = files.folder / "new.json"
    run = retrue("recalibrate", files.before, files.points, "--out", new, "--report", page, "--json")
    assert run.status == 1
    assert run.json["page"] == str(page)
    assert not new.exists()
    said = words(page)
    assert "Refused" in said
    assert "Nothing was written." in said
    assert "200 correspondences" in said


@pytest.mark.parametrize(("rig", "verdict", "band"), [("rig", "good", "Holds"), ("before", "drifted", "Recalibrate")])
def test_verify(retrue, files, page, rig, verdict, band):
    run = retrue("verify", getattr(files, rig), files.points, "--report", page, "--json")
    assert run.json["verdict"] == verdict
    assert f"retrue verify {band} The capture supports" in words(page)


def test_each_picture_is_read_once(retrue, page, tmp_path, monkeypatch):
    pattern, folder = GrayCode((80, 60)), tmp_path / "capture"
    folder.mkdir()
    for index, picture in enumerate(pattern.render()):
        seen = cv2.resize(picture, (240, 180), interpolation=cv2.INTER_NEAREST) // 2 + 20
        cv2.imwrite(str(folder / f"{index:02d}.png"), seen)
    write_pattern(tmp_path / "pattern.json", pattern)
    camera = Camera((240, 180), [[300, 0, 119.5], [0, 300, 89.5], [0, 0, 1]])
    projector = Camera((80, 60), [[100, 0, 39.5], [0, 100, 29.5], [0, 0, 1]])
    write_rig(tmp_path / "rig.json", Rig(camera, projector, RigidTransform(np.eye(3), [-200.0, 0.0, 0.0]), unit="mm"))
    read = Counter()

    def counted(path, limit):
        read[path.name] += 1
        return read_bytes(path, limit)

    monkeypatch.setattr(images, "read_bytes", counted)
    run = retrue("verify", tmp_path / "rig.json", folder, "--pattern", tmp_path / "pattern.json", "--report", page)
    assert "page.html: report written" in run.out
    assert "correspondences in capture" in words(page)
    assert read == {path.name: 1 for path in folder.iterdir()}


def test_reconstruct(retrue, files, page):
    cloud, mesh = files.folder / "cloud.ply", files.folder / "mesh.ply"
    run = retrue("reconstruct", files.rig, files.points, "--out", cloud, "--mesh", mesh, "--report", page, "--json")
    assert run.status == 0
    said = words(page)
    assert f"{run.json['points']:,} of 600 correspondences were placed in space" in said
    assert f"Faces {run.json['faces']:,}" in said


def test_calibrate(retrue, board, page, tmp_path):
    captures = [board / f"capture_{number}" for number in range(3)]
    options = ["--pattern", board / "pattern.json", "--board", "chessboard:7x9:75mm", "--out", tmp_path / "rig.json"]
    assert retrue("calibrate", *captures, *options, "--report", page).status == 0
    said = words(page)
    assert "Calibrated 3 poses" in said
    assert "capture_0 capture_1 capture_2" not in said
    assert "Points are known to" in said
    assert "the projector has not seen it top right" in said.lower()


def test_demo_leaves_one_beside_its_files(retrue, tmp_path):
    assert retrue("demo", "--out", tmp_path).status == 0
    page = tmp_path / "report.html"
    assert "Distance from the truth" in words(page)
    assert "data:image/jpeg;base64," in page.read_text(encoding="utf-8")
    assert page.stat().st_size < 10e6


def test_a_hostile_file_name_stays_a_name(retrue, tmp_path, page):
    hostile = "<script>alert(1)<img src=x onerror=alert(2)>.jpg"
    shutil.copyfile(DEMO / "scene.jpg", tmp_path / hostile)
    rig, pattern = DEMO / "rig_true.json", DEMO / "pattern.json"
    assert retrue("verify", rig, tmp_path / hostile, "--pattern", pattern, "--report", page).status == 0
    assert f"correspondences in {hostile}." in words(page)
    assert "<img src=x" not in page.read_text(encoding="utf-8")


def test_a_page_that_cannot_be_written_is_found_out_first(retrue, files):
    before = names(files.folder)
    gone = files.folder / "none" / "page.html"
    run = retrue("recalibrate", files.before, files.points, "--out", files.folder / "new.json", "--report", gone)
    run.require_complaint(str(gone), "is no folder")
    assert names(files.folder) == before


def test_without_a_report_nothing_of_it_is_loaded(files):
    import subprocess
    import sys

    code = (
        "import sys; from retrue.cli.main import main\n"
        f"main(['verify', {str(files.rig)!r}, {str(files.points)!r}])\n"
        "assert not {'plotly', 'jinja2', 'PIL'} & set(sys.modules), sorted(sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
