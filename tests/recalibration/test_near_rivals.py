"""Other poses that explain the points as well: those nearby make an answer less sure, others refuse it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from retrue.geometry.two_view import TwoViewPose
from retrue.recalibration.judge import judge, objection
from retrue.recalibration.near_rivals import allowed_error, near_rivals, spread
from retrue.recalibration.options import RecalibrateOptions
from retrue.recalibration.reasons import RivalUnbeaten
from retrue.recalibration.result import sigma, sigma_at, working_distance
from retrue.recalibration.rivals import Rival
from tests.recalibration.scenes import RIG, SIDE_WALL, WALL, Scene, capture

OPTIONS = RecalibrateOptions()


def rival(turned_deg: float, nats: float) -> Rival:
    """The answer, turned about the camera's y axis, that much less probable."""
    step = np.zeros(5)
    step[1] = np.radians(turned_deg)
    pose = replace(ANSWER.pose, planes=np.empty((0, 3))).moved(step)
    return Rival("another pose", replace(ANSWER, parameters=replace(ANSWER.parameters, pose=pose)), nats, 0.0, 0.0)


JUDGED = judge(RIG, [capture(Scene(planes=[WALL, SIDE_WALL]))], OPTIONS)
ANSWER = JUDGED.answer


@pytest.mark.parametrize(
    ("turned_deg", "nats", "is_near"), [(0.3, 0.0, True), (0.3, 6.9, True), (0.3, 7.1, False), (10.0, 0.0, False)]
)
def test_only_what_is_neither_beaten_nor_far_is_near(turned_deg: float, nats: float, is_near: bool) -> None:
    other = rival(turned_deg, nats)
    near = near_rivals(ANSWER, [other], RIG, OPTIONS)
    assert near == ([other] if is_near else [])


def test_half_the_way_is_a_sigma() -> None:
    near = [rival(0.3, 0.0), rival(-0.4, 0.0)]
    added = sigma(spread(ANSWER, near))
    assert added.rotation_deg == pytest.approx(np.hypot(0.15, 0.2), rel=1e-3)
    np.testing.assert_array_equal(spread(ANSWER, []), np.zeros((5, 5)))


@pytest.mark.parametrize("nats", [0.0, np.nan])
def test_a_far_rival_refuses_and_a_near_one_does_not(nats: float) -> None:
    distance = working_distance(ANSWER.fit, ANSWER.points, float(np.linalg.norm(RIG.projector_from_camera.t)))
    for other, refused in ((rival(0.3, nats), False), (rival(10.0, nats), True)):
        near = tuple(near_rivals(ANSWER, [other], RIG, OPTIONS))
        covariance = ANSWER.covariance + spread(ANSWER, near)
        judgement = replace(JUDGED, rivals=(other,), near=near, covariance=covariance)
        known = sigma_at(distance, covariance, ANSWER.pose, RIG)
        assert isinstance(objection(judgement, known, distance, OPTIONS), RivalUnbeaten) == refused
        assert known.rotation_deg > 0.1 or refused


def test_an_error_that_has_points_at_infinity_is_not_allowed_though_a_pixel_is_as_large() -> None:
    sideways = TwoViewPose(RIG.projector_from_camera.R, np.array([-1.0, 0.0, 0.0]))
    assert OPTIONS.max_error < allowed_error(RIG, sideways, 30.0, OPTIONS) < 0.1  # a pixel, at a base of .36
    known = sigma_at(3000.0, ANSWER.covariance, sideways, RIG)
    assert known.displacement == np.inf
    for pose in (sideways, replace(sideways, t=-sideways.t)):  # rays a pixel off meet nearer, or not at all
        assert allowed_error(RIG, pose, 3000.0, OPTIONS) == pytest.approx(1 / 3)
    assert objection(JUDGED, known, 3000.0, OPTIONS) is not None
