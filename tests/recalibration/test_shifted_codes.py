"""Codes that are whole periods off, on any surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from retrue.geometry.two_view import FREE
from retrue.recalibration.lens import stated_prior
from retrue.recalibration.parts import unexplained
from retrue.recalibration.posterior import Prior, posterior_at
from retrue.recalibration.shifted_codes import shifted_codes
from tests.recalibration.scenes import RIG
from tests.recalibration.test_posterior import measured_scene

PERIOD = np.array([40.0, 64.0])


def spoilt(shifts: np.ndarray, wrong: int) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Which 50 points have each of those shifts, and which `shifted_codes` finds; so many `wrong` ones are anywhere."""
    measured, truth = measured_scene("corner")
    rng = np.random.default_rng(0)
    points, projector_px = measured.support.points, measured.projector_px.copy()
    of = np.full(len(points), -1)
    of[rng.choice(len(points), 50 * len(shifts), replace=False)] = np.repeat(np.arange(len(shifts)), 50)
    projector_px += np.append(shifts, np.zeros((1, 2)), axis=0)[of]
    anywhere = rng.choice(np.flatnonzero(of < 0), wrong, replace=False)
    projector_px[anywhere] = rng.uniform(0, RIG.projector.size, (wrong, 2))
    points = replace(points, projector_rays=RIG.projector.unproject(projector_px))
    gone = np.ones(len(truth.pose.planes), dtype=np.bool_)
    moved = replace(measured, support=replace(measured.support, points=points), projector_px=projector_px)
    true = posterior_at(
        moved.without_planes(gone), truth.without_planes(gone), Prior(stated_prior(RIG, 0.01, 5.0, 0.02))
    )
    assert (true.points.plane_index == FREE).all()
    found = shifted_codes(true, unexplained(true))
    return [of == index for index in range(len(shifts))], [part.rows for part in found]


@pytest.mark.parametrize("shifts", [[PERIOD], [PERIOD, -PERIOD]])
@pytest.mark.parametrize("wrong", [0, 30])
def test_one_shift_puts_them_on_their_lines(shifts: list[np.ndarray], wrong: int) -> None:
    shifted, found = spoilt(np.array(shifts), wrong)
    assert len(found) == len(shifts)
    for rows in shifted:
        best = max(found, key=lambda one: np.count_nonzero(one & rows))
        assert np.count_nonzero(best & rows) >= 45
        assert np.count_nonzero(best & ~rows) <= 5


def test_what_is_anywhere_has_none() -> None:
    _, found = spoilt(np.empty((0, 2)), 200)
    assert found == []
