"""Lenses that are off as a calibration leaves them are no second pose, and no noise; further off, they stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from retrue.geometry.transform import vector_from_rotation
from retrue.recalibration.candidates import twins_of
from retrue.recalibration.hypotheses import Hypothesis, hypotheses_of, hypothesis, one_place
from retrue.recalibration.lens import LensPrior, changed_device
from retrue.recalibration.measured import Measured
from retrue.recalibration.parameters import Parameters, Prior
from retrue.recalibration.parts import homography_residuals
from retrue.recalibration.recalibrate import recalibrate
from retrue.recalibration.result import Accepted
from retrue.rig import Rig
from tests.recalibration.scenes import POSE, RIG, SPHERE, Scene, bumped, capture
from tests.recalibration.test_posterior import measured_scene

STEPS = Scene(planes=[(np.array([0.2, 0.1, 1.0]), 1.6), (np.array([-0.9, 0.0, 0.6]), 0.95)], spheres=[SPHERE])
SIGMA = np.array([2e-3, 3.0, 3.0, 2e-3] * 2)
OFF = np.array([1.5e-3, 4.0, -3.0, 1e-3, -2e-3, -3.0, 4.0, -1e-3])  # a calibration leaves as much


def through(off: np.ndarray) -> Rig:
    """The rig whose true lenses are off by that, as the scene sees them."""
    return replace(RIG, camera=changed_device(RIG.camera, off[:4]), projector=changed_device(RIG.projector, off[4:]))


@pytest.mark.parametrize("seed", range(3))
def test_lenses_move_as_far_as_their_calibration_allows(seed: int) -> None:
    old = replace(bumped(RIG, [1, -2, 0.5], [2, -1, 1]), evidence={"lens_covariance": np.diag(SIGMA**2).tolist()})
    result = recalibrate(old, [capture(STEPS, rig=through(OFF), noise=0.05, seed=seed)])
    assert isinstance(result, Accepted), result.reason
    pose, sigma = result.rig.projector_from_camera, result.evidence.sigma
    assert sigma is not None
    error = np.degrees(np.linalg.norm(vector_from_rotation(pose.R @ POSE.R.T)))
    assert error < 3 * sigma.rotation_deg
    assert sigma.rotation_deg < 0.1  # through the lenses as they were given: .2, and .3 off
    np.testing.assert_array_equal(result.rig.camera.K, RIG.camera.K)  # which lenses they are, one picture need not say


def corner() -> tuple[Measured, Parameters, list[np.ndarray]]:
    measured, start = measured_scene("corner", through(OFF), noise=0.05)
    pose = start.pose
    homographies = [pose.R + np.outer(pose.t, plane) for plane in pose.planes]
    missed = homography_residuals(measured.support.points, homographies)
    return replace(measured, homography_residuals=missed), start, homographies


def hypotheses(sigma: np.ndarray) -> Hypothesis:
    measured, start, homographies = corner()
    tight = LensPrior(np.diag(sigma**2))
    return hypothesis(measured, start, Prior(tight), tight, homographies)


def test_it_is_better_by_far_and_no_lens_moves_further_than_its_calibration_allows() -> None:
    found = hypotheses(SIGMA)
    assert found.moved is not None
    assert found.better() is found.moved
    assert found.moved.fit.epipolar_noise.level < 0.5 * found.fixed.fit.epipolar_noise.level
    assert hypotheses(SIGMA / 10).moved is None


def test_starts_that_lead_to_one_place_are_one_hypothesis() -> None:
    measured, start, homographies = corner()
    near = replace(start, pose=start.pose.moved(np.full(5 + 3 * len(start.pose.planes), 1e-3)))
    (twin, *_) = twins_of(start.pose, measured.support.points)
    tight = LensPrior(np.diag(SIGMA**2))
    starts = [start, near, Parameters.of(twin)]
    found = hypotheses_of(measured, starts, Prior(tight), tight, homographies)
    assert len(found) == 2
    assert not one_place(found[0].fixed, found[1].fixed)
    for one, begun in zip(found, (near, Parameters.of(twin)), strict=True):
        assert one_place(hypothesis(measured, begun, Prior(tight), tight, homographies).fixed, one.fixed)
