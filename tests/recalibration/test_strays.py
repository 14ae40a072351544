"""Wrong matches that lie on their epipolar lines by chance, at a depth that nothing near them has, turn no pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from retrue.correspondences import Correspondences
from retrue.geometry.arrays import BoolArray
from retrue.geometry.two_view import TwoViewPose
from retrue.recalibration.chance import outlying, strays
from retrue.recalibration.fit import PoseFit, Support, evaluate, squared_sigmas
from retrue.recalibration.rays import rays_of_captures
from retrue.recalibration.recalibrate import recalibrate
from retrue.recalibration.result import Accepted
from tests.recalibration.scenes import BALL, BALLS, POSE, RIG, Scene, bumped, capture

SMALL = Scene(planes=[], spheres=[(np.array([0.05, 0.0, 1.6]), 0.25)])
OLD = bumped(RIG, [2, 5, -1], [0, 4, 0])
TRUE = TwoViewPose(POSE.R, POSE.t / np.linalg.norm(POSE.t))


def at_truth(points: Correspondences) -> PoseFit:
    return evaluate(TRUE, Support.of(rays_of_captures(RIG, [points], 20_000, np.random.default_rng(0))))


def shuffled(points: Correspondences, share: float, rng: np.random.Generator) -> tuple[Correspondences, BoolArray]:
    """That share of them matched with pixels of one another; and which."""
    wrong = rng.random(len(points)) < share
    projector_px = points.projector_px.copy()
    projector_px[wrong] = rng.uniform(projector_px.min(axis=0), projector_px.max(axis=0), (wrong.sum(), 2))
    return replace(points, projector_px=projector_px), wrong


def test_of_right_points_none_is_a_stray_and_of_chance_ones_many_are() -> None:
    lost, told, there = 0, 0, 0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        points = capture(BALL, noise=1.0, seed=seed)
        assert not strays(at_truth(points), None).any()
        points, wrong = shuffled(points, 0.5, rng)
        fit = at_truth(points)
        gone = strays(fit, None)
        lost += np.count_nonzero(gone & ~wrong)
        told += np.count_nonzero(gone & wrong)
        there += np.count_nonzero(fit.explained & wrong)
    assert lost <= 3
    assert told > 0.5 * there > 0


@pytest.mark.parametrize(
    ("scene", "noise", "seed"),
    [
        (BALLS, 0.1, 5),
        (BALL, 0.4, 4),
        (BALL, 0.4, 6),
        (BALL, 0.4, 7),
        (SMALL, 0.1, 1),
        (SMALL, 0.4, 9),
        (SMALL, 0.4, 12),
    ],
)
def test_half_of_the_matches_wrong_leave_sigma_honest(scene: Scene, noise: float, seed: int) -> None:
    result = recalibrate(OLD, [capture(scene, noise=noise, outliers=0.5, seed=seed)])
    assert isinstance(result, Accepted), result.reason
    pose = result.rig.projector_from_camera
    found = TwoViewPose(pose.R, pose.t / np.linalg.norm(pose.t))
    assert squared_sigmas(TRUE, found, np.array(result.evidence.details["covariance"])) < 20.5  # once in a thousand


def test_points_that_stand_off_by_themselves_are_strays_if_chance_can_make_so_many() -> None:
    rng = np.random.default_rng(0)
    right = rng.normal(0, 0.01, 1000)
    wrong = np.linspace(0, 2, 200)
    few = outlying(np.append(right, [0.5, 0.9]), wrong, 0.005)
    assert few[1000:].all()
    assert not few[:1000].any()
    many = np.append(right, rng.uniform(0.5, 0.9, 60))  # an object before the others
    assert not outlying(many, wrong, 0.005).any()
    assert not outlying(np.append(right, [0.5, 0.9]), wrong, 1e-7).any()  # hardly a match is wrong
