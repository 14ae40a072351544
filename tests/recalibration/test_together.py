"""Lenses and pose of one calibration err together: what is said of a pose that belongs to its lenses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from retrue.correspondences import Card, Correspondences
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform, rotation_angle
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.recalibrate import recalibrate
from retrue.recalibration.verify import verify
from retrue.rig import Rig

SIZE = (640, 480)
CAMERA = Camera(SIZE, [[420.0, 0, 319.5], [0, 420.0, 239.5], [0, 0, 1]], [-0.3, 0.1, 0, 0, 0])
RIG = Rig(CAMERA, CAMERA, RigidTransform.from_rotation_vector([0.01, -0.02, 0.005], [-0.2, 0.003, 0.002]), "m")


def pair(seed: int, *, photographs: bool, sheet: bool = False) -> Correspondences:
    """Matches of a scene without a plane, or most of them on a curled sheet."""
    rng = np.random.default_rng(seed)
    pixels = rng.uniform([4, 4], [635, 475], (500, 2))
    rays = CAMERA.unproject(pixels)
    depth = rng.uniform(0.8, 6, len(rays))
    if sheet:
        on = np.abs(rays).max(axis=1) < 0.45
        depth[on] = 1.0 + 0.1 * rays[on, 0] + 0.06 * rays[on, 0] ** 2
    seen = RIG.projector.project(
        RIG.projector_from_camera.apply(np.column_stack([rays, np.ones(500)]) * depth[:, None])
    )
    seen = seen + rng.normal(0, 0.1, seen.shape)
    kept = RIG.projector.contains(seen)
    card = Card("features", 500, 500, {}, 1.0) if photographs else None
    each = np.full(int(kept.sum()), 0.07)
    return Correspondences(pixels[kept], seen[kept], each, each, card=card, camera_size=SIZE, projector_size=SIZE)


def test_two_cameras_of_one_calibration_know_their_pose_better():
    alone = recalibrate(RIG, [pair(1, photographs=False)]).evidence.sigma
    together = recalibrate(RIG, [pair(1, photographs=True)]).evidence.sigma
    asked = recalibrate(RIG, [pair(1, photographs=False)], RecalibrateOptions(calibrated_together=True)).evidence.sigma
    assert together.rotation_deg < 0.5 * alone.rotation_deg
    assert 0.5 * together.rotation_deg < asked.rotation_deg < together.rotation_deg  # of which lenses leave something


def test_what_a_rig_states_of_its_lenses_stands():
    stated = replace(RIG, evidence={"lens_covariance": np.diag(np.square([2e-3, 1, 1, 1e-3] * 2)).tolist()})
    photographs, table = (recalibrate(stated, [pair(1, photographs=word)]).evidence.sigma for word in (True, False))
    assert photographs.rotation_deg == pytest.approx(table.rotation_deg, rel=0.02)


def test_sigma_holds_for_the_pose_that_belongs_to_wrong_lenses():
    """A principal point two pixels off is made up for by the pose, and the pose so found is the one to be kept."""
    K = RIG.projector.K.copy()
    K[0, 2] += 1.0
    wrong = replace(RIG, projector=replace(RIG.projector, K=K))
    poses = [recalibrate(wrong, [pair(seed, photographs=True)]).evidence for seed in (3, 4)]
    apart = np.degrees(rotation_angle(poses[0].pose.R @ poses[1].pose.R.T))
    assert apart < 3 * np.hypot(*(one.sigma.rotation_deg for one in poses))
    assert verify(wrong, [pair(3, photographs=True)]).covariance.shape == (5, 5)


def test_a_curled_sheet_is_no_plane_of_photographs():
    result = recalibrate(RIG, [pair(6, photographs=True, sheet=True)])
    error = np.degrees(rotation_angle(result.evidence.pose.R @ RIG.projector_from_camera.R.T))
    assert result.evidence.details["planes"] == 0
    assert error < 3 * result.evidence.sigma.rotation_deg
