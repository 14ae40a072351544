"""A lens that did change is told from parts of another pose, copies, and what its own calibration leaves open."""

from __future__ import annotations

import numpy as np
import pytest

import retrue
from benchmarks.judgement.kinds import draw
from retrue.geometry.transform import rotation_angle
from retrue.recalibration.options import RecalibrateOptions


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
