"""The simulated rig is a rig: what its camera sees decodes to its own geometry, late and mixed as cameras are."""

from __future__ import annotations

import numpy as np
import pytest

from retrue.decoding.decode import decode
from retrue.devices.options import SimulatedOptions
from retrue.devices.simulated_rig import SimulatedRig
from retrue.patterns.color_grid import make_color_grid
from retrue.recalibration.recalibrate import recalibrate
from retrue.recalibration.result import Accepted
from retrue.recalibration.verify import verify
from retrue.simulation.board_scene import COLUMNS, ROWS, held_board
from retrue.simulation.built_in_scenes import built_in_scene, meeting_distance
from retrue.simulation.camera_model import CameraModel
from retrue.simulation.light_transport import blurred, find_transport
from retrue.simulation.scene import Scene, render
from tests.devices.rigs import SIZE, small_rig


def seen(rig: SimulatedRig) -> np.ndarray:
    frames = rig.options.lag_frames + 3
    return [rig.frame() for _ in range(frames)][-1].picture


@pytest.fixture(scope="module")
def grid():
    return make_color_grid((1024, 768))


def test_a_bump_is_found_by_the_decoder_that_knows_nothing_of_it(grid):
    rig = SimulatedRig(SimulatedOptions(scene="clutter"))
    before = rig.true_rig
    rig.show(grid.render(), 0.0)
    points = decode(grid, seen(rig))
    found = verify(before, [points])
    assert found.verdict == "good"
    assert found.epipolar_rms_px < 0.05
    rig.bump((1.0, 2.0, 0.5))
    points = decode(grid, seen(rig))
    assert verify(before, [points]).verdict == "drifted"
    result = recalibrate(before, [points])
    assert isinstance(result, Accepted)
    off = result.rig.projector_from_camera.R @ rig.true_rig.projector_from_camera.R.T
    assert np.degrees(np.arccos((np.trace(off) - 1) / 2)) < 0.2


def test_its_light_is_that_of_the_slow_renderer():
    rig = small_rig().true_rig
    scene = Scene(built_in_scene("sphere", rig, 700.0))
    random = np.random.default_rng(0)
    shown = np.kron(random.integers(0, 256, (12, 16, 3)), np.ones((8, 8, 1))).astype(np.uint8)
    quick = blurred(find_transport(rig, scene).light(shown), 0.6)
    slow = render(rig, scene, shown, CameraModel(exposure=1.0), supersample=4).image / 255.0
    difference = np.abs(quick - slow)
    assert np.mean(difference) < 0.005
    assert np.percentile(difference, 99) < 0.03
    assert difference.max() < 0.2  # where a shadow's edge crosses a pixel


def test_blur_has_the_deviation_that_it_was_asked_for():
    point = np.zeros((41, 41, 1), np.float32)
    point[20, 20] = 1.0
    for sigma in (0.4, 0.7, 1.9):
        spread = blurred(point, sigma)[..., 0]
        at = np.arange(41) - 20.0
        assert spread.sum() == pytest.approx(1.0, abs=1e-5)
        assert np.sqrt((spread.sum(axis=0) * at**2).sum()) == pytest.approx(sigma, rel=1e-3)


def test_a_frame_comes_late_and_holds_what_was_on_while_it_was_exposed():
    rig = small_rig(lag_frames=3, readout=0.8, exposure_ms=6.0, refresh_hz=0.0)
    white = np.full((SIZE[1], SIZE[0], 3), 255, np.uint8)
    rig.frame()
    rig.show(white, 0.215)
    frames = [rig.frame() for _ in range(9)]
    whiteness = [float(frame.picture.mean()) for frame in frames]
    mixed = [frame.foreign > 1e-6 for frame in frames]
    assert sum(mixed) == 1
    first = mixed.index(True)
    assert all(not frame.shown.any() for frame in frames[:first])
    assert all(frame.shown.all() for frame in frames[first + 1 :])
    assert whiteness[first - 1] < whiteness[first] < whiteness[first + 1]
    rows = frames[first].picture.mean(axis=(1, 2))
    assert rows[:20].mean() < 0.3 * rows[-20:].mean()  # the change rolls down the picture
    assert frames[first].at > 0.215 + 3 / 30


def test_frames_are_dropped_and_late_but_in_order():
    rig = small_rig(drop=0.3, lag_jitter_frames=4)
    times = np.array([rig.frame().at for _ in range(200)])
    assert (np.diff(times) >= 0).all()
    assert times[-1] * 30 > 250
    assert len(set(np.round(np.diff(times) * 30))) > 3


def test_exposure_and_gamma_do_what_they_say():
    values = {}
    for exposure in (2.0, 4.0, 40.0):
        rig = small_rig(exposure_ms=exposure, electrons=np.inf, ambient=0.0)
        rig.show(np.full((SIZE[1], SIZE[0], 3), 255, np.uint8), 0.0)
        values[exposure] = seen(rig).astype(float)
    dim = values[2.0] > 20
    assert np.median(values[4.0][dim] / values[2.0][dim]) == pytest.approx(2.0, rel=0.03)
    assert values[40.0].max() == 255


def test_the_board_is_held_another_way_each_time():
    import cv2

    rig = SimulatedRig(SimulatedOptions(scene="board"))
    rig.show(np.full((768, 1024, 3), 255, np.uint8), 0.0)
    found = []
    for pose in range(3):
        rig.set_scene("board", pose)
        grey = seen(rig).mean(axis=2).astype(np.uint8)
        ok, corners = cv2.findChessboardCornersSB(grey, (COLUMNS, ROWS))
        assert ok
        found.append(corners)
    assert np.abs(found[0] - found[1]).max() > 5
    assert np.abs(found[1] - found[2]).max() > 5


@pytest.mark.parametrize("number", range(4))
def test_a_printed_board_has_its_corners_where_they_are(number: int):
    import cv2

    rig = SimulatedRig(SimulatedOptions(scene="board", electrons=np.inf))
    rig.show(np.full((768, 1024, 3), 255, np.uint8), 0.0)
    board = held_board(rig.true_rig, meeting_distance(rig.true_rig), number)
    rig.hold(board)
    found, corners = cv2.findChessboardCornersSB(seen(rig).mean(axis=2).astype(np.uint8), (COLUMNS, ROWS))
    assert found
    column, row = np.meshgrid(np.arange(COLUMNS) - (COLUMNS - 1) / 2, np.arange(ROWS) - (ROWS - 1) / 2)
    on_board = board.square * np.stack([column, row, np.zeros_like(row)], axis=-1).reshape(-1, 3)
    true = rig.true_rig.camera.project(board.pose.apply(on_board))
    seen_px = corners.reshape(-1, 2)
    off = min((seen_px - true, seen_px[::-1] - true), key=lambda off: np.abs(off).max())
    assert np.abs(off).max() < 0.25
    assert np.sqrt(np.mean(off**2)) < 0.06
