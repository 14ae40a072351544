"""Each capture counts by its own noise."""

from __future__ import annotations

import numpy as np

import retrue
from benchmarks.judgement.kinds import draw
from retrue.geometry.transform import direction_angle, rotation_angle
from retrue.recalibration.measured import MISFIT_PX
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.scene import scene_of
from tests.recalibration.scenes import BALLS, RIG, SIDE_WALL, WALL, Scene, capture

ROOM = Scene(planes=[WALL, SIDE_WALL])


def test_loudness_is_that_of_the_noise_before_any_pose_is_known() -> None:
    captures = [capture(ROOM, noise=noise, outliers=0.1, seed=seed) for seed, noise in enumerate([0.1, 0.3, 0.9])]
    scene = scene_of(RIG, captures, RecalibrateOptions(), np.random.default_rng(0))
    told = [float(np.median(scene.rays.points.camera_sigma[scene.rays.capture == index])) for index in range(3)]
    expected = np.hypot([0.1, 0.3, 0.9], MISFIT_PX)
    np.testing.assert_allclose(np.divide(told, told[1]), expected / expected[1], rtol=0.15)


def test_a_capture_without_planes_counts_as_the_usual_one() -> None:
    captures = [capture(ROOM, noise=0.1), capture(BALLS, noise=0.1, seed=1), capture(ROOM, noise=0.4, seed=2)]
    scene = scene_of(RIG, captures, RecalibrateOptions(), np.random.default_rng(0))
    usual, *others = (float(np.median(scene.rays.points.camera_sigma[scene.rays.capture == k])) for k in (1, 0, 2))
    assert others[0] < usual < others[1]
    np.testing.assert_allclose(np.sqrt(others[0] * others[1]), usual, rtol=1e-9)


def test_a_loud_capture_costs_the_pose_nothing_that_the_quiet_one_knows() -> None:
    """Weighed alike, both would be as far off as the loud one is."""
    off = {True: list[float](), False: list[float]()}
    for seed in range(8):
        quiet, loud = capture(ROOM, noise=0.1, seed=seed), capture(ROOM, noise=0.5, seed=100 + seed)
        for with_loud, captures in ((False, [quiet]), (True, [quiet, loud])):
            found = retrue.recalibrate(RIG, captures).evidence.pose
            assert found is not None
            off[with_loud].append(rotation_angle(found.R @ RIG.projector_from_camera.R.T))
    assert np.mean(off[True]) < 1.2 * np.mean(off[False])


def test_two_walls_as_loud_as_they_are_tell_their_pose_from_another() -> None:
    """Weighed alike, the quieter one of these was explained by a pose 34 degrees away as well as by its own."""
    case = draw("three captures", 170000020)
    told = RecalibrateOptions(focal_sigma=case.prior.focal, principal_point_sigma_px=case.prior.centre_px)
    result = retrue.recalibrate(case.told.public(case.evidence), [one.public() for one in case.captures[1:]], told)
    pose, truth = result.evidence.pose, case.truths[0]
    assert pose is not None
    assert np.degrees(rotation_angle(pose.R @ truth.R.T)) < 0.2
    assert np.degrees(direction_angle(pose.t, truth.t)) < 0.2
