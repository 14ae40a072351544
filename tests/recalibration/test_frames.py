"""Each direction of t has a tangent basis of its own; those of two that hardly differ may be a quarter turn apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from retrue.geometry.transform import RigidTransform
from retrue.geometry.two_view import TwoViewPose, pose_difference, tangent_basis
from retrue.recalibration.fit import carried, squared_sigmas
from retrue.recalibration.lens import stated_prior
from retrue.recalibration.parameters import Parameters, PosePrior, Prior
from retrue.recalibration.posterior import fit_posterior, posterior_at
from tests.recalibration.scenes import POSE, RIG
from tests.recalibration.test_posterior import measured_scene


def beside_the_seam() -> tuple[TwoViewPose, TwoViewPose]:
    """Two poses a hundredth of a degree apart."""
    sides = np.array([[-1.0, 0.02, 0.0199], [-1.0, 0.02, 0.0202]])
    poses = [TwoViewPose(np.eye(3), side / np.linalg.norm(side)) for side in sides]
    assert abs((tangent_basis(poses[0].t).T @ tangent_basis(poses[1].t))[0, 0]) < 0.1
    return poses[0], poses[1]


def test_a_change_stays_the_same_change_in_the_frame_of_another_pose() -> None:
    here, there = beside_the_seam()
    rows, change = carried(here, there), np.array([0.1, -0.2, 0.3, 0.4, -0.5])
    np.testing.assert_allclose(rows @ rows.T, np.eye(5), atol=1e-12)
    np.testing.assert_allclose(rows @ carried(there, here), np.eye(5), atol=1e-12)
    moved = [tangent_basis(pose.t) @ one[3:] for pose, one in ((here, change), (there, rows @ change))]
    np.testing.assert_allclose(moved[0], moved[1], atol=2e-4)
    between = pose_difference(here, there)
    np.testing.assert_allclose(pose_difference(there, here), -carried(there, here) @ between, atol=1e-12)


def test_poses_are_as_far_apart_in_sigma_from_either_side() -> None:
    here, there = beside_the_seam()
    covariance = np.diag([1.0, 1.0, 1.0, 1e-8, 1.0])
    rows = carried(here, there)
    far = squared_sigmas(here, there, rows @ covariance @ rows.T)
    assert squared_sigmas(there, here, covariance) == pytest.approx(far, rel=1e-6)
    assert far != pytest.approx(squared_sigmas(here, there, covariance), rel=0.5)


def rig_beside_the_seam(turn: float) -> tuple[RigidTransform, TwoViewPose]:
    """The scene's pose, t turned about the line of sight to where both its smaller parts are alike, and past that."""
    side = np.array([-1.0, 0.02 * (1 + turn), 0.02 * (1 - turn)])
    t = side / np.linalg.norm(side) * np.linalg.norm(POSE.t)
    return RigidTransform(POSE.R, t), TwoViewPose(POSE.R, side / np.linalg.norm(side))


def test_sigma_of_a_pose_that_goes_with_its_lenses_does_not_jump() -> None:
    found: list[float] = []
    for turn in (-0.01, 0.01):
        known, _ = rig_beside_the_seam(turn)
        _, pose = rig_beside_the_seam(0.01)
        rig = replace(RIG, projector_from_camera=known)
        measured, truth = measured_scene("wall")
        prior = Prior(stated_prior(RIG, 0.01, 5.0, 0.02))
        here = posterior_at(replace(measured, rig=rig), replace(truth, pose=replace(truth.pose, t=pose.t)), prior)
        own = replace(here.pose, t=known.t / np.linalg.norm(known.t))
        together = carried(here.pose, own) @ here.follows
        apart = replace(here, prior=replace(prior, together=together))
        found.append(float(np.trace(apart.covariance - apart.statistical_covariance)))
    assert max(found) < 1e-6 * float(np.trace(here.covariance))


def test_a_pose_known_beforehand_holds_across_the_seam() -> None:
    measured, truth = measured_scene("wall")
    _, near = rig_beside_the_seam(0.01)
    _, known = rig_beside_the_seam(-0.01)
    start = replace(truth, pose=replace(truth.pose, t=near.t))
    precision = np.diag([1.0, 1.0, 1.0, 1e12, 1e12])
    held = Prior(stated_prior(RIG, 0.01, 5.0, 0.02), pose=PosePrior(known, precision))
    fit = fit_posterior(measured, start, held, 10)
    assert np.linalg.norm(fit.pose.t - known.t) < 1e-5
    assert isinstance(fit.parameters, Parameters)
