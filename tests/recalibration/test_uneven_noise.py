"""Noise that is louder along one axis speaks neither for a pose whose lines run along it, nor for another lens."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import Generator

import retrue
from retrue.correspondences import Correspondences
from retrue.geometry.arrays import FloatArray
from retrue.geometry.nearest import nearest_of_all
from retrue.geometry.transform import RigidTransform, direction_angle, rotation_angle
from retrue.geometry.two_view import TwoViewPoints, TwoViewPose, residuals
from retrue.recalibration.judge import judge
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.posterior import posterior_at
from retrue.recalibration.uneven_noise import LineNoise, NoiseShape, line_noise, noise_shape
from retrue.rig import Rig
from tests.recalibration.scenes import CAMERA, POSE, RIG, SIDE_WALL, WALL, Scene, bumped, capture


def louder(points: Correspondences, angle: float, ratio: float, noise: float, rng: Generator) -> Correspondences:
    """With noise of the camera's pixels, so many times larger along that axis than across it."""
    axis = np.array([np.cos(angle), np.sin(angle)])
    along, across = rng.normal(0, noise, (2, len(points), 1))
    error = along * ratio**0.5 * axis + across * ratio**-0.5 * np.array([-axis[1], axis[0]])
    return replace(points, camera_px=points.camera_px + error)


def off(pose: TwoViewPose, rig: Rig) -> float:
    return rotation_angle(pose.R @ rig.projector_from_camera.R.T)


def grid(rng: Generator) -> tuple[FloatArray, np.ndarray]:
    places: FloatArray = np.stack(np.meshgrid(np.arange(30.0), np.arange(20.0)), -1).reshape(-1, 2)
    places += rng.uniform(-0.1, 0.1, places.shape)
    return places, nearest_of_all(places, places, 5)[1][:, 1:]


def missing(places: FloatArray, missed: FloatArray) -> TwoViewPoints:
    """Points of a plane that both devices see alike, of a camera that is exact."""
    sigmas = np.zeros(len(places)), np.ones(len(places))
    return TwoViewPoints(places, places + missed, *sigmas, np.zeros(len(places), dtype=np.int64))


def test_shape_is_that_of_the_noise_whatever_the_planes_are_bowed_by() -> None:
    rng = np.random.default_rng(0)
    places, neighbours = grid(rng)
    truth = np.array([[2.0, 0.8], [0.8, 1.0]])
    missed = rng.multivariate_normal([0, 0], truth, len(places)) + 20 * ((places - 15) / 15) ** 2 * [0.0, 1.0]
    found = noise_shape(missing(places, missed), [np.eye(3)], neighbours)
    assert found is not None
    np.testing.assert_allclose(found.covariance, truth, atol=0.25)


def test_noise_that_is_alike_by_chance_is_even() -> None:
    for seed in range(20):
        rng = np.random.default_rng(seed)
        places, neighbours = grid(rng)
        points = missing(places, rng.normal(size=places.shape))
        assert noise_shape(points, [np.eye(3)], neighbours) is None
        assert noise_shape(points.without_planes(np.ones(1, dtype=np.bool_)), [], neighbours) is None


@pytest.mark.parametrize("ratio", [2.5, 5.0])
@pytest.mark.parametrize("scene", [Scene(), Scene(planes=[(np.array([0.7, 0.3, 1.0]), 1.2)])], ids=["wall", "slanted"])
def test_a_wall_is_answered_right_or_not_at_all_and_no_lens_is_blamed(scene: Scene, ratio: float) -> None:
    for seed in range(12):
        rng = np.random.default_rng(seed)
        points = louder(capture(scene, noise=0.0, seed=seed), rng.uniform(0, np.pi), ratio, 0.3, rng)
        result = retrue.recalibrate(
            bumped(RIG, rng.uniform(-3, 3, 3).tolist(), rng.uniform(-3, 3, 3).tolist()), [points]
        )
        assert result.evidence.lens != "changed"
        if isinstance(result, retrue.Accepted):
            pose, truth = result.rig.projector_from_camera, RIG.projector_from_camera
            sigma = result.evidence.sigma
            assert sigma is not None
            assert np.degrees(rotation_angle(pose.R @ truth.R.T)) < max(0.2, 5 * sigma.rotation_deg)
            assert np.degrees(direction_angle(pose.t, truth.t)) < max(0.2, 5 * sigma.translation_deg)


def test_a_changed_lens_is_still_told() -> None:
    longer = replace(RIG, camera=replace(CAMERA, K=CAMERA.K * [[1.06, 1, 1], [1, 1.06, 1], [1, 1, 1]]))
    for seed in range(3):
        rng = np.random.default_rng(seed)
        room = Scene(planes=[WALL, SIDE_WALL, (np.array([0.0, 0.9, 0.6]), 0.95)])
        points = louder(capture(room, rig=longer, noise=0.0, seed=seed), rng.uniform(0, np.pi), 3.0, 0.2, rng)
        assert retrue.recalibrate(RIG, [points]).evidence.lens == "changed"


def test_neither_of_two_poses_gains_by_lines_that_cross_the_axis_of_the_noise() -> None:
    """A wall's two poses cost alike on average, though lines that diverge have noise of many levels across them."""
    near = replace(RIG, projector_from_camera=replace(POSE, t=POSE.t * [0.4, 0.4, 4.0]))
    none, gained = np.ones(1, dtype=np.bool_), list[float]()
    for seed in range(12):
        rng = np.random.default_rng(seed)
        exact = capture(Scene(), rig=near, noise=0.0, seed=seed)
        points = replace(exact, projector_px=exact.projector_px + rng.normal(0, [0.7, 0.14], (len(exact), 2)))
        judged = judge(near, [points], RecalibrateOptions())
        uneven = judged.compared.fit.uneven
        assert uneven is not None
        assert np.ptp(uneven.relative[0]) > 0.5
        twins = sorted((judged.compared, judged.rivals[0].posterior), key=lambda fit: off(fit.pose, near))
        alone = judged.compared.measured.without_planes(none)
        right, wrong = (posterior_at(alone, fit.parameters.without_planes(none), fit.prior) for fit in twins)
        gained.append(float(right.losses.sum() - wrong.losses.sum()))
    assert abs(np.mean(gained)) < 3 * np.sqrt(4 * len(exact) / len(gained))  # of two sums of squares, by chance


@pytest.mark.parametrize("seed", [0, 6, 7, 15, 16, 23])
def test_wrong_matches_cost_each_pose_the_same_whatever_noise_is(seed: int) -> None:
    """Of 24 seeds, those where less noise was expected of them, too, and one of a wall's poses had 24 nats or more."""
    rng = np.random.default_rng(seed)
    wall = capture(Scene(), noise=0.0, seed=seed, grid=(40, 30), area=(0.4, 0.7, 0.4, 0.7))
    points = louder(wall, rng.uniform(0, np.pi), 2.5, 0.05, rng)
    projector_px, wrong = points.projector_px.copy(), rng.random(len(points)) < 0.3
    projector_px[wrong] = rng.uniform(0, 1, (np.count_nonzero(wrong), 2)) * RIG.projector.size
    judged = judge(
        bumped(RIG, [1, 1, 1], [1, 1, 1]), [replace(points, projector_px=projector_px)], RecalibrateOptions()
    )
    assert abs(min(judged.rivals, key=lambda rival: rival.margin).points) < RecalibrateOptions().min_margin


ASLANT = Scene(planes=[(np.array([-1.0, 0.1, 0.6]), 1.0)])
BESIDE = replace(RIG, projector_from_camera=RigidTransform.from_rotation_vector([0.05, -0.5, 0.02], [0.7, -0.04, 0.2]))


def points_of(matches: Correspondences) -> TwoViewPoints:
    """Without a word of whose noise it is."""
    rays = RIG.camera.unproject(matches.camera_px), RIG.projector.unproject(matches.projector_px)
    sigmas = np.full(len(matches), 1 / 1600.0), np.full(len(matches), 1 / 1400.0)
    return TwoViewPoints(*rays, *sigmas, np.zeros(len(matches), dtype=np.int64))


def aslant_pose() -> TwoViewPose:
    (normal, distance), t = ASLANT.planes[0], BESIDE.projector_from_camera.t
    plane, length = normal / np.linalg.norm(normal) / distance, float(np.linalg.norm(t))
    return TwoViewPose(BESIDE.projector_from_camera.R, t / length, plane[None] * length)


def spoilt(exact: Correspondences, device: str, ratio: float, rng: Generator) -> Correspondences:
    """With noise of that device's pixels alone, louder by that ratio along an axis of its own."""
    if device == "camera":
        return louder(exact, 1.2, ratio, 0.2, rng)
    turned = louder(replace(exact, camera_px=exact.projector_px), 1.2, ratio, 0.2, rng)
    return replace(exact, projector_px=turned.camera_px)


@pytest.mark.parametrize("device", ["camera", "projector"])
def test_whose_noise_it_is_is_told_where_an_oblique_wall_makes_it_long(device: str) -> None:
    """Taken for noise of the projector, it spoke for the pose whose lines run along its length: a wall 21 deg off."""
    pose, exact = aslant_pose(), capture(ASLANT, rig=BESIDE, noise=0.0)
    H: FloatArray = pose.R + pose.t[:, None] * pose.planes[0]
    neighbours = nearest_of_all(exact.camera_px, exact.camera_px, 5)[1][:, 1:]
    told = list[float]()
    for seed in range(12):
        points = points_of(spoilt(exact, device, 1.0, np.random.default_rng(seed)))
        found = noise_shape(points, [H], neighbours)
        assert found is not None
        assert found.frame in (device, "both devices")  # the same along that wall, to a few hundredths
        if found.frame == device:
            short, long = np.sqrt(np.linalg.eigvalsh(found.covariance))
            told.append(long / short)
    assert len(told) >= 6
    assert max(told) < 1.25


@pytest.mark.parametrize("ratio", [1.0, 3.0])
@pytest.mark.parametrize("device", ["camera", "projector"])
def test_how_loud_each_residual_is_about_its_line_is_what_it_scatters_by(device: str, ratio: float) -> None:
    pose, rng = aslant_pose(), np.random.default_rng(0)
    exact = capture(ASLANT, rig=BESIDE, noise=0.0)
    H: FloatArray = pose.R + pose.t[:, None] * pose.planes[0]
    neighbours = nearest_of_all(exact.camera_px, exact.camera_px, 5)[1][:, 1:]
    drawn = [points_of(spoilt(exact, device, ratio, rng)) for _ in range(60)]
    scatter = np.log(np.std([residuals(pose, points).both for points in drawn], axis=0))

    def left(shape: NoiseShape) -> FloatArray:
        """(2, N) logarithms of how much louder all are than expected."""
        noise: LineNoise = line_noise(pose, points_of(exact), shape)
        return scatter - np.log(noise.relative * np.sqrt(noise.usual)[:, None])

    found = noise_shape(drawn[0], [H], neighbours)
    assert found is not None
    found = found.of(points_of(exact), [H])
    assert np.abs(left(found).mean(axis=1)).max() < 0.12
    assert left(found).std(axis=1).max() < 0.11  # a tenth is of 60 draws
    alike = replace(found, frame="both devices", covariance=np.eye(2))
    assert np.ptp(left(alike).mean(axis=1)) > 0.2
