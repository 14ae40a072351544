"""The experiment on pairs scores what the captures support, and each method on the same pairs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from retrue import Camera, InputError, Rig, RigidTransform, write_png
from retrue.experiments.photographs import OURS, RECIPE, photographs, recipe
from retrue.files.photographs import read_pair
from retrue.geometry.transform import rotation_angle
from retrue.simulation.photographs import photograph, textured_scene

CAMERA = Camera((320, 240), [[300, 0, 159.5], [0, 300, 119.5], [0, 0, 1]], [-0.1, 0.02, 0, 0, 0])
RIG = Rig(CAMERA, CAMERA, RigidTransform.from_rotation_vector([0.02, -0.06, 0.03], [-150.0, 4, 6]))


def test_every_method_answers_on_every_pair(tmp_path: Path) -> None:
    scene = textured_scene(RIG, 1200.0, seed=2)
    pairs = []
    for number in (1, 2):
        paths = tmp_path / f"left{number}.png", tmp_path / f"right{number}.png"
        pair = photograph(RIG, scene, supersample=1, seed=number - 1)
        write_png(paths[0], pair.left)
        write_png(paths[1], pair.right)
        pairs.append(read_pair(paths))
    read = pairs[0]
    study = photographs(RIG, pairs)
    ours = study.table.where(method=OURS)
    assert ours.column("pair") == ["left1.png, right1.png", "left2.png, right2.png", "first 2 together"]
    assert all(error < 0.1 for error in ours.column("rotation_deg"))
    assert all(error > 0 for error in ours.column("rotation_deg"))  # not the rig's own pose, which is the truth here
    assert {"OpenCV essential", RECIPE} <= set(study.table.column("method"))
    assert any(remark.startswith("retrue: rotation 0.0") for remark in study.remarks)
    turned = np.degrees(rotation_angle(recipe(RIG, read.left, read.right)[0][0] @ RIG.projector_from_camera.R.T))
    assert turned < 2


def test_what_shows_nothing_gives_no_pose() -> None:
    blank = np.full((240, 320), 90, np.uint8)
    assert recipe(RIG, blank, blank) == []
    with pytest.raises(InputError, match="found none"):
        photographs(RIG, [])
