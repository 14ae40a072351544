"""The main job on real captures of a board before walls; the truth is a static calibration on five poses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import retrue
from retrue.geometry.transform import direction_angle, rotation_angle, rotation_from_vector

DATA = Path(__file__).parents[3] / "shared" / "data" / "procam-board"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"the real captures are not there: {DATA}")

BOARD = (7, 9)
SQUARE_MM = 75.0


@pytest.fixture(scope="module")
def rig() -> retrue.Rig:
    return retrue.read_rig(DATA / "rig.json")


@pytest.fixture(scope="module")
def captures() -> list[retrue.Correspondences]:
    pattern = retrue.read_pattern(DATA / "pattern.json")
    return [retrue.read_capture(DATA / f"capture_{k}", pattern) for k in range(3)]


@pytest.fixture(scope="module")
def alone(rig: retrue.Rig, captures: list[retrue.Correspondences]) -> list[retrue.Accepted]:
    """What each capture says by itself, of the rig as it is."""
    results = [retrue.recalibrate(rig, [capture]) for capture in captures]
    accepted = [result for result in results if isinstance(result, retrue.Accepted)]
    assert len(accepted) == len(results), results
    return accepted


def board_corners(capture: int) -> np.ndarray:
    """(9, 7, 2) camera pixels of the inner corners in the white picture."""
    import cv2

    picture = cv2.imread(str(DATA / f"capture_{capture}" / "graycode_40.jpg"), cv2.IMREAD_GRAYSCALE)
    found, corners = cv2.findChessboardCorners(picture, BOARD)
    assert found
    return cv2.cornerSubPix(picture, corners, (5, 5), (-1, -1), (3, 30, 0.01)).reshape(BOARD[1], BOARD[0], 2)


def on_board(points: retrue.Correspondences, capture: int) -> retrue.Correspondences:
    import cv2

    hull = cv2.convexHull(board_corners(capture).reshape(-1, 2).astype(np.float32))
    mask = cv2.fillConvexPoly(np.zeros((1024, 1280), np.uint8), np.round(hull).astype(np.int32), 1)
    x, y = np.round(points.camera_px).astype(int).T
    return points.select(mask[y, x] > 0)


def turned(rig: retrue.Rig, rotation: np.ndarray, t_rotation: np.ndarray, stretch: float) -> retrue.Rig:
    pose = rig.projector_from_camera
    turned_pose = retrue.RigidTransform(
        rotation_from_vector(rotation) @ pose.R, stretch * rotation_from_vector(t_rotation) @ pose.t
    )
    return retrue.Rig(rig.camera, rig.projector, turned_pose, rig.unit)


def off_by_deg(found: retrue.Rig, truth: retrue.Rig) -> tuple[float, float]:
    a, b = found.projector_from_camera, truth.projector_from_camera
    return float(np.degrees(rotation_angle(a.R @ b.R.T))), float(np.degrees(direction_angle(a.t, b.t)))


def test_each_capture_alone_and_all_jointly_from_any_prior_within_20_deg(
    rig: retrue.Rig, captures: list[retrue.Correspondences], alone: list[retrue.Accepted]
) -> None:
    rng = np.random.default_rng(5)
    t = rig.projector_from_camera.t
    for k, limits in [(0, (0.10, 0.25)), (1, (0.10, 0.25)), (2, (0.10, 0.25)), (slice(3), (0.03, 0.05))]:
        axis = rng.normal(size=3)
        t_axis = np.cross(t, rng.normal(size=3))
        angle = np.radians(20)
        old = turned(rig, angle * axis / np.linalg.norm(axis), angle * t_axis / np.linalg.norm(t_axis), 1.8)
        used = captures[k] if isinstance(k, slice) else [captures[k]]
        held = retrue.recalibrate(rig, used) if isinstance(k, slice) else alone[k]
        for result in (held, retrue.recalibrate(old, used)):
            assert isinstance(result, retrue.Accepted), result.reason
            rotation, translation = found_off_by_deg(result, rig)
            assert rotation < limits[0]
            assert translation < limits[1]


def found_off_by_deg(result: retrue.Accepted, rig: retrue.Rig) -> tuple[float, float]:
    """Of the pose that was found, also where the rig still holds and its own is kept."""
    pose = result.evidence.pose
    assert pose is not None
    return off_by_deg(replace(rig, projector_from_camera=pose), rig)


def test_the_board_alone_needs_the_prior_or_the_light(rig: retrue.Rig, captures: list[retrue.Correspondences]) -> None:
    for k, capture in enumerate(captures):
        board = on_board(capture, k)
        result = retrue.recalibrate(rig, [board])
        assert isinstance(result, retrue.Accepted), result.reason
        rotation, translation = found_off_by_deg(result, rig)
        assert rotation < 0.55
        assert translation < 1.5
        answer, *others = (candidate.projector_from_camera.t for candidate in result.evidence.candidates)
        twin = max(others, key=lambda t: direction_angle(t, answer))
        between = retrue.RigidTransform(rig.projector_from_camera.R, answer + twin)
        lost = retrue.Rig(rig.camera, rig.projector, between, rig.unit)
        refused = retrue.recalibrate(lost, [replace(board, light=None)])
        assert isinstance(refused, retrue.Refused)
        assert len(refused.evidence.candidates) >= 2
        lit = retrue.recalibrate(lost, [board])
        if isinstance(lit, retrue.Accepted):
            rotation, translation = found_off_by_deg(lit, rig)
            assert rotation < 0.55
            assert translation < 1.5


def test_verify_says_good_and_finds_half_a_degree_about_any_axis(
    rig: retrue.Rig, captures: list[retrue.Correspondences]
) -> None:
    axes = np.concatenate([np.eye(3), np.random.default_rng(6).normal(size=(3, 3))])
    for number, capture in enumerate(captures):
        found = retrue.verify(rig, [capture])
        assert found.verdict == "good", found.reason
        for axis in axes[number::3]:  # each capture is asked of two: of all it takes three times as long
            off = turned(rig, np.radians(0.5) * axis / np.linalg.norm(axis), np.zeros(3), 1.0)
            assert retrue.verify(off, [capture]).verdict == "drifted", axis


def test_the_board_is_flat_and_its_squares_have_their_size(
    captures: list[retrue.Correspondences], alone: list[retrue.Accepted]
) -> None:
    from scipy.interpolate import LinearNDInterpolator
    from scipy.spatial import KDTree

    for k, (capture, result) in enumerate(zip(captures, alone, strict=True)):
        board = on_board(capture, k)
        cloud = retrue.reconstruct(result.rig, board)
        center = cloud.points.mean(axis=0)
        normal = np.linalg.svd(cloud.points - center, full_matrices=False)[2][2]
        rms = float(np.sqrt(np.mean(((cloud.points - center) @ normal) ** 2)))
        assert rms < 1e-3 * abs(float(center @ normal))
        pixels = board_corners(k)
        distance, _ = KDTree(pixels.reshape(-1, 2)).query(cloud.camera_px, distance_upper_bound=8)
        near = np.isfinite(distance)
        corners = LinearNDInterpolator(cloud.camera_px[near], cloud.points[near])(pixels)
        sides = np.concatenate([np.linalg.norm(np.diff(corners, axis=axis), axis=2).ravel() for axis in (0, 1)])
        assert np.nanmean(sides) == pytest.approx(SQUARE_MM, rel=0.01)
