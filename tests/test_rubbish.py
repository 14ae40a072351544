"""Every public function, handed rubbish for each of its arguments, says so: no error of Python's own comes out."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import retrue
from tests.examples import examples

PICTURE = np.full((48, 64, 3), 90, np.uint8)
PLACES = np.random.default_rng(0).uniform(-1, 1, (30, 2))
HOMOGRAPHY = np.array([[1.1, 0.1, 0.2], [0.0, 0.9, -0.1], [0.1, 0.0, 1.0]])


class Thing:
    """No argument is one."""


RUBBISH: list[Any] = [
    None, "a\0b", "two words", Path("no.png"), Thing(), Thing, -1, 1e300, float("nan"), [], [None], {}, b"bytes",
    (1.5, -2), np.zeros((2, 2)), np.array([["text"]]), np.full((5, 3), np.nan), lambda: 0, range(3),
]  # fmt: skip


@cache
def calls() -> dict[str, Mapping[str, Any]]:
    """Of each public function, arguments that are right, or all but."""
    made: dict[str, Any] = examples()
    rig, points, cloud, pattern = (made[name] for name in ("Rig", "Correspondences", "Cloud", "ColorGrid"))
    views, warp = retrue.rig_views(rig, cloud, None, None), retrue.warp(rig, cloud, (64, 48))
    board, residuals = made["Board"], [("now", np.zeros(len(points)))]
    pixels = {"first_px": [300, 300], "second_px": [600, 400]}
    return {
        "accept": {"clouds": [cloud], "artefact": made["Artefact"], "options": None, "names": ()},
        "calibrate": {"captures": [made["BoardCapture"]], "board": board, "projector_size": (1024, 768)}
        | {"options": None, "camera": rig.camera, "projector": rig.projector},
        "cloud_picture": {"cloud": cloud, "rig": rig},
        "decode": {"pattern": pattern, "images": PICTURE},
        "depth_map": {"cloud": cloud, "camera": rig.camera},
        "epipolar_residuals": {"rig": rig, "points": points},
        "error_by_distance": {"rig": rig, "distances": [3.0, 1e9, 1e300], "noise_px": 0.1},
        "fill_holes": {"cloud": cloud},
        "fit_homography": {"source": PLACES, "target": 2 * PLACES, "source_sigma": 1.0, "target_sigma": 1.0}
        | {"weights": None, "iterations": 5},
        "fit_homography_robust": {"source": PLACES, "target": 2 * PLACES, "noise": 0.1, "seed": 0},
        "layout_sequence": {"name": "slstudio-2x3", "projector_size": (1824, 1140), "axes": None, "step_px": 1},
        "make_cad": {"cloud": cloud, "options": None},
        "make_cloud": {"points": cloud.points, "colors": None, "normals": None, "unit": "mm"},
        "make_color_grid": {"projector_size": (64, 48), "rows": 4, "columns": 5, "colors": pattern.colors}
        | {"pitch": None, "block": None, "gap": None, "seed": 0, "window": 3},
        "make_line_grid": {"projector_size": (800, 600)},
        "make_mesh": {"cloud": cloud},
        "make_rig": {"setup": made["Setup"], "rig": rig},
        "match_through_code": {"first": points, "second": points},
        "merge": {"clouds": [cloud, cloud], "options": None, "names": ()},
        "parse_artefact": {"spec": "plane"},
        "parse_board": {"spec": "chessboard:7x9:75mm"},
        "parse_setup": {"text": "[camera]", "path": "setup.toml"},
        "planar_pose_candidates": {"homography": HOMOGRAPHY, "viewing_ray": [0, 0, 1]},
        "planar_pose_candidates_batch": {"homographies": HOMOGRAPHY[None], "viewing_ray": [0, 0, 1]},
        "read_board_capture": {"path": "no", "pattern": None, "board": board},
        "read_board_captures": {"paths": ["no"], "pattern": None, "board": board},
        "read_capture": {"path": "points.csv", "pattern": None},
        "read_device": {"path": "rig.json", "role": "camera", "size": None},
        "read_folder": {"path": ".", "color": ()},
        "read_history": {"rig_path": "rig.json", "last": None},
        "read_image": {"path": "picture.png"},
        "read_pattern": {"path": "pattern.json"},
        "read_points": {"path": "points.csv"},
        "read_rig": {"path": "rig.json", "camera_size": None, "projector_size": None, "unit": None},
        "read_stereo_captures": {"paths": ["a", "b"], "board": board, "pattern": None},
        "recalibrate": {"rig": rig, "captures": [points]},
        "reconstruct": {"rig": rig, "points": points, "options": None},
        "residual_picture": {"image": PICTURE, "points": points, "residuals": residuals},
        "rig_views": {"rig": rig, "cloud": cloud, "photograph": None, "shown": None},
        "roll_back": {"rig_path": "rig.json", "entry_id": None},
        "scale_from_ball": {"cloud": cloud, "click_px": [640, 480], "diameter": 10.0, "sigma": 0},
        "scale_from_ball_bar": {"cloud": cloud, **pixels, "distance": 10.0, "sigma": 0},
        "scale_from_points": {"cloud": cloud, **pixels, "length": 10.0, "sigma": 0},
        "scaled_rig": {"rig": rig, "scale": made["Scale"]},
        "simulate": {"rig": rig, "scene": "wall", "pattern": pattern, "options": None},
        "triangulate": {"projector_from_camera": rig.projector_from_camera, "camera_rays": [[0, 0.0]]}
        | {"projector_rays": [[0.1, 0]], "camera_sigma": 1.0, "projector_sigma": 1.0},
        "verify": {"rig": rig, "captures": [points]},
        "view_html": {"rig": rig, "before": None, "most": 1000},
        "warp": {"rig": rig, "cloud": cloud, "picture_size": (64, 48), "view": None, "view_from_camera": None}
        | {"rectangle": None},
        "warped_picture": {"warp": warp, "picture": PICTURE},
        "with_normals": {"cloud": cloud},
        "write_bag": {"path": "bag", "rig": rig, "clouds": [cloud], "stamps_ns": [5]},
        "write_cloud": {"path": "cloud.ply", "cloud": cloud},
        "write_colmap": {"folder": "colmap", "cloud": cloud, "views": views},
        "write_depth_map": {"path": "depth.png", "depth": np.ones((960, 1280)), "camera": rig.camera, "unit": "mm"}
        | {"depth_scale": 1000.0},
        "write_in_place": {"rig_path": "rig.json", "result": made["Accepted"], "captures": ()},
        "write_mesh": {"path": "mesh.ply", "mesh": made["Mesh"]},
        "write_nerfstudio": {"folder": "nerf", "cloud": cloud, "views": views},
        "write_pattern": {"path": "grid.json", "pattern": pattern},
        "write_png": {"path": "grey.png", "image": PICTURE},
        "write_points": {"path": "same.csv", "points": points},
        "write_report": {"path": "page.html", "result": made["Accepted"], "rig": rig, "captures": [points]}
        | {"pictures": ()},
        "write_rig": {"path": "same.json", "rig": rig, "to": "retrue"},
        "write_ros": {"folder": "ros", "rig": rig},
        "write_st_map": {"path": "map.tif", "warp": warp},
        "write_step": {"path": "part.step", "model": made["CadModel"]},
        "write_view": {"path": "view.html", "rig": rig, "before": None},
        "write_warp_mesh": {"path": "mesh.data", "warp": warp, "every": 16},
    }  # fmt: skip


FUNCTIONS = [name for name in dir(retrue) if inspect.isfunction(getattr(retrue, name))]
SPECS = ["Board", "ColorGrid", "Frame", "FrameSequence", "GrayCode", "KnownDistance"]
SPECS += ["LineGrid", "Lines", "Plane", "Rig"]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def complaints(function: Callable[..., object], arguments: Mapping[str, Any]) -> list[str]:
    """What came out that names no mistake, or not in one line."""
    found: list[str] = []
    for name in arguments:
        for rubbish in RUBBISH:
            try:
                function(**{**arguments, name: rubbish})
            except retrue.RetrueError as error:
                if "\n" in str(error):
                    found.append(f"{name}={rubbish!r}: {error}")
            except Exception as error:
                found.append(f"{name}={rubbish!r}: {type(error).__name__}: {error}")
    return found


def test_every_public_function_is_tried() -> None:
    assert calls().keys() == set(FUNCTIONS)


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.filterwarnings("ignore")
def test_a_function_names_what_it_cannot_use(name: str) -> None:
    assert complaints(getattr(retrue, name), calls()[name]) == []


@pytest.mark.parametrize("name", SPECS)
def test_a_value_names_what_it_cannot_be(name: str) -> None:
    value: Any = examples()[name]
    assert is_dataclass(value)
    assert complaints(type(value), {item.name: getattr(value, item.name) for item in fields(value)}) == []
