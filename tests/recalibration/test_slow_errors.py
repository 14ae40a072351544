"""A smooth error that the fit took up: its share of the covariance is the one of brute force, and sigma then holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.judgement.kinds import draw
from retrue.correspondences import Correspondences
from retrue.geometry.arrays import FloatArray
from retrue.geometry.transform import rotation_angle
from retrue.geometry.two_view import pose_difference, residuals
from retrue.recalibration.fit import own_pose
from retrue.recalibration.judge import judge
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.posterior import Posterior
from retrue.recalibration.slow_errors import AMPLITUDES, LENGTHS, NONE, taken_up
from tests.recalibration.scenes import RIG, SIDE_WALL, SPHERE, WALL, Scene, capture

EXACT_LENSES = RecalibrateOptions(focal_sigma=1e-7, principal_point_sigma_px=1e-5, k1_sigma=1e-8)
ROOM = Scene(planes=[WALL, SIDE_WALL], spheres=[SPHERE])
WALLS = WALL, (np.array([-0.35, 0.1, 1.0]), 1.5), (np.array([0.1, -0.45, 1.0]), 1.6)


def slowly_off(points: Correspondences, amplitude: float, rng: np.random.Generator) -> Correspondences:
    """The same with a wave of each camera coordinate, up to one in the picture, of that RMS."""
    waves = rng.uniform(-1, 1, (2, 2)) * 2 * np.pi / 1280
    error = np.sqrt(2) * np.sin(points.camera_px @ waves + rng.uniform(0, 2 * np.pi, 2))
    return replace(points, camera_px=points.camera_px + amplitude * error)


def answer(seed: int, amplitude: float, noise: float = 0.1) -> Posterior:
    points = capture(ROOM, grid=(32, 24), seed=seed, noise=noise)
    return judge(RIG, [slowly_off(points, amplitude, np.random.default_rng(seed))], EXACT_LENSES).answer


def normalised_errors(amplitude: float) -> tuple[float, float]:
    """Mean squares of the error in sigma, 5 where that is honest: as the residuals have it, and with what they hide."""
    alone, whole = list[float](), list[float]()
    for seed in range(12):
        found = answer(seed, amplitude)
        error = pose_difference(own_pose(RIG), found.pose)
        alone.append(float(error @ np.linalg.solve(found.covariance, error)))
        whole.append(float(error @ np.linalg.solve(found.covariance + taken_up(found).covariance, error)))
    return float(np.mean(alone)), float(np.mean(whole))


def test_an_error_that_the_fit_took_up_is_no_longer_many_sigma_and_none_costs_little() -> None:
    alone, whole = normalised_errors(0.1)
    assert alone > 100
    assert whole < alone / 6
    alone, whole = normalised_errors(0.0)
    assert alone / 3 < whole < 6


def test_an_error_of_one_capture_is_sought_in_that_one() -> None:
    """It bends a pose that three walls hardly hold; a wave that all three share would fit the others' points."""
    alone, whole = list[float](), list[float]()
    for seed in range(8):
        first, *others = (
            capture(Scene(planes=[wall]), grid=(32, 24), seed=3 * seed + k) for k, wall in enumerate(WALLS)
        )
        slow = slowly_off(first, 0.05, np.random.default_rng(seed))
        found = judge(RIG, [slow, *others], EXACT_LENSES)
        error = pose_difference(own_pose(RIG), found.answer.pose)
        alone.append(float(error @ np.linalg.solve(found.answer.covariance, error)))
        whole.append(float(error @ np.linalg.solve(found.answer.covariance + found.slow.covariance, error)))
        assert found.slow.weights.sum() == pytest.approx(1)
    assert np.mean(alone) > 20
    assert np.mean(whole) < 5


def test_it_is_what_brute_force_has_it() -> None:
    found = answer(1, 0.06)
    pixels = found.measured.camera_px
    u, v = (np.pi * (pixels - pixels.min(axis=0)) / np.ptp(pixels, axis=0).max()).T
    numbers = [(i, j) for i in range(3) for j in range(3)]
    fields = np.array([np.cos(i * u) * np.cos(j * v) * np.sqrt(2.0) ** ((i > 0) + (j > 0)) for i, j in numbers]).T
    jacobian = np.array([derivative(found, k) for k in range(5)]).T  # of a field across, planes and lenses know nothing
    weights, left = found.fit.weights[0], found.fit.found.epipolar
    cross = np.zeros((len(found.gradient), 9))
    cross[:5] = jacobian.T @ (weights[:, None] * fields)
    covariance = np.linalg.inv(found.information)
    unseen: FloatArray = fields.T @ (weights[:, None] * fields) - cross.T @ covariance @ cross
    asked: FloatArray = fields.T @ (weights * left) - cross.T @ covariance @ found.gradient
    total, second = 0.0, np.zeros((9, 9))
    for length in LENGTHS:
        spectrum = np.array([np.exp(-0.75 * length**2 * (i * i + j * j)) for i, j in numbers])
        spectrum /= spectrum.sum()
        for s, before in [(0.0, NONE), *((s, (1 - NONE) / len(AMPLITUDES)) for s in AMPLITUDES)]:
            prior = np.diag(s * s * spectrum)
            spread: FloatArray = np.eye(9) + unseen @ prior
            gained = asked @ prior @ np.linalg.solve(spread, asked)
            evidence = before * np.exp(0.5 * gained) / np.sqrt(np.linalg.det(spread))
            total, second = total + evidence, second + evidence * prior
    own = np.delete(np.arange(len(cross)), np.arange(8) + 5 + 3 * len(found.pose.planes))
    follows = np.linalg.solve(found.information[np.ix_(own, own)], cross[own])[:5]
    np.testing.assert_allclose(
        taken_up(found).covariance, follows @ (second / total) @ follows.T, rtol=1e-2, atol=1e-12
    )


def derivative(found: Posterior, parameter: int) -> np.ndarray:
    step = np.zeros(5 + 3 * len(found.pose.planes))
    step[parameter] = 1e-6
    bows = found.measured.bowed(found.parameters.bows)
    ahead, back = (residuals(found.pose.moved(sign * step), found.points, bows).epipolar for sign in (1, -1))
    return (ahead - back) / 2e-6


@pytest.mark.parametrize("seed", [140000332, 140000416])
def test_a_slow_error_does_not_grow_until_a_wall_is_none(seed: int) -> None:
    """Across the lines it counted less and less; without the wall, light no longer told its twins apart."""
    case = draw("wall, hostile, old 10", seed)
    told = RecalibrateOptions(focal_sigma=case.prior.focal, principal_point_sigma_px=case.prior.centre_px)
    captures = [capture.public() for capture in case.captures]
    judgement = judge(case.told.public(), captures, replace(told, k1_sigma=case.prior.k1))
    assert np.degrees(rotation_angle(judgement.answer.pose.R @ case.truths[0].R.T)) < 0.5
    assert len(judgement.answer.pose.planes) == 1
    assert judgement.answer.fit.epipolar_noise.shared < 0.1
