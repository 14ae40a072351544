"""`retrue export`, `retrue warp` and the depth map of `retrue reconstruct`."""

import json
from importlib.resources import files as resources
from pathlib import Path

import cv2
import numpy as np
import pytest

from retrue import read_rig, write_png

from .conftest import Retrue, names

DEMO = Path(str(resources("retrue") / "demo_data"))
RIG = DEMO / "rig_true.json"
SCENE = (DEMO / "scene.jpg", "--pattern", DEMO / "pattern.json")


@pytest.mark.parametrize(
    ("tool", "expected"),
    [
        ("colmap", ["images", "sparse"]),
        ("nerfstudio", ["depth", "images", "points.ply", "transforms.json"]),
        ("bag", ["bag.db3", "metadata.yaml"]),
    ],
)
def test_a_scan_is_handed_over(retrue: Retrue, tmp_path: Path, tool: str, expected: list[str]) -> None:
    run = retrue("export", RIG, *SCENE, "--to", tool, "--out", tmp_path / "bag", "--json")
    assert run.status == 0, run.err
    assert names(tmp_path / "bag") == expected
    assert run.json["points"][0] > 1600


def test_a_rig_alone_is_handed_over_to_ros(retrue: Retrue, tmp_path: Path) -> None:
    run = retrue("export", RIG, "--to", "ros", "--out", tmp_path / "ros")
    assert run.status == 0, run.err
    assert names(tmp_path / "ros") == ["camera.yaml", "projector.yaml", "rig.urdf", "static_transforms.launch.xml"]


def test_nothing_is_handed_over_that_contradicts_the_rig(retrue: Retrue, tmp_path: Path) -> None:
    for command in (("export", "--to", "colmap"), ("warp", "--picture", DEMO / "scene.jpg")):
        run = retrue(command[0], DEMO / "rig_before.json", *SCENE, *command[1:], "--out", tmp_path / "out", "--json")
        assert run.status == 1, run.err
        assert run.json["out"] is None
    assert names(tmp_path) == []


def test_mistakes_are_said_before_the_work(retrue: Retrue, tmp_path: Path) -> None:
    out = ("--out", tmp_path / "out")
    run = retrue("export", RIG, *SCENE, "--to", "unity", *out)
    run.require_complaint("--to", "colmap, nerfstudio, ros, bag", "unity")
    retrue("export", RIG, "--to", "colmap", *out).require_complaint("--to colmap", "one CAPTURE", "found 0")
    (tmp_path / "out").mkdir()
    retrue("export", RIG, *SCENE, "--to", "bag", *out).require_complaint("expected a new name for the bag")
    retrue("warp", RIG, *SCENE, "--picture", DEMO / "scene.jpg", "--every", 0, *out).require_complaint("--every", "0")


def test_a_picture_is_warped(retrue: Retrue, tmp_path: Path) -> None:
    write_png(tmp_path / "white.png", np.full((30, 40), 255, np.uint8))
    run = retrue("warp", RIG, *SCENE, "--picture", tmp_path / "white.png", "--out", tmp_path / "out", "--json")
    assert run.status == 0, run.err
    assert names(tmp_path / "out") == ["mesh.data", "st.tiff", "warped.png"]
    shown = cv2.imread(str(tmp_path / "out" / "warped.png"), cv2.IMREAD_UNCHANGED)
    assert shown.shape[:2] == read_rig(RIG).projector.size[::-1]
    assert (shown == 255).mean() == pytest.approx(run.json["share_of_projector"], abs=1e-6)
    width, height = run.json["rectangle"][2:]
    assert width / height == pytest.approx(4 / 3, rel=0.01)


def test_a_depth_map_goes_beside_the_cloud(retrue: Retrue, tmp_path: Path) -> None:
    out = ("--out", tmp_path / "cloud.npz", "--depth", tmp_path / "depth.png", "--undistorted", "--json")
    run = retrue("reconstruct", RIG, *SCENE, *out)
    assert run.status == 0, run.err
    depth = cv2.imread(str(tmp_path / "depth.png"), cv2.IMREAD_UNCHANGED)
    camera = json.loads((tmp_path / "depth.png.json").read_text())["camera"]
    assert not any(camera["distortion"])
    assert depth.shape[::-1] == tuple(camera["size"])
    assert (depth > 0).sum() == run.json["depth_pixels"]
    points = np.load(tmp_path / "cloud.npz")["points"]
    pixels = np.round((points @ np.transpose(camera["K"]))[:, :2] / points[:, 2:]).astype(int)
    there = depth[pixels[:, 1], pixels[:, 0]] > 0  # not all: at the rim of a surface half of them round outwards
    off = depth[pixels[:, 1], pixels[:, 0]][there] - 1000 * points[there, 2]
    assert there.mean() > 0.8
    assert np.median(np.abs(off)) < 1.0
