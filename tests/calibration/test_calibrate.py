"""Calibration of simulated and real boards: truth, sigmas, OpenCV, and what must be refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from retrue.calibration.board import parse_board
from retrue.calibration.calibrate import calibrate, calibrate_views
from retrue.calibration.detection import BoardCorners
from retrue.calibration.observations import View
from retrue.calibration.options import CalibrationOptions
from retrue.calibration.projector_corners import fit_projector_corners
from retrue.calibration.result import Calibrated, RefusedCalibration
from retrue.calibration.views import BoardCapture, LeftOut, StereoCapture, see_views
from retrue.correspondences import Correspondences
from retrue.errors import InputError
from retrue.files.rigs import read_rig, write_rig
from retrue.geometry.homography import apply_homography
from retrue.reconstruction.reconstruct import reconstruct
from retrue.rig import Rig

BOARD = parse_board("chessboard:7x9:40mm")
SIZES = ((1280, 1024), (1024, 768))


def scene(benchmark: ModuleType, count: int, seed: int = 3, **noise: float) -> tuple[Rig, list[View]]:
    rng = np.random.default_rng(seed)
    truth = benchmark.true_rig(rng)
    noises = benchmark.Noise(**noise)
    return truth, [benchmark.simulated_view(truth, BOARD, noises, rng, f"pose {i}") for i in range(count)]


@pytest.fixture(scope="module")
def six(benchmark: ModuleType) -> tuple[Rig, list[View]]:
    return scene(benchmark, 6)


def test_without_noise_it_is_exact(benchmark: ModuleType) -> None:
    truth, views = scene(benchmark, 6, corner=1e-6, dense=1e-6)
    result = calibrate_views(views, BOARD, SIZES)
    assert isinstance(result, Calibrated)
    focal, rotation_deg, translation, point = benchmark.rig_errors(result.rig, truth)
    assert focal < 0.01
    assert rotation_deg < 0.003
    assert translation < 0.05
    assert point < 0.3


def test_parameters_lie_within_their_sigmas_and_beat_opencv(benchmark: ModuleType) -> None:
    outcome = benchmark.simulated(trials=4, counts=(5, 8), seed=5)
    assert outcome["within"] >= 0.99
    for rows in outcome["errors"].values():
        mean = np.mean(rows, axis=0)
        assert mean[3] < mean[7]  # points in space


def test_a_bent_board_and_a_drifting_projector_are_seen_through(benchmark: ModuleType) -> None:
    noise = benchmark.Noise(drift=0.02, sag=0.5)
    outcome = benchmark.simulated(trials=4, counts=(5, 8), seed=6, noise=noise)
    assert outcome["within"] >= 0.99
    for rows in outcome["errors"].values():
        mean = np.mean(rows, axis=0)
        assert mean[3] < mean[7]  # points in space


def test_the_bend_of_the_board_is_measured(benchmark: ModuleType) -> None:
    rng = np.random.default_rng(3)
    truth = benchmark.true_rig(rng)
    middle = BOARD.points.max(axis=0) / 2
    bend = np.array([2e-5, 0, 0])  # 2e-5 x 120 x 120 = 0.29 mm from the middle to an edge
    views = [benchmark.simulated_view(truth, BOARD, benchmark.Noise(), rng, f"pose {i}", bend=bend) for i in range(6)]
    board = calibrate_views(views, BOARD, SIZES).evidence["board"]
    assert board["kept"] == ["xx", "xy", "yy"]
    assert board["out_of_flat"] == pytest.approx(2e-5 * middle[0] ** 2, rel=0.25)


def test_two_poses_do_not_settle_far_away(benchmark: ModuleType) -> None:
    for seed in range(6):
        truth, views = scene(benchmark, 2, seed)
        result = calibrate_views(views, BOARD, SIZES, CalibrationOptions(largest_error=1))
        assert isinstance(result, Calibrated)
        for mine, true in ((result.rig.camera, truth.camera), (result.rig.projector, truth.projector)):
            assert mine.K[0, 0] == pytest.approx(true.K[0, 0], rel=0.1)


def test_evidence_is_plain_and_travels_with_the_rig(six: tuple[Rig, list[View]], tmp_path: Path) -> None:
    result = calibrate_views(six[1], BOARD, SIZES)
    assert isinstance(result, Calibrated)
    write_rig(tmp_path / "rig.json", result.rig)
    back = read_rig(tmp_path / "rig.json")
    assert back.evidence == json.loads(json.dumps(result.evidence))
    assert back.unit == "mm"
    assert result.evidence["rms_px"] < 0.2
    assert [view["name"] for view in result.evidence["views"]] == [view.name for view in six[1]]
    assert result.evidence["predicted_error"]["rms"] > 0


def test_a_lens_that_is_not_there_gets_no_terms(benchmark: ModuleType) -> None:
    truth, _ = scene(benchmark, 0)
    pinholes = [type(camera)(camera.size, camera.K) for camera in (truth.camera, truth.projector)]
    truth = Rig(*pinholes, truth.projector_from_camera)
    rng = np.random.default_rng(8)
    views = [benchmark.simulated_view(truth, BOARD, benchmark.Noise(), rng, f"pose {i}") for i in range(5)]
    result = calibrate_views(views, BOARD, SIZES)
    assert isinstance(result, Calibrated)
    for device in ("camera", "projector"):
        assert "k3" not in result.evidence["distortion"][device]["kept"]
    assert np.abs(result.rig.camera.distortion).max() < 0.05
    assert np.abs(result.rig.projector.distortion).max() < 0.05


def test_a_bad_view_is_named_and_left_out(six: tuple[Rig, list[View]]) -> None:
    truth, views = six
    shift = np.array([6.0, -9.0])
    moved = replace(
        views[2],
        patch_projector_px=views[2].patch_projector_px + shift,
        pixels=(views[2].pixels[0], views[2].pixels[1] + shift),
    )
    result = calibrate_views([*views[:2], moved, *views[3:]], BOARD, SIZES)
    assert isinstance(result, Calibrated)
    assert [entry["name"] for entry in result.evidence["left_out"]] == ["pose 2"]
    assert "times better without it" in result.evidence["left_out"][0]["reason"]
    assert abs(result.rig.camera.K[0, 0] / truth.camera.K[0, 0] - 1) < 5e-3


def test_single_bad_corners_are_left_out(six: tuple[Rig, list[View]]) -> None:
    _, views = six
    pixels = views[1].pixels[0].copy()
    pixels[[4, 40]] += 5.0
    result = calibrate_views(
        [views[0], replace(views[1], pixels=(pixels, views[1].pixels[1])), *views[2:]], BOARD, SIZES
    )
    assert isinstance(result, Calibrated)
    assert result.evidence["views"][1]["corners_left_out"] == 2
    assert result.evidence["rms_px"] < 0.2


def test_a_sparse_code_will_do(benchmark: ModuleType) -> None:
    rng = np.random.default_rng(4)
    truth = benchmark.true_rig(rng)
    views = [benchmark.simulated_view(truth, BOARD, benchmark.Noise(), rng, f"pose {i}", every=40) for i in range(6)]
    assert max(len(view.patch_sigma) for view in views) < 60
    result = calibrate_views(views, BOARD, SIZES)
    assert isinstance(result, Calibrated)
    assert benchmark.rig_errors(result.rig, truth)[0] < 0.5


def test_known_intrinsics_stay_as_they_are(six: tuple[Rig, list[View]]) -> None:
    truth, views = six
    result = calibrate_views(views[:1], BOARD, SIZES, known=(truth.camera, truth.projector))
    assert isinstance(result, Calibrated)
    assert result.rig.camera is truth.camera
    assert result.rig.projector is truth.projector
    assert "fx" not in result.evidence["sigma"]["camera"]
    assert np.abs(result.rig.projector_from_camera.R - truth.projector_from_camera.R).max() < 2e-3
    half = calibrate_views(views, BOARD, SIZES, known=(truth.camera, None))
    assert isinstance(half, Calibrated)
    assert half.rig.camera is truth.camera
    assert abs(half.rig.projector.K[0, 0] / truth.projector.K[0, 0] - 1) < 5e-3


def test_one_pose_is_refused(six: tuple[Rig, list[View]]) -> None:
    result = calibrate_views(six[1][:1], BOARD, SIZES)
    assert isinstance(result, RefusedCalibration)
    assert "one pose" in result.reason


def test_parallel_poses_are_refused(six: tuple[Rig, list[View]]) -> None:
    result = calibrate_views([six[1][0]] * 4, BOARD, SIZES)
    assert isinstance(result, RefusedCalibration)
    assert "parallel" in result.reason or "other angles" in result.reason


def test_no_board_in_any_capture_is_refused_by_name() -> None:
    blank = BoardCapture("dark", np.zeros((480, 640), np.uint8), Correspondences(np.empty((0, 2)), np.empty((0, 2))))
    result = calibrate([blank], BOARD, (1024, 768))
    assert isinstance(result, RefusedCalibration)
    assert "dark: board not found: the picture is too dark" in result.reason


def test_a_capture_counts_once_however_often_it_is_handed_in() -> None:
    rng = np.random.default_rng(5)
    pictures = rng.integers(0, 255, (2, 48, 64), np.uint8)
    points = Correspondences(*rng.uniform(0, 40, (2, 30, 2)))
    noisier = replace(points, camera_px=points.camera_px + 0.1)
    single = [
        BoardCapture(name, picture, seen)
        for name, picture, seen in (
            ("a", pictures[0], points),
            ("taken again", pictures[1], noisier),
            ("copy of a", pictures[0].copy(), replace(points)),
        )
    ]
    pairs = [StereoCapture("p", *pictures), StereoCapture("turned", *pictures[::-1]), StereoCapture("q", *pictures)]
    for captures, copy, first in ((single, "copy of a", "a"), (pairs, "q", "p")):
        _, left_out = see_views(captures, BOARD, lambda message: None)
        repeated = {one.name: one.reason for one in left_out if "counts once" in one.reason}
        assert repeated == {copy: f"the same capture as {first}, which counts once"}


def test_a_board_spec_that_no_picture_fits_is_refused(six: tuple[Rig, list[View]]) -> None:
    views = [replace(view, complete=False) for view in six[1]]
    result = calibrate_views(views, parse_board("chessboard:8x9:40mm"), SIZES)
    assert isinstance(result, RefusedCalibration)
    assert "8x9 inner corners, but every picture shows 7x9" in result.reason


def test_what_the_caller_got_wrong(six: tuple[Rig, list[View]]) -> None:
    nothing = Correspondences(np.empty((0, 2)), np.empty((0, 2)))
    captures = [
        BoardCapture(name, np.zeros(size, np.uint8), nothing) for name, size in (("a", (480, 640)), ("b", (9, 9)))
    ]
    with pytest.raises(InputError, match="b: expected pictures of 640 x 480 as in a, found 9 x 9"):
        calibrate(captures, BOARD, (1024, 768))
    with pytest.raises(InputError, match="expected captures"):
        calibrate([], BOARD, (1024, 768))
    with pytest.raises(InputError, match="camera: expected known intrinsics of 640 x 480"):
        calibrate(captures[:1], BOARD, (1024, 768), camera=six[0].camera)


def test_codes_of_another_pattern_are_named(six: tuple[Rig, list[View]], benchmark: ModuleType) -> None:
    from retrue.calibration.detection import BoardCorners
    from retrue.calibration.views import projected_view

    view = six[1][0]
    corners = BoardCorners(view.board_xy, view.pixels[0], True)
    rng = np.random.default_rng(0)
    noise = Correspondences(view.dense_camera_px, rng.uniform(0, 700, view.dense_camera_px.shape))
    with pytest.raises(InputError, match="another pattern"):
        projected_view("x", corners, noise, BOARD)
    elsewhere = Correspondences(view.dense_camera_px + 5000, view.dense_projector_px)
    with pytest.raises(InputError, match="does the projector light it"):
        projected_view("x", corners, elsewhere, BOARD)


def test_left_out_captures_stay_in_the_evidence(six: tuple[Rig, list[View]]) -> None:
    result = calibrate_views(six[1], BOARD, SIZES, CalibrationOptions(), left_out=[LeftOut("pose 9", "no board")])
    assert result.evidence["left_out"] == [{"name": "pose 9", "reason": "no board"}]


@pytest.mark.parametrize(("two", "name"), [(False, "projector"), (True, "second camera")])
def test_advice_calls_the_second_device_what_it_is(six: tuple[Rig, list[View]], two: bool, name: str) -> None:
    views = [replace(view, two_pictures=two) for view in six[1][:2]]
    advice = calibrate_views(views, BOARD, SIZES).evidence["advice"]
    told = [line for line in advice if "had none yet" in line]
    assert any(f"the {name}'s picture" in line for line in told)
    assert two != any("projector" in line for line in told)


def test_two_real_cameras(benchmark: ModuleType, shared_data: Path) -> None:
    for theirs, ours in benchmark.two_cameras(shared_data / "stereo-board").values():
        assert ours <= theirs * (1 + 1e-6)


@pytest.fixture(scope="module")
def real(benchmark: ModuleType, shared_data: Path) -> Any:
    return benchmark.real_projector(shared_data / "procam-board")


def test_a_real_projector_fits_no_worse_than_opencv(real: Any) -> None:
    for theirs, ours in real["rms"].values():
        assert ours <= theirs * (1 + 1e-6)


def test_real_poses_left_out(real: Any) -> None:
    ours = np.array([rms for rms, _ in real["epipolar"].values()])
    theirs = np.array([list(rms.values()) for _, rms in real["epipolar"].values()])
    assert (ours <= theirs.min(axis=1)).all()


@pytest.mark.parametrize("axis", [0, 1])
def test_one_coordinate_calibrates_what_it_measures(six: tuple[Rig, list[View]], axis: int) -> None:
    truth, views = six
    one = [_of_one_coordinate(view, axis) for view in views]
    result = calibrate_views(one, BOARD, SIZES)
    assert isinstance(result, Calibrated), result.reason
    rig, evidence = result.rig, result.evidence
    assert evidence["one_coordinate"]["decoded"] == ("columns", "rows")[axis]
    assert abs(rig.projector.K[axis, axis] / truth.projector.K[axis, axis] - 1) < 0.02
    # A wall, of which the projector tells one coordinate: as the rig that made it sees it, within what is stated.
    distance = evidence["predicted_error"]["at_distance"]
    x, y = np.meshgrid(np.linspace(200, 1080, 9), np.linspace(150, 870, 7))
    camera_px = np.stack([x.ravel(), y.ravel()], axis=-1)
    points = np.column_stack([truth.camera.unproject(camera_px), np.ones(len(camera_px))]) * distance
    projector_px = truth.projector.project(truth.projector_from_camera.apply(points))
    inside = truth.projector.contains(projector_px, margin=-50)
    camera_px, points, projector_px = camera_px[inside], points[inside], projector_px[inside]
    projector_px[:, 1 - axis] = np.nan
    there = reconstruct(rig, Correspondences(camera_px, projector_px))
    seen = {tuple(pixel): point for pixel, point in zip(camera_px.tolist(), points, strict=True)}
    error = [np.linalg.norm(point - seen[tuple(px)]) for point, px in zip(there.points, there.camera_px, strict=True)]
    assert len(error) > 0.9 * len(points)
    assert np.sqrt(np.mean(np.square(error))) < 3 * evidence["predicted_error"]["rms"]
    assert evidence["predicted_error"]["rms"] < 0.02 * distance


def _of_one_coordinate(view: View, axis: int) -> View:
    kept = np.where(np.arange(2) == axis, 0.0, np.nan)
    none = np.empty((0, 2))
    return replace(
        view,
        pixels=(view.pixels[0], view.pixels[1] + kept),
        patch_projector_px=view.patch_projector_px + kept,
        scene_camera_px=none,
        scene_projector_px=none,
    )


@pytest.mark.parametrize("axis", [0, 1])
def test_corners_of_one_coordinate(axis: int) -> None:
    board_from_camera = np.linalg.inv(np.array([[1.5, 0.1, 120], [-0.05, 1.6, 90], [1e-5, 3e-5, 1]]))
    projector_from_camera = np.array([[0.7, 0.05, 30], [-0.1, 0.8, 60], [2e-5, -4e-5, 1]])
    x, y = np.meshgrid(np.arange(100.0, 560, 2), np.arange(70.0, 660, 2))
    camera_px = np.stack([x.ravel(), y.ravel()], axis=-1)
    rng = np.random.default_rng(1)
    projector_px = apply_homography(projector_from_camera, camera_px) + rng.normal(0, 0.2, camera_px.shape)
    strays = rng.random(len(camera_px)) < 0.01
    projector_px[strays] = rng.uniform(0, 700, (strays.sum(), 2))
    projector_px[:, 1 - axis] = np.nan
    pixels = apply_homography(np.linalg.inv(board_from_camera), BOARD.points)
    fit = fit_projector_corners(
        BoardCorners(BOARD.points, pixels, True), Correspondences(camera_px, projector_px), BOARD
    )
    assert np.isnan(fit.corner_px[:, 1 - axis]).all()
    assert len(fit.scene_camera_px) == 0
    error = (fit.corner_px - apply_homography(projector_from_camera, pixels))[:, axis]
    assert np.nanmax(np.abs(error)) < 0.1
    assert np.isfinite(error).sum() > 50
