"""A lens that did change is told from parts of another pose, copies, and what its own calibration leaves open."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import retrue
from benchmarks.judgement.kinds import draw
from retrue.geometry.transform import rotation_angle, rotation_from_vector
from retrue.recalibration.explanation import Beliefs, explained
from retrue.recalibration.lens_evidence import held_instead
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.posterior import posterior_at
from retrue.recalibration.scene import scene_of
from tests.recalibration.scenes import BALL, RIG, bumped, capture


def answer(kind: str, seed: int) -> tuple[retrue.Accepted | retrue.Refused, float]:
    """And how far the pose that it found is off, deg."""
    case = draw(kind, seed)
    prior = case.prior
    options = RecalibrateOptions(
        focal_sigma=prior.focal, principal_point_sigma_px=prior.centre_px, k1_sigma=max(prior.k1, 1e-7)
    )
    result = retrue.recalibrate(case.told.public(case.evidence), [one.public() for one in case.captures], options)
    pose = result.evidence.pose
    assert pose is not None
    return result, float(np.degrees(rotation_angle(pose.R @ case.truths[0].R.T)))


@pytest.mark.parametrize(
    ("kind", "seed"),
    [
        ("focal both, rich", 172000003),  # the rig's lenses explain it too, eight sigma from where they were calibrated
        ("focal projector, rich", 172000014),
        ("focal camera, rich", 172000018),  # or two walls and a part of its own do, which costs more
        ("focal both, no plane", 172000011),  # or a pose that was searched later, from which it was not found again
    ],
)
def test_a_lens_that_changed_is_named(kind: str, seed: int) -> None:
    result, _ = answer(kind, seed)
    assert isinstance(result, retrue.Refused), result.reason
    assert result.cause.name == "LensChanged"


def test_half_a_wall_that_is_a_copy_is_no_lens() -> None:
    """Focal lengths 40 % longer explained it, too, and paid for no point of the copy."""
    result, _ = answer("shifted copy, wall", 176000014)
    assert result.evidence.lens == "unchecked"


def test_a_pose_in_whose_noise_all_points_lie_is_no_rival_of_a_lens() -> None:
    """It explains what half wrong matches ask for, too: twice the log of that noise is what each point costs it."""
    rig, options = bumped(RIG, [1, 2, 0], [0, 2, 0]), RecalibrateOptions()
    rng = np.random.default_rng(options.seed)
    points = capture(BALL, noise=0.4, outliers=0.5, seed=7)
    scene, found = explained(scene_of(rig, [points], options, rng), Beliefs.of(rig, options), rng)
    blamed, pose = replace(found.lens, verdict="changed"), found.best.pose
    assert blamed.posterior is not None
    turned = replace(pose, R=rotation_from_vector(np.array([0.0, 0.0, 1.0])) @ pose.R)
    loud = posterior_at(scene.measured(), replace(found.best.parameters, pose=turned), found.best.prior)
    assert loud.fit.epipolar_noise.level > 100 * blamed.posterior.fit.epipolar_noise.level
    assert held_instead(blamed, [loud], []) is None
