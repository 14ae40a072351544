"""What a caller got wrong is said in one line, which names the argument and says what was meant."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import retrue

CAMERA = retrue.Camera((640, 480), [[500, 0, 320], [0, 500, 240], [0, 0, 1]])
POSE = retrue.RigidTransform.from_rotation_vector([0.0, 0.2, 0.0], [-100.0, 0, 10])
RIG = retrue.Rig(CAMERA, CAMERA, POSE)
POINTS = retrue.Correspondences([[320, 240], [420, 240]], [[220, 240], [370, 240]])
ACCEPTED = retrue.Accepted(RIG, "as a test", retrue.Evidence(2))
CLOUD = retrue.reconstruct(retrue.Rig(CAMERA, CAMERA, retrue.RigidTransform(np.eye(3), [-100.0, 0, 0])), POINTS)
GRID = retrue.make_color_grid((64, 48), rows=4, columns=5)
GRAY = retrue.GrayCode((64, 48))
BOARD = retrue.parse_board("chessboard:7x9:75mm")
IMAGE = np.zeros((48, 64, 3), np.uint8)

READ_RIG = "; retrue.read_rig reads one"
READ_POINTS = "; retrue.read_capture decodes pictures, retrue.read_points reads a table"
READ_PATTERN = "; retrue.read_pattern reads one"
PATTERN = "pattern: expected a ColorGrid, LineGrid, GrayCode or FrameSequence"
DECODED = "pattern: expected a ColorGrid, LineGrid, GrayCode, FrameSequence or Photographs"
READ_IMAGE = "; retrue.read_image reads one, and retrue.read_capture decodes files"
PARSE_BOARD = "; retrue.parse_board makes one of such a text"
PATH = "path: expected text or a pathlib.Path, as in "

MISTAKES: list[tuple[Callable[[], object], str]] = [
    # a file's name instead of what is in it
    (
        lambda: retrue.decode(GRID, "wall.jpg"),
        f"images: expected a list of ndarray, found the text 'wall.jpg'{READ_IMAGE}",
    ),
    (
        lambda: retrue.decode(GRID, Path("a.png")),
        f"images: expected a list of ndarray, found the path 'a.png'{READ_IMAGE}",
    ),
    (lambda: retrue.decode(GRAY, ["a.png"]), f"images[0]: expected an ndarray, found the text 'a.png'{READ_IMAGE}"),
    (
        lambda: retrue.decode("pattern.json", IMAGE),
        f"{DECODED}, found the text 'pattern.json'{READ_PATTERN}",
    ),
    (lambda: retrue.recalibrate("rig.json", [POINTS]), f"rig: expected a Rig, found the text 'rig.json'{READ_RIG}"),
    (lambda: retrue.verify("rig.json", [POINTS]), f"rig: expected a Rig, found the text 'rig.json'{READ_RIG}"),
    (lambda: retrue.reconstruct("rig.json", POINTS), f"rig: expected a Rig, found the text 'rig.json'{READ_RIG}"),
    (
        lambda: retrue.recalibrate(RIG, "wall.csv"),
        f"captures: expected a list of Correspondences, found the text 'wall.csv'{READ_POINTS}",
    ),
    (
        lambda: retrue.verify(RIG, ["wall.csv"]),
        f"captures[0]: expected a Correspondences, found the text 'wall.csv'{READ_POINTS}",
    ),
    (
        lambda: retrue.reconstruct(RIG, "wall.csv"),
        f"points: expected a Correspondences, found the text 'wall.csv'{READ_POINTS}",
    ),
    (
        lambda: retrue.epipolar_residuals(RIG, "wall.csv"),
        f"points: expected a Correspondences, found the text 'wall.csv'{READ_POINTS}",
    ),
    (
        lambda: retrue.calibrate(["pose1"], BOARD),
        "captures[0]: expected a BoardCapture or StereoCapture, found the text 'pose1'; "
        "retrue.read_board_capture reads one",
    ),
    (
        lambda: retrue.calibrate([], "chessboard:7x9:75mm"),
        f"board: expected a Board, found the text 'chessboard:7x9:75mm'{PARSE_BOARD}",
    ),
    (
        lambda: retrue.read_board_capture("p", GRAY, "chessboard:7x9:75mm"),
        f"board: expected a Board, found the text 'chessboard:7x9:75mm'{PARSE_BOARD}",
    ),
    (
        lambda: retrue.read_board_captures("pose1", GRAY, BOARD),
        "paths: expected a list of str or Path, found a single one; put it in [ ]",
    ),
    (
        lambda: retrue.read_capture("wall.jpg", "pattern.json"),
        f"{PATTERN}, found the text 'pattern.json'{READ_PATTERN}",
    ),
    (lambda: retrue.simulate("rig.json", "wall", GRID), f"rig: expected a Rig, found the text 'rig.json'{READ_RIG}"),
    (
        lambda: retrue.make_mesh("cloud.ply"),
        "cloud: expected a Cloud, found the text 'cloud.ply'; retrue.reconstruct makes one",
    ),
    # what holds it, instead of the thing itself
    (lambda: retrue.reconstruct(ACCEPTED, POINTS), "rig: expected a Rig, found an Accepted; hand in its .rig"),
    (lambda: retrue.recalibrate(ACCEPTED, [POINTS]), "rig: expected a Rig, found an Accepted; hand in its .rig"),
    (lambda: retrue.verify(ACCEPTED, [POINTS]), "rig: expected a Rig, found an Accepted; hand in its .rig"),
    (
        lambda: retrue.triangulate(RIG, [[0, 0]], [[0, 0]]),
        "projector_from_camera: expected a RigidTransform, found a Rig; hand in its .projector_from_camera",
    ),
    # one instead of many, and many instead of one
    (
        lambda: retrue.recalibrate(RIG, POINTS),
        "captures: expected a list of Correspondences, found a single one; put it in [ ]",
    ),
    (
        lambda: retrue.verify(RIG, POINTS),
        "captures: expected a list of Correspondences, found a single one; put it in [ ]",
    ),
    (
        lambda: retrue.reconstruct(RIG, [POINTS]),
        "points: expected a Correspondences, found a list; hand in one of them",
    ),
    (lambda: retrue.recalibrate(RIG, []), "captures: expected at least one, found none"),
    (lambda: retrue.recalibrate(RIG, None), "captures: expected a list of Correspondences, found None"),
    # the wrong way round
    (lambda: retrue.recalibrate([POINTS], RIG), "rig: expected a Rig, found a list"),
    (lambda: retrue.reconstruct(POINTS, RIG), "rig: expected a Rig, found a Correspondences"),
    (lambda: retrue.decode(IMAGE, GRID), f"{DECODED}, found an ndarray"),
    (lambda: retrue.write_rig(RIG, "rig.json"), f"{PATH}write_rig(path, rig); found a Rig"),
    (lambda: retrue.write_pattern(GRID, "p.json"), f"{PATH}write_pattern(path, pattern); found a ColorGrid"),
    (lambda: retrue.write_points(POINTS, "p.csv"), f"{PATH}write_points(path, points); found a Correspondences"),
    (lambda: retrue.write_png(IMAGE, "p.png"), f"{PATH}write_png(path, image); found an ndarray"),
    (lambda: retrue.write_cloud(CLOUD, "c.ply"), f"{PATH}write_cloud(path, cloud); found a Cloud"),
    (lambda: retrue.write_mesh(CLOUD, "m.ply"), f"{PATH}write_mesh(path, mesh); found a Cloud"),
    (lambda: retrue.write_in_place(ACCEPTED, "rig.json"), f"{PATH}write_in_place(rig_path, result); found an Accepted"),
    (lambda: retrue.read_rig(RIG), f"{PATH}read_rig(path); found a Rig"),
    (lambda: retrue.read_pattern(GRID), f"{PATH}read_pattern(path); found a ColorGrid"),
    (lambda: retrue.read_points(POINTS), f"{PATH}read_points(path); found a Correspondences"),
    (lambda: retrue.read_image(IMAGE), f"{PATH}read_image(path); found an ndarray"),
    (lambda: retrue.read_capture(GRID, "wall.jpg"), f"{PATH}read_capture(path, pattern); found a ColorGrid"),
    # another thing altogether
    (lambda: retrue.write_rig("rig.json", ACCEPTED), "rig: expected a Rig, found an Accepted; hand in its .rig"),
    (lambda: retrue.write_points("p.csv", CLOUD), "points: expected a Correspondences, found a Cloud"),
    (lambda: retrue.write_mesh("m.ply", CLOUD), "mesh: expected a Mesh, found a Cloud"),
    (lambda: retrue.write_in_place("rig.json", RIG), "result: expected an Accepted or Calibrated, found a Rig"),
    (
        lambda: retrue.recalibrate(RIG, [POINTS], {"min_points": 4}),
        "options: expected a RecalibrateOptions, found a dict",
    ),
    (
        lambda: retrue.verify(RIG, [POINTS], retrue.RecalibrateOptions()),
        "options: expected a VerifyOptions, found a RecalibrateOptions",
    ),
    (
        lambda: retrue.reconstruct(RIG, POINTS, retrue.ReconstructOptions),
        "options: expected a ReconstructOptions, found the class ReconstructOptions",
    ),
    (lambda: retrue.Rig("camera.json", CAMERA, POSE), "camera: expected a Camera, found the text 'camera.json'"),
    (
        lambda: retrue.Rig(CAMERA, CAMERA, np.eye(4)),
        "projector_from_camera: expected a RigidTransform, found an ndarray",
    ),
]


@pytest.mark.parametrize(("call", "said"), MISTAKES, ids=[said.partition(";")[0] for _, said in MISTAKES])
def test_a_mistake_is_named(call: Callable[[], object], said: str) -> None:
    with pytest.raises(retrue.InputError) as raised:
        call()
    assert str(raised.value) == said
