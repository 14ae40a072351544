"""A part of the points that is misread by little passes neither for noise nor for the scene."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from retrue.correspondences import Correspondences
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform, rotation_angle
from retrue.geometry.two_view import TwoViewPose
from retrue.recalibration.chance import lined_up
from retrue.recalibration.fit import squared_sigmas
from retrue.recalibration.recalibrate import recalibrate
from retrue.recalibration.result import Accepted
from retrue.rig import Rig
from tests.recalibration.scenes import BALLS, POSE, RIG, Scene, bumped, capture

WEBCAM = Camera((640, 480), np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]]))
SHIFTED = Camera((854, 480), np.array([[1100.0, 0, 427], [0, 1100, 600], [0, 0, 1]]))


def shuffled_in_patches(points: Correspondences, share: float, rng: np.random.Generator) -> Correspondences:
    """Blocks of round patches taken for others of the same patch, until they are that share of all."""
    projector_px = points.projector_px.copy()
    wrong = np.zeros(len(points), dtype=np.bool_)
    while wrong.mean() < share:
        centre = points.camera_px[rng.integers(len(points))]
        patch = np.flatnonzero(np.hypot(*(points.camera_px - centre).T) < rng.uniform(15, 50))
        projector_px[patch] = projector_px[rng.permutation(patch)]
        wrong[patch] = True
    return replace(points, projector_px=projector_px)


@pytest.mark.parametrize("seed", range(6))
def test_blocks_taken_for_others_of_their_row_are_no_part_of_the_scene(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn = np.radians(rng.uniform([-3, -20, -2], [3, -5, 2]))
    rig = Rig(WEBCAM, SHIFTED, RigidTransform.from_rotation_vector(turn, [0.35, 0, rng.uniform(-0.02, 0.02)]), "m")
    wall = (np.array([*rng.uniform(-0.3, 0.3, 2), 1.0]), 1.7)
    points = shuffled_in_patches(capture(Scene([wall]), rig=rig, noise=0.06, grid=(140, 100), seed=seed), 0.33, rng)
    result = recalibrate(bumped(rig, [0.5, -1, 0.3], [0.3, 0.5, -0.4]), [points])
    assert isinstance(result, Accepted), result.reason
    true, found = (one.projector_from_camera for one in (rig, result.rig))
    start, end = (TwoViewPose(pose.R, pose.t / np.linalg.norm(pose.t)) for pose in (true, found))
    assert squared_sigmas(start, end, np.array(result.evidence.details["covariance"])) < 20.5  # once in a thousand


def test_a_row_of_a_grid_holds_more_points_than_chance_brings_together() -> None:
    rng = np.random.default_rng(0)
    assert lined_up(rng.uniform(-300, 300, 4000)) < 75  # 40 a window, and what chance makes of it
    rows = 40.0 * np.arange(-8, 9)
    assert lined_up((rows[:, None] + rng.normal(0, 1, (17, 100))).ravel()) > 80


@pytest.mark.parametrize("aslant", [-3.0, -4.0])
def test_a_copy_that_misses_its_epipolar_lines_by_few_sigma_is_no_noise(aslant: float) -> None:
    points = capture(BALLS, noise=0.15, grid=(130, 100))
    copied = points.camera_px[:, 0] > np.quantile(points.camera_px[:, 0], 0.8)
    projector_px = points.projector_px + np.where(copied[:, None], [60.0, aslant], 0.0)
    near = bumped(RIG, [0.5, -1.0, 0.3], [0.3, 0.5, -0.4])
    result = recalibrate(near, [replace(points, projector_px=projector_px)])
    assert isinstance(result, Accepted), result.reason
    assert np.degrees(rotation_angle(result.rig.projector_from_camera.R @ POSE.R.T)) < 0.1
    assert result.evidence.details["noise_px"] < 0.2
