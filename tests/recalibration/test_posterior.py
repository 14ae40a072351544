"""One posterior of pose, planes, bows and lenses: its derivatives are those of its cost, and its sigma holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from retrue.geometry.robust import Noise, biweight
from retrue.geometry.transform import vector_from_rotation
from retrue.geometry.two_view import FREE, TwoViewPose, tangent_basis
from retrue.recalibration.bows import bow_shapes
from retrue.recalibration.fit import Support, chi_square
from retrue.recalibration.lens import FOCAL, changed_device, stated_prior
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.parameters import LENSES, Parameters, PosePrior, Prior
from retrue.recalibration.posterior import Measured, Posterior, fit_posterior, posterior_at
from retrue.recalibration.rays import rays_of_captures
from retrue.rig import Rig
from tests.recalibration.scenes import POSE, RIG, SIDE_WALL, WALL, Scene, capture

OPTIONS = RecalibrateOptions()
SCENES = {"wall": Scene(), "corner": Scene(planes=[WALL, SIDE_WALL])}
UNIT = POSE.t / np.linalg.norm(POSE.t)


def measured_scene(
    name: str, rig: Rig = RIG, seed: int = 0, noise: float = 0.1, known: Rig = RIG
) -> tuple[Measured, Parameters]:
    """A scene without wrong matches, seen by `rig` and taken for seen by the known one; and the truth."""
    points = capture(SCENES[name], rig=rig, grid=(20, 16), seed=seed, noise=noise)
    rays = rays_of_captures(known, [points], OPTIONS.max_points, np.random.default_rng(0))
    planes = np.array([normal / np.linalg.norm(normal) / distance for normal, distance in SCENES[name].planes])
    x = np.c_[rays.points.camera_rays, np.ones(len(rays))]
    nearest = np.argmax(x @ planes.T, axis=1)  # inverse depth
    rays = replace(rays, points=replace(rays.points, plane_index=nearest.astype(np.int64)))
    pose = TwoViewPose(POSE.R, UNIT, planes * np.linalg.norm(POSE.t))
    nobody = np.empty((len(rays), 0), dtype=np.int64)
    camera_px, projector_px = points.camera_px[rays.row], points.projector_px[rays.row]
    shapes = bow_shapes(rays.points)
    return Measured(known, camera_px, projector_px, Support.of(rays), shapes, 5e-4, nobody), Parameters.of(pose)


def test_bows_have_unit_size_and_no_tilt() -> None:
    measured, _ = measured_scene("corner")
    points = measured.support.points
    for plane in (0, 1):
        mine = points.plane_index == plane
        assert mine.sum() > 50
        shapes = measured.shapes[mine]
        assert np.sqrt((shapes**2).sum(axis=1).mean()) == pytest.approx(1)
        linear = np.c_[points.camera_rays[mine], np.ones(mine.sum())]
        assert np.abs(linear.T @ shapes).max() < 1e-9 * len(shapes)
    free = replace(points, plane_index=np.full(len(points), FREE))
    assert not bow_shapes(free).any()


def in_noise_of_a_sigma(posterior: Posterior) -> Posterior:
    """The same place, where the noise is what the points say of themselves and not what their residuals say."""
    found = posterior.fit.found.both
    noise = Noise(1.0, 0.0, np.ones(found.shape[1]))
    weights = biweight(found)
    fit = replace(posterior.fit, epipolar_noise=noise, along_noise=noise, robust_weights=weights)
    return replace(posterior, fit=fit)


def test_gradient_and_information_are_those_of_the_cost() -> None:
    """Of the cost in the noise of the place: half its first difference, half its second.

    Robust weights are secants of the loss, so that the information is more than its second derivative; the two are one
    where residuals are small against the noise.
    """
    measured, truth = measured_scene("corner", noise=1e-3)
    held = PosePrior(TwoViewPose(POSE.R, UNIT), np.eye(5) / np.radians(0.5) ** 2)
    prior = Prior(stated_prior(RIG, 2e-3, 1.0, 5e-3), free=True, pose=held)
    rng = np.random.default_rng(1)
    here = in_noise_of_a_sigma(posterior_at(measured, truth, prior))
    root = np.linalg.cholesky(np.linalg.inv(here.information))
    count = len(root)
    assert count == 5 + 6 + LENSES + 6

    def cost(step: np.ndarray) -> float:
        there = posterior_at(measured, here.parameters.moved(step), prior)
        return float(chi_square(there.fit, here.fit).sum()) + there.prior_cost

    middle = cost(np.zeros(count))
    for _ in range(8):
        step = root @ rng.normal(size=count)
        up, down = cost(0.3 * step), cost(-0.3 * step)
        square = step @ here.information @ step
        assert (up - down) / 1.2 == pytest.approx(here.gradient @ step, abs=0.02 * square)
        assert (up + down - 2 * middle) / 0.18 == pytest.approx(square, rel=0.05)


def test_however_well_points_are_known_the_lens_lets_a_part_of_the_picture_tell_no_more() -> None:
    misfit, measured, truth = 0.5, *measured_scene("wall")
    points, blocks = measured.support.points, measured.support.blocks[0]
    known_best = blocks < 18
    own = np.where(known_best, 0.25, 1.0)
    points = replace(points, camera_sigma=points.camera_sigma * own, projector_sigma=points.projector_sigma * own)
    measured = replace(measured, support=replace(measured.support, points=points), misfit=misfit)
    fit = posterior_at(measured, truth, Prior(stated_prior(RIG, 0.01, 5.0, 0.02))).fit
    usual = np.median(own)
    told = np.bincount(blocks, (usual / own) ** 2 / fit.epipolar_noise.variance)  # of a mean, in usual sigma
    assert told.max() < 1 / misfit**2
    assert told[:18].max() < 1.3 * np.median(told[18:])


def test_a_bare_wall_tells_nothing_of_focal_lengths() -> None:
    """Eight numbers of its homography are five of the pose and three of the plane: noise must not pass for more."""
    straight = replace(RIG, camera=replace(RIG.camera, distortion=np.zeros(0)))
    measured, truth = measured_scene("wall", straight, noise=0.3, known=straight)
    prior = Prior(stated_prior(RIG, OPTIONS.focal_sigma, OPTIONS.principal_point_sigma_px, OPTIONS.k1_sigma))
    posterior = fit_posterior(measured, truth, prior, 10)
    told = posterior.lens_information[np.ix_(FOCAL, FOCAL)]
    assert np.abs(told).max() < 1e-4 * posterior.information[5 + 3, 5 + 3]
    assert np.linalg.eigvalsh(told)[-1] < 100  # less than 10 % of a focal length
    assert np.abs(posterior.lens_pull[FOCAL]).max() < 10


def lens_drawn(rng: np.random.Generator) -> Rig:
    """The rig as it is, where the one that we know has lenses drawn from the stated prior."""
    change = rng.multivariate_normal(np.zeros(8), stated_prior(
        RIG, OPTIONS.focal_sigma, OPTIONS.principal_point_sigma_px, OPTIONS.k1_sigma).covariance)  # fmt: skip
    camera, projector = changed_device(RIG.camera, change[:4]), changed_device(RIG.projector, change[4:])
    return replace(RIG, camera=camera, projector=projector)


def normalised_error(posterior: Posterior) -> float:
    pose = posterior.pose
    error = np.r_[vector_from_rotation(pose.R @ POSE.R.T), tangent_basis(pose.t).T @ -UNIT]
    return float(error @ np.linalg.solve(posterior.covariance, error))


@pytest.mark.parametrize("scene", SCENES)
def test_sigma_holds_where_lenses_are_as_uncertain_as_stated(scene: str) -> None:
    rng = np.random.default_rng(2)
    prior = Prior(stated_prior(RIG, OPTIONS.focal_sigma, OPTIONS.principal_point_sigma_px, OPTIONS.k1_sigma))
    errors: list[float] = []
    for seed in range(40):
        measured, truth = measured_scene(scene, lens_drawn(rng), seed)
        errors.append(normalised_error(fit_posterior(measured, truth, prior, 6)))
    assert 3 < np.mean(errors) < 7.5
