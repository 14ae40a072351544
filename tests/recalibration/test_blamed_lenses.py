"""Codes that are off, and planes that are curved, are no reason to say that a lens has changed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import retrue
from retrue.correspondences import Correspondences
from retrue.geometry.transform import direction_angle, rotation_angle
from retrue.geometry.two_view import FREE
from retrue.recalibration.candidates import poses_of_no_plane
from retrue.recalibration.copies import shifted_copies
from retrue.recalibration.costs import UNEXPLAINED, anywhere_along, scattered
from retrue.recalibration.curved_surfaces import surfaces_of
from retrue.recalibration.parts import A_COPY, Part
from retrue.recalibration.posterior import Posterior, fit_posterior, posterior_at
from retrue.recalibration.rays import rays_of_captures
from retrue.recalibration.rivals import nearest_points
from tests.recalibration.scenes import POSE, RIG, bumped
from tests.recalibration.test_curved_surfaces import as_a_plane, window

NEAR = bumped(RIG, [1.0, -2.0, 1.0], [2.0, 0.0, -3.0])
HILL = np.ones(1, dtype=np.bool_)


def periods_off(points: Correspondences, share: float, seed: int) -> Correspondences:
    """So many codes one period of 32 px off, to either side."""
    rng = np.random.default_rng(seed)
    rows = rng.random(len(points)) < share
    shift = np.where(rows, 32.0 * rng.choice([-1, 1], len(points)), 0.0)
    pixels = points.projector_px + shift[:, None] * [1.0, 0.0]
    kept = RIG.projector.contains(pixels)
    return replace(points, camera_px=points.camera_px[kept], projector_px=pixels[kept])


@pytest.mark.parametrize(("bend", "side", "share"), [(0.0, 0.25, 0.1), (0.0, 0.1, 0.3), (0.02, 0.25, 0.3)])
def test_periods_off_on_a_wall_or_a_hill(bend: float, side: float, share: float) -> None:
    """Shifted nearly along their lines, they pull the pose, and other lenses explain what is left."""
    for seed in range(3):
        points = periods_off(window(bend, 0.3, seed, side=side, number=400), share, seed + 100)
        result = retrue.recalibrate(NEAR, [points])
        assert isinstance(result, retrue.Accepted), result.reason
        pose, sigma = result.rig.projector_from_camera, result.evidence.sigma
        assert sigma is not None
        assert np.degrees(rotation_angle(pose.R @ POSE.R.T)) < 4 * sigma.rotation_deg
        assert np.degrees(direction_angle(pose.t, POSE.t)) < 4 * sigma.translation_deg


def with_neighbours(fit: Posterior, points: Correspondences) -> Posterior:
    rays = rays_of_captures(RIG, [points], len(points), np.random.default_rng(0))
    return replace(fit, measured=replace(fit.measured, neighbours=nearest_points(rays)))


def test_where_points_of_a_part_alternate_with_others_they_were_chosen_one_by_one() -> None:
    points = window(0.0, 0.1, 0)
    measured = with_neighbours(as_a_plane(points), points).measured
    rng = np.random.default_rng(0)
    side = measured.camera_px[:, 0] < np.quantile(measured.camera_px[:, 0], 0.3)
    part = Part("another pose", side, 5, np.zeros((int(side.sum()), 1)), 0.1)
    assert scattered(part, measured) < 0.15
    assert scattered(replace(part, rows=rng.permutation(side)), measured) > 0.9


def test_a_copy_says_where_along_its_line_a_point_is_and_what_is_in_one_place_need_not() -> None:
    points = window(0.0, 0.1, 0)
    fit = with_neighbours(as_a_plane(points), points)
    rows = np.random.default_rng(0).random(len(fit.points)) < 0.2
    index = np.where(rows, FREE, 0)
    support = replace(fit.measured.support, points=replace(fit.measured.support.points, plane_index=index))
    fit = posterior_at(replace(fit.measured, support=support), fit.parameters, fit.prior)
    copy = Part(A_COPY, rows, 2, np.zeros((int(rows.sum()), 2)), 0.1)
    assert anywhere_along(copy, fit) == pytest.approx(UNEXPLAINED, abs=1.5)
    assert not anywhere_along(replace(copy, missed=copy.missed[:, :1]), fit).any()
    textured = replace(fit, measured=replace(fit.measured, textured=True))
    assert not anywhere_along(copy, textured).any()


def as_a_hill(points: Correspondences) -> Posterior:
    """The fit that takes all of it for one surface, which may be curved."""
    flat = with_neighbours(as_a_plane(points), points)
    return fit_posterior(replace(flat.measured, curved=HILL), flat.parameters.as_curved(HILL), flat.prior, 15)


def test_codes_off_are_copies_of_a_surface_where_it_is_curved() -> None:
    points = window(0.03, 0.05, 0, number=800)
    hill = as_a_hill(points)
    moved = np.random.default_rng(0).choice(len(hill.points), 60, replace=False)
    projector_px = hill.measured.projector_px.copy()
    projector_px[moved] += [3.0, 40.0]
    index, rays = np.zeros(len(hill.points), dtype=np.int64), hill.points.projector_rays.copy()
    index[moved], rays[moved] = FREE, RIG.projector.unproject(projector_px[moved])
    seen = replace(hill.measured.support.points, projector_rays=rays, plane_index=index)
    support = replace(hill.measured.support, points=seen)
    measured = replace(hill.measured, support=support, projector_px=projector_px)
    levels = list[float]()
    for bows in (hill.parameters.bows, np.zeros_like(hill.parameters.bows)):
        fit = posterior_at(measured, replace(hill.parameters, bows=bows), hill.prior)
        found = shifted_copies(fit, fit.unexplained & (index == FREE), 1)
        assert found[0].count >= 55
        levels.append(found[0].level)
    assert levels[0] < 0.2
    assert levels[1] > 10 * levels[0]


@pytest.mark.parametrize("bend", [0.0, 3e-4])
def test_what_may_be_curved_is_where_it_was(bend: float) -> None:
    flat = as_a_plane(window(bend, 0.1, 0))
    curved = posterior_at(replace(flat.measured, curved=HILL), flat.parameters.as_curved(HILL), flat.prior)
    assert np.allclose(curved.fit.found.along, flat.fit.found.along)
    gone = curved.measured.without_planes(HILL)
    assert gone.curved is not None
    assert len(gone.curved) == 0


def test_a_hill_is_a_surface_and_points_at_any_depth_are_none() -> None:
    hill = as_a_plane(window(0.02, 0.1, 0))
    assert surfaces_of(hill, HILL).tolist() == [True]
    assert surfaces_of(hill, ~HILL).tolist() == [False]
    x = np.column_stack([hill.points.camera_rays, np.ones(len(hill.points))])
    there = POSE.apply(x * np.random.default_rng(0).uniform(1.2, 1.8, (len(x), 1)))
    points = replace(hill.measured.support.points, projector_rays=there[:, :2] / there[:, 2:])
    nowhere = replace(hill.measured, support=replace(hill.measured.support, points=points))
    assert surfaces_of(posterior_at(nowhere, hill.parameters, hill.prior), HILL).tolist() == [False]


def test_poses_are_found_that_no_plane_leads_to() -> None:
    support = as_a_plane(window(0.2, 0.02, 0)).measured.support
    wrong = np.linalg.inv(np.diag([1.0, 1.2, 0.9]))
    found = poses_of_no_plane(support, [wrong], (1e-4, 1e-4), np.random.default_rng(0))
    apart = [np.degrees(rotation_angle(pose.R @ POSE.R.T) + direction_angle(pose.t, POSE.t)) for pose in found]
    assert min(apart) < 1.0
    assert all(len(pose.planes) == 1 for pose in found)
    scene = replace(support, points=support.points.select(np.arange(4)), blocks=support.blocks[:, :4])
    assert poses_of_no_plane(scene, [wrong], (1e-4, 1e-4), np.random.default_rng(0)) == []
