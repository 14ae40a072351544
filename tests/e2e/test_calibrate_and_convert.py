"""`retrue calibrate` on real captures, and `retrue convert` there and back, through the front door."""

from pathlib import Path

import numpy as np
import pytest

from retrue.files.rigs import read_rig

DATA = Path(__file__).parents[3] / "shared" / "data" / "procam-board"
DEMO = Path(__file__).parents[2] / "src" / "retrue" / "demo_data"


@pytest.mark.skipif(not DATA.is_dir(), reason=f"the real captures are not there: {DATA}")
def test_three_real_poses_give_a_rig_near_the_one_of_five(retrue, tmp_path):
    captures = [DATA / f"capture_{k}" for k in range(3)]
    board = ("--pattern", DATA / "pattern.json", "--board", "chessboard:7x9:75mm")
    run = retrue("calibrate", *captures, *board, "--out", tmp_path / "rig.json", "--json")
    assert run.status == 0
    assert run.json["verdict"] == "accepted"
    found, truth = read_rig(tmp_path / "rig.json"), read_rig(DATA / "rig.json")
    for ours, theirs in ((found.camera, truth.camera), (found.projector, truth.projector)):
        assert np.diag(ours.K) == pytest.approx(np.diag(theirs.K), rel=0.02)
    assert found.unit == "mm"
    assert np.linalg.norm(found.projector_from_camera.t) == pytest.approx(
        np.linalg.norm(truth.projector_from_camera.t), rel=0.02
    )


@pytest.mark.skipif(not DATA.is_dir(), reason=f"the real captures are not there: {DATA}")
def test_one_pose_is_refused_and_writes_nothing(retrue, tmp_path):
    board = ("--pattern", DATA / "pattern.json", "--board", "chessboard:7x9:75mm")
    run = retrue("calibrate", DATA / "capture_0", *board, "--out", tmp_path / "rig.json")
    assert run.status == 1
    assert not (tmp_path / "rig.json").exists()


def test_a_board_that_is_none_is_one_line(retrue, tmp_path):
    (tmp_path / "capture").mkdir()
    pattern = ("--pattern", DEMO / "pattern.json", "--out", tmp_path / "rig.json")
    run = retrue("calibrate", tmp_path / "capture", *pattern, "--board", "chess")
    run.require_complaint("chessboard:COLUMNSxROWS", "'chess'")


def test_there_and_back_through_another_tools_format(retrue, tmp_path):
    there, back = tmp_path / "calibration.yml", tmp_path / "rig.json"
    assert retrue("convert", DEMO / "rig_true.json", there, "--to", "procam-calibration").status == 0
    retrue("convert", there, back).require_complaint("size")
    sizes = ("--camera-size", 1280, 960, "--projector-size", 1024, 768, "--unit", "m")
    assert retrue("convert", there, back, *sizes).status == 0
    first, second = read_rig(DEMO / "rig_true.json"), read_rig(back)
    assert np.array_equal(first.camera.K, second.camera.K)
    assert np.array_equal(first.projector_from_camera.t, second.projector_from_camera.t)
    assert retrue("convert", there, back, "--to", "nothing").status == 2
