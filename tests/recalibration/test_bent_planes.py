"""Curled sheets pass for planes: bent, they explain the points better than lenses that err could."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from retrue.correspondences import Card, Correspondences
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform, direction_angle, rotation_angle
from retrue.geometry.two_view import FREE, TwoViewPose
from retrue.recalibration import doubtful_planes
from retrue.recalibration.bent_planes import bent_planes
from retrue.recalibration.bows import bow_shapes
from retrue.recalibration.fit import Support
from retrue.recalibration.lens import LensPrior, changed_device, stated_prior
from retrue.recalibration.measured import Measured
from retrue.recalibration.parameters import Parameters, Prior
from retrue.recalibration.parts import homography_residuals
from retrue.recalibration.posterior import Posterior, fit_posterior, posterior_at
from retrue.recalibration.rays import rays_of_captures
from retrue.recalibration.recalibrate import recalibrate
from retrue.recalibration.result import Accepted
from retrue.rig import Rig

SIZE = (640, 480)
CAMERA = Camera(SIZE, [[420.0, 0, 319.5], [0, 420.0, 239.5], [0, 0, 1]], [-0.3, 0.1, 0, 0, 0])
POSE = RigidTransform.from_rotation_vector([0.01, -0.02, 0.005], [-0.2, 0.003, 0.002])
RIG = Rig(CAMERA, CAMERA, POSE, "m")
LENSES = stated_prior(RIG, 2e-3, 1.0, 1e-3)
BOARD, SHEET = np.array([0.1, 0.05, 0.9]), np.array([-0.1, 0.0, 0.8])


def photographs(bend: float, seed: int, rig: Rig = RIG, around: int = 300) -> tuple[Correspondences, np.ndarray]:
    """A board, a sheet that is bent by that share of its distance, and points around; and which is which."""
    random = np.random.default_rng(seed)
    pixels = random.uniform([4, 4], [635, 475], (600 + around, 2))
    rays = rig.camera.unproject(pixels)
    ahead = np.column_stack([rays, np.ones(len(rays))])
    curl = bend * (4 * (rays[:, 0] - 0.35) ** 2 / 0.35**2 - 1)
    inverse = np.where(rays[:, 0] < 0, ahead @ BOARD, ahead @ SHEET * (1 + curl))
    plane = np.where(rays[:, 0] < 0, 0, 1)
    plane[600:] = FREE
    inverse = np.where(plane == FREE, random.uniform(0.2, 1.2, len(rays)), inverse)
    seen = rig.projector.project(rig.projector_from_camera.apply(ahead / inverse[:, None]))
    seen = seen + random.normal(0, 0.1, seen.shape)
    kept = rig.projector.contains(seen)
    each, card = np.full(int(kept.sum()), 0.07), Card("features", len(pixels), int(kept.sum()), {}, 1.0)
    found = Correspondences(pixels[kept], seen[kept], each, each, card=card, camera_size=SIZE, projector_size=SIZE)
    return found, plane[kept]


def fitted(bend: float, seed: int, rig: Rig = RIG, lenses: LensPrior = LENSES) -> Posterior:
    points, plane = photographs(bend, seed, rig)
    rays = rays_of_captures(RIG, [points], len(points), np.random.default_rng(0))
    rays = replace(rays, points=replace(rays.points, plane_index=plane[rays.row]))
    length = float(np.linalg.norm(POSE.t))
    start = TwoViewPose(POSE.R, POSE.t / length, np.stack([BOARD, SHEET]) * length)
    missed = homography_residuals(rays.points, [start.R + start.t[:, None] * n for n in start.planes])
    measured = Measured(
        RIG, points.camera_px[rays.row], points.projector_px[rays.row], Support.of(rays), bow_shapes(rays.points), 5e-4,
        np.empty((len(rays), 0), dtype=np.int64), homography_residuals=missed,
    )  # fmt: skip
    return fit_posterior(measured, Parameters.of(start), Prior(lenses), 6)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("bend", "is_bent"), [(0.0, False), (5e-4, False), (0.02, True), (-0.01, True)])
def test_a_sheet_is_bent_and_a_board_is_not(bend: float, is_bent: bool, seed: int) -> None:
    assert bent_planes(fitted(bend, seed)).tolist() == [False, is_bent]


@pytest.mark.parametrize("error", [-1e-3, 1e-3])
def test_what_lenses_bend_within_their_calibration_is_flat(error: float) -> None:
    off = np.array([1e-3, 0.5, -0.5, error])
    true = replace(RIG, camera=changed_device(CAMERA, off), projector=changed_device(CAMERA, -off))
    assert not bent_planes(fitted(0.0, 0, true)).any()
    known = LensPrior(LENSES.covariance * 1e-4)  # so well, that it would have to be the planes
    assert bent_planes(fitted(0.0, 0, true, known)).any()


def test_without_planes_none_is_bent() -> None:
    posterior = fitted(0.0, 0)
    gone = np.ones(2, dtype=np.bool_)
    start = posterior.parameters.without_planes(gone)
    alone = fit_posterior(posterior.measured.without_planes(gone), start, posterior.prior, 2)
    assert bent_planes(alone).shape == (0,)


@pytest.mark.parametrize("seed", range(2))
def test_a_curled_sheet_does_not_bend_the_pose(seed: int) -> None:
    result = recalibrate(RIG, [photographs(0.03, seed, around=60)[0]])
    assert isinstance(result, Accepted), result.reason
    pose, sigma = result.evidence.pose, result.evidence.sigma
    assert pose is not None
    assert sigma is not None
    assert np.degrees(rotation_angle(pose.R @ POSE.R.T)) < 3 * sigma.rotation_deg
    assert np.degrees(direction_angle(pose.t, POSE.t)) < 3 * sigma.translation_deg


@pytest.mark.parametrize("louder", [True, False])
def test_points_alone_take_planes_away_where_they_are_no_louder(louder: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Between the scene and a part of it that moved lies a pose that is far off, and no better explanation."""
    right = fitted(0.0, 0)
    off = right.parameters.moved(np.r_[0.002, np.zeros(5 + 6 + 8 + 6 - 1)])
    wrong = fit_posterior(right.measured, off, right.prior, 0)
    alone = (wrong if louder else right).parameters.without_planes(np.ones(2, dtype=np.bool_))
    monkeypatch.setattr(
        doubtful_planes, "fit_posterior", lambda measured, _, prior, __: posterior_at(measured, alone, prior)
    )
    monkeypatch.setattr(doubtful_planes, "squared_sigmas", lambda *_: 100.0)
    gone = doubtful_planes.needless_planes(right if louder else wrong, LENSES.covariance)
    assert gone.tolist() == [not louder] * 2


@pytest.mark.parametrize("textured", [True, False])
@pytest.mark.parametrize("one_shift", [True, False])
def test_copies_of_a_plane_are_no_points_that_only_a_pose_without_planes_explains(
    textured: bool, one_shift: bool
) -> None:
    right = fitted(0.0, 0)
    copied = np.flatnonzero(right.points.plane_index == 0)[:60]
    shifted = right.measured.projector_px.copy()
    shifted[copied] += [6.0, 9.0] if one_shift else np.random.default_rng(0).uniform(6, 40, (60, 2))
    rays = right.points.projector_rays.copy()
    rays[copied] = CAMERA.unproject(shifted[copied])
    support = replace(right.measured.support, points=replace(right.points, projector_rays=rays))
    measured = replace(right.measured, projector_px=shifted, support=support, textured=textured)
    planes = posterior_at(measured, right.parameters, right.prior)
    alone = posterior_at(measured, right.parameters, right.prior)
    alone = replace(alone, fit=replace(alone.fit, robust_weights=np.ones((2, len(rays)))))
    assert doubtful_planes._explains_more(alone, planes) == (not one_shift)
