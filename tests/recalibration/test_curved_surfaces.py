"""A hill in a small window passes for a wall, and bends the pose with as little noise as any: compared as curved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import retrue
from retrue.correspondences import Correspondences
from retrue.geometry.arrays import FloatArray
from retrue.geometry.homography import fit_homography
from retrue.geometry.transform import direction_angle, rotation_angle, rotation_from_vector
from retrue.geometry.two_view import TwoViewPose, planes_of_pose
from retrue.recalibration import posterior
from retrue.recalibration.bows import bow_shapes
from retrue.recalibration.curved_surfaces import curved_of, curved_rival
from retrue.recalibration.fit import Support, own_pose
from retrue.recalibration.lens import stated_prior
from retrue.recalibration.measured import Measured
from retrue.recalibration.parameters import Parameters, Prior
from retrue.recalibration.parts import homography_residuals
from retrue.recalibration.posterior import Posterior, fit_cost, fit_posterior
from retrue.recalibration.rays import rays_of_captures
from tests.recalibration.scenes import CAMERA, POSE, RIG, bumped

NORMAL = np.array([0.2, -0.1, 0.65])


def window(bend: float, noise: float, seed: int, *, side: float = 0.25, number: int = 1500) -> Correspondences:
    """A saddle, bent by up to that share of its distance over a window of the picture, as a decoder finds it."""
    rng = np.random.default_rng(seed)
    rays = rng.uniform(-side, side, (number, 2)) * [1.0, 0.8]
    u, v = rays[:, 0] / side, rays[:, 1] / side
    ahead = np.column_stack([rays, np.ones(number)])
    points = ahead / (ahead @ NORMAL * (1 + bend * (u**2 - v**2 + u * v)))[:, None]
    seen = RIG.projector.project(POSE.apply(points))
    pixels = CAMERA.project(points)
    kept = RIG.projector.contains(seen) & CAMERA.contains(pixels)
    pixels = pixels + rng.normal(0, noise, pixels.shape)
    return Correspondences(pixels[kept], seen[kept], camera_size=CAMERA.size, projector_size=RIG.projector.size)


def as_a_plane(points: Correspondences) -> Posterior:
    """The fit that takes all of it for one."""
    rays = rays_of_captures(RIG, [points], len(points), np.random.default_rng(0))
    rays = replace(rays, points=replace(rays.points, plane_index=np.zeros(len(rays), dtype=np.int64)))
    length = float(np.linalg.norm(POSE.t))
    start = TwoViewPose(POSE.R, POSE.t / length, NORMAL[None] * length)
    shapes, neighbours = bow_shapes(rays.points), np.empty((len(rays), 0), dtype=np.int64)
    pixels = points.camera_px[rays.row], points.projector_px[rays.row]
    H = fit_homography(rays.points.camera_rays, rays.points.projector_rays)
    missed = homography_residuals(rays.points, [H])
    measured = Measured(RIG, *pixels, Support.of(rays), shapes, 5e-4, neighbours, homography_residuals=missed)
    return fit_posterior(measured, Parameters.of(start), Prior(stated_prior(RIG, 2e-3, 1.0, 1e-3)), 10)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("bend", [0.0, 3e-4])
def test_a_wall_as_flat_as_walls_are_has_no_such_rival(bend: float, seed: int) -> None:
    assert curved_rival(as_a_plane(window(bend, 0.1, seed)), own_pose(RIG)) is None


@pytest.mark.parametrize("seed", range(3))
def test_a_hill_is_better_explained_as_curved(seed: int) -> None:
    rival = curved_rival(as_a_plane(window(0.02, 0.1, seed)), own_pose(RIG))
    assert rival is not None
    assert rival.margin < 0
    assert curved_of(rival).tolist() == [True]


@pytest.mark.parametrize("bend", np.geomspace(2e-3, 0.1, 6))
def test_what_is_nearly_flat_is_answered_within_its_sigma_or_not_at_all(bend: float) -> None:
    for seed in range(3):
        old = bumped(RIG, [1.0, -2.0, 1.0], [2.0, 0.0, -3.0])
        result = retrue.recalibrate(old, [window(bend, 0.05, seed)])
        if isinstance(result, retrue.Accepted):
            pose, sigma = result.rig.projector_from_camera, result.evidence.sigma
            assert sigma is not None
            assert np.degrees(rotation_angle(pose.R @ POSE.R.T)) < max(0.2, 4 * sigma.rotation_deg)
            assert np.degrees(direction_angle(pose.t, POSE.t)) < max(0.2, 4 * sigma.translation_deg)


@pytest.mark.parametrize("follows", [True, False])
def test_a_fit_goes_all_the_way_down_a_valley_that_bends(follows: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pose, plane and bows of a small window: straight steps leave the valley, and damped ones stop in it."""
    if not follows:
        monkeypatch.setattr(posterior, "LONG", np.inf)
    above = list[float]()
    for axis in ([2.0, 0.0, 0.0], [0.0, -3.0, 0.0], [2.0, 2.0, 0.0]):
        for seed in (0, 3):
            true = as_a_plane(window(2e-4, 0.05, seed, side=0.08, number=400))
            H: FloatArray = true.pose.R + true.pose.t[:, None] * true.pose.planes[0]
            R = rotation_from_vector(np.radians(axis)) @ true.pose.R
            t = rotation_from_vector(1.3 * np.radians(axis)) @ true.pose.t
            start = Parameters.of(TwoViewPose(R, t, planes_of_pose(R, t, [H])))
            found = fit_posterior(true.measured, start, true.prior, 30)
            above.append(fit_cost(found, true) - fit_cost(true, true))
    assert (max(above) < 0.1) == follows
