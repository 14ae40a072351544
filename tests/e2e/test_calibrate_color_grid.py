"""`retrue calibrate` on two pictures a pose: the board lit white, and by the colour grid."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

from retrue.calibration.board import Board, parse_board
from retrue.files.patterns import write_pattern
from retrue.files.rigs import read_rig
from retrue.geometry.arrays import FloatArray
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform, rotation_from_vector, vector_from_rotation
from retrue.patterns.color_grid import make_color_grid
from retrue.rig import Rig
from retrue.simulation.camera_model import CameraModel
from retrue.simulation.scene import Scene, render
from retrue.simulation.surfaces import Wall

SPEC = "chessboard:7x5:40mm"
POSES = 5
RIG = Rig(
    Camera((560, 420), [[700, 0, 283], [0, 701, 207], [0, 0, 1]], [-0.08, 0.03, 0, 0, 0]),
    Camera((1024, 768), [[1500, 0, 512], [0, 1500, 700], [0, 0, 1]]),  # its lens is shifted
    RigidTransform.from_rotation_vector([0.20, 0.20, 0.01], [-180, -20, 30]),
    "mm",
)


@dataclass(frozen=True)
class Print:
    """A chessboard on white paper; its black reflects a little."""

    pose: RigidTransform
    board: Board
    gloss: float = 0.0

    def albedo(self, points: FloatArray) -> FloatArray:
        xy = self.pose.inverse().apply(points)[..., :2] / self.board.spacing
        printed = ((xy > -1) & (xy < [self.board.columns, self.board.rows])).all(axis=-1)
        black = printed & (np.floor(xy).sum(axis=-1) % 2 == 0)
        return np.where(black, 0.06, 0.85)[..., None] * np.ones(3)


def shoot(folder: Path, index: int, rng: np.random.Generator, shown: dict[str, np.ndarray]) -> None:
    """One pose before a wall."""
    board, way = parse_board(SPEC), 2 * np.pi * index / POSES
    tilt = rng.uniform(0.35, 0.7)
    R = rotation_from_vector([tilt * np.cos(way), tilt * np.sin(way), 0]) @ rotation_from_vector([0, 0, 0.2])
    middle = np.append(board.points.max(axis=0) / 2, 0)
    pose = RigidTransform(R, [*rng.uniform(-25, 25, 2), rng.uniform(700, 900)] - R @ middle)
    sheet = Wall(pose @ RigidTransform(np.eye(3), middle), (200, 160), Print(pose, board))
    scene = Scene([sheet, Wall.facing(1500, (0.2, -0.1, 0))], ambient=(0.01, 0.01, 0.01))
    camera = CameraModel(electrons=8000, read_noise=5, exposure=0.75)
    folder.mkdir()
    for name, picture in shown.items():
        image = render(RIG, scene, picture, camera, seed=index, supersample=1).image
        cv2.imwrite(str(folder / f"{name}.png"), image[..., ::-1])


@pytest.fixture(scope="module")
def captures(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("captures")
    grid = make_color_grid()
    write_pattern(folder / "pattern.json", grid)
    rng = np.random.default_rng(4)
    for index in range(POSES):
        shoot(
            folder / f"pose_{index}",
            index,
            rng,
            {"grid": grid.render(), "white": np.full((768, 1024, 3), 255, np.uint8)},
        )
    return folder


def test_the_rig_is_right_within_its_sigmas(retrue, captures, tmp_path):
    options = ("--pattern", captures / "pattern.json", "--board", SPEC, "--out", tmp_path / "rig.json", "--json")
    run = retrue("calibrate", *sorted(captures.glob("pose_*")), *options)
    assert run.status == 0, run.json["reason"]
    assert len(run.json["views"]) == POSES
    check = run.json["check"]
    assert [each["verdict"] for each in check] == ["good"] * POSES, check
    assert all(set(each) == {"name", "verdict", "cause", "reason"} for each in check)
    found, sigma = read_rig(tmp_path / "rig.json"), run.json["sigma"]
    z = []
    for device in ("camera", "projector"):
        mine, true = getattr(found, device).K, getattr(RIG, device).K
        for name, place in {"fx": (0, 0), "fy": (1, 1), "cx": (0, 2), "cy": (1, 2)}.items():
            z.append((mine[place] - true[place]) / sigma[device][name])
            assert abs(mine[place] - true[place]) < 0.02 * true[place]
    pose, true = found.projector_from_camera, RIG.projector_from_camera
    turn = np.degrees(vector_from_rotation(pose.R @ true.R.T))
    of_pose = sigma["projector_from_camera"]
    z += list(turn / [of_pose[f"r{axis}_deg"] for axis in "xyz"])
    z += list((pose.t - true.t) / [of_pose[f"t{axis}"] for axis in "xyz"])
    assert np.abs(z).max() < 3


def test_black_squares_are_bridged(captures):
    from retrue.calibration.projector_corners import fit_projector_corners
    from retrue.files.board_captures import read_board_capture
    from retrue.files.patterns import read_pattern

    board = parse_board(SPEC)
    capture = read_board_capture(captures / "pose_0", read_pattern(captures / "pattern.json"), board)
    assert capture.corners is not None
    fit = fit_projector_corners(capture.corners, capture.points, board)
    assert np.isfinite(fit.corner_px).all()


def test_three_pictures_are_one_too_many(retrue, captures, tmp_path):
    folder = tmp_path / "pose"
    folder.mkdir()
    for name in ("a", "b", "c"):
        cv2.imwrite(str(folder / f"{name}.png"), np.zeros((32, 32, 3), np.uint8))
    options = ("--pattern", captures / "pattern.json", "--board", SPEC, "--out", tmp_path / "rig.json")
    retrue("calibrate", folder, *options).require_complaint("expected two pictures", "found 3")
