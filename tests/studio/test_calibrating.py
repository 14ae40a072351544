"""A calibration from nothing: poses are taken by themselves, are on the disk, and outlive whoever took them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import retrue
from retrue.calibration.reasons import BoardsParallel
from retrue.calibration.result import Calibrated, RefusedCalibration
from retrue.cli.main import main
from retrue.devices.drivers import LiveRig
from retrue.devices.options import SimulatedOptions
from retrue.devices.shown_pictures import black_and_white
from retrue.devices.simulated_rig import SimulatedRig
from retrue.errors import FileError, InputError
from retrue.geometry.transform import rotation_angle
from retrue.patterns.color_grid import make_color_grid
from retrue.studio.calibrating import AIM, Calibrating, begun, result_rows

BOARD = "chessboard:9x7:29mm"
PATTERN = make_color_grid((1024, 768))


@pytest.fixture
def live() -> LiveRig:
    rig = SimulatedRig(SimulatedOptions(lag_frames=1))
    rig.show(black_and_white(PATTERN.projector_size)[1], 0.0)
    return LiveRig(rig.camera, rig.projector, rig)


def followed(calibrating: Calibrating, live: LiveRig, poses: int) -> None:
    """Somebody does what is asked, until there are so many poses."""
    assert live.simulated is not None
    for _ in range(12 * poses):
        if len(calibrating.captures) == poses:
            return
        live.simulated.hold(calibrating.wished())
        before = len(calibrating.captures)
        while len(calibrating.captures) == before:
            progress = calibrating.step(live, live.camera.frame().picture)
        assert progress.poses == before + 1
        assert progress.sentence == f"taken: pose {before + 1}"


def test_from_an_empty_folder_through_a_kill_to_a_rig_and_the_same_from_the_command_line(live: LiveRig, tmp_path: Path):
    folder, picture = tmp_path / "calibration", live.camera.frame().picture
    assert begun(folder) == ""
    first = Calibrating(folder, BOARD, PATTERN, picture)
    with pytest.raises(InputError, match="0 poses were taken, expected 3 or more"):
        first.fit()
    followed(first, live, 3)
    assert begun(folder) == BOARD

    again = Calibrating(folder, "chessboard:5x4:1mm", PATTERN, picture)  # the board that lies there is gone on with
    assert again.board == BOARD
    assert list(again.captures) == list(first.captures)
    assert again._guide.covered("projector_px") == first._guide.covered("projector_px")
    followed(again, live, AIM)
    result = again.result
    assert isinstance(result, Calibrated)
    assert not result.evidence["advice"]
    assert live.simulated is not None
    true = live.simulated.true_rig
    turn = rotation_angle(result.rig.projector_from_camera.R @ true.projector_from_camera.R.T)
    assert np.degrees(turn) < 0.25
    assert np.allclose(result.rig.projector_from_camera.t, true.projector_from_camera.t, atol=2.0)
    assert result.rig.camera.K[0, 0] == pytest.approx(true.camera.K[0, 0], rel=5e-3)
    assert result.rig.projector.K[0, 0] == pytest.approx(true.projector.K[0, 0], rel=5e-3)
    rows = result_rows(result)
    assert set(rows) == {"camera", "projector", "pose", "points", "left out"}
    assert rows["left out"] == "nothing"

    progress = again.step(live, live.camera.frame().picture)
    assert progress.result is result
    assert progress.poses == AIM  # none is taken while a result is looked at
    words = [*map(str, again.records()), "--pattern", str(folder / "pattern.json"), "--board", BOARD]
    assert main(["calibrate", *words, "--out", str(tmp_path / "rig.json"), "--quiet"]) == 0
    assert retrue.read_rig(tmp_path / "rig.json").projector_from_camera == result.rig.projector_from_camera
    again.put_away()
    assert begun(folder) == ""
    assert len(list(tmp_path.glob("calibration-*/pose-*"))) == AIM


def test_a_result_that_is_refused_says_what_to_add_and_more_poses_can_be_taken(
    live: LiveRig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    calibrating = Calibrating(tmp_path / "calibration", BOARD, PATTERN, live.camera.frame().picture)
    followed(calibrating, live, 3)
    refused = RefusedCalibration(BoardsParallel(1.0, "tilt the board more"))
    monkeypatch.setattr("retrue.studio.calibrating.calibrate", lambda *_: refused)
    calibrating.fit()
    progress = calibrating.step(live, live.camera.frame().picture)
    assert (progress.result, progress.wish) == (refused, None)
    assert "tilt the board more" in refused.reason
    assert result_rows(refused) == {}
    calibrating.go_on()
    progress = calibrating.step(live, live.camera.frame().picture)
    assert progress.result is None
    assert progress.wish is not None


def test_a_board_that_moves_while_it_is_taken_is_not(live: LiveRig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    calibrating = Calibrating(tmp_path / "calibration", BOARD, PATTERN, live.camera.frame().picture)
    rig = live.simulated
    assert rig is not None
    rig.hold(calibrating.wished())
    shown: list[float] = []
    show = rig.show

    def nudged(picture: np.ndarray, at: float) -> float:
        shown.append(float(picture.mean()))
        if len(shown) == 2:  # as white comes back
            rig.set_scene("board", 3)
        return show(picture, at)

    monkeypatch.setattr(rig, "show", nudged)
    sentence = ""
    while "it moved" not in sentence:
        sentence = calibrating.step(live, live.camera.frame().picture).sentence
    assert sentence == "it moved: hold it still, or lean it against something"
    assert not calibrating.captures
    assert not list((tmp_path / "calibration").glob("pose-*"))


def test_without_a_board_it_asks_for_one_and_a_full_disk_takes_no_pose(
    live: LiveRig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    calibrating = Calibrating(tmp_path / "calibration", BOARD, PATTERN, live.camera.frame().picture)
    progress = calibrating.step(live, live.camera.frame().picture)
    assert progress.sentence == "hold the board into the outline, all of it"
    assert progress.outline is None
    assert progress.wish is not None
    with monkeypatch.context() as full:

        def no_room(folder: Path, *_: object) -> None:
            raise FileError(folder, "cannot be written: No space left on device")

        full.setattr("retrue.studio.calibrating.write_capture", no_room)
        with pytest.raises(FileError, match="No space left"):
            followed(calibrating, live, 1)
        assert not calibrating.captures
    followed(calibrating, live, 1)  # there is room again
    assert len(calibrating.captures) == 1


def test_what_lies_in_the_folder_must_be_what_is_calibrated(live: LiveRig, tmp_path: Path):
    folder, picture = tmp_path / "calibration", live.camera.frame().picture
    with pytest.raises(InputError, match="board: expected chessboard"):
        Calibrating(folder, "rubbish", PATTERN, picture)
    assert not folder.exists()
    Calibrating(folder, BOARD, PATTERN, picture)
    (folder / "pose-damaged").mkdir()
    (folder / "pose-damaged" / "white.png").write_bytes(b"rubbish")
    assert not Calibrating(folder, BOARD, PATTERN, picture).captures
    with pytest.raises(FileError, match=r"pattern\.json: these poses were lit by another pattern"):
        Calibrating(folder, BOARD, make_color_grid((640, 480)), picture)
    (folder / "board.txt").write_text("rubbish")
    with pytest.raises(FileError, match=r"board\.txt: board: expected chessboard"):
        Calibrating(folder, BOARD, PATTERN, picture)
