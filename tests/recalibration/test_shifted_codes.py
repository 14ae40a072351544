"""Codes that are whole periods off, on any surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from retrue.geometry.two_view import FREE
from retrue.recalibration.costs import UNEXPLAINED, Floor, explained_costs
from retrue.recalibration.lens import stated_prior, wide_prior
from retrue.recalibration.lens_evidence import LensEvidence, held_instead
from retrue.recalibration.parameters import Prior
from retrue.recalibration.parts import A_COPY
from retrue.recalibration.posterior import Posterior, fit_posterior, posterior_at
from retrue.recalibration.shifted_codes import shifted_codes
from tests.recalibration.scenes import RIG
from tests.recalibration.test_posterior import measured_scene

PERIOD = np.array([40.0, 64.0])
LENSES = stated_prior(RIG, 0.01, 5.0, 0.02)


def spoilt(shifts: np.ndarray, wrong: int) -> tuple[list[np.ndarray], Posterior]:
    """Which 50 points have each of those shifts, and the right pose of points that lie on no plane known to it.

    So many `wrong` ones are anywhere.
    """
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
    true = posterior_at(moved.without_planes(gone), truth.without_planes(gone), Prior(LENSES))
    assert (true.points.plane_index == FREE).all()
    return [of == index for index in range(len(shifts))], true


@pytest.mark.parametrize("shifts", [[PERIOD], [PERIOD, -PERIOD]])
@pytest.mark.parametrize("wrong", [0, 30])
def test_one_shift_puts_them_on_their_lines(shifts: list[np.ndarray], wrong: int) -> None:
    shifted, true = spoilt(np.array(shifts), wrong)
    found = [part.rows for part in shifted_codes(true, true.unexplained)]
    assert len(found) == len(shifts)
    for rows in shifted:
        best = max(found, key=lambda one: np.count_nonzero(one & rows))
        assert np.count_nonzero(best & rows) >= 45
        assert np.count_nonzero(best & ~rows) <= 5


def test_what_is_anywhere_has_none() -> None:
    _, true = spoilt(np.empty((0, 2)), 200)
    assert shifted_codes(true, true.unexplained) == []


def test_they_are_parts_of_the_pose_and_cost_it_little() -> None:
    """Else a pose that takes some of them for noise would cost less."""
    shifted, true = spoilt(np.array([PERIOD]), 0)
    assert [part.name for part in true.parts] == [A_COPY]
    found, _, parts = explained_costs(true, Floor.of([true]), ())
    assert len(parts) == 1
    assert found[shifted[0]].mean() < UNEXPLAINED / 2
    textured = replace(true, measured=replace(true.measured, textured=True))
    assert textured.parts == []  # texture has no code


def test_a_changed_lens_is_no_answer_where_a_pose_with_its_copies_costs_less() -> None:
    _, true = spoilt(np.array([PERIOD]), 0)
    off = np.array([0.05, 0, 0, 0, 0.05, 0, 0, 0])
    led = fit_posterior(true.measured, replace(true.parameters, lens=off), Prior(wide_prior(RIG, LENSES), free=True), 0)
    evidence = LensEvidence("changed", off, np.ones(8), 99.0, LENSES, LENSES.covariance, led)
    assert held_instead(evidence, [true], ()) is true
    assert held_instead(replace(evidence, verdict="checked"), [true], ()) is None
    assert held_instead(replace(evidence, posterior=true), [led], ()) is None
